"""What ``encircle`` and ``python -m encircle`` start."""

from encircle.protocol.process.interrupts import end_at_once, leave


def main() -> None:
    """Run the command line; what it imports takes a while, and Ctrl-C may come meanwhile."""
    end_at_once("encircle")
    from encircle.cli.main import main as command_line

    leave(command_line())


if __name__ == "__main__":
    main()
