"""What ``encircle`` and ``python -m encircle`` start."""

from encircle.protocol.process.interrupts import exit_on_signal, exit_process


def main() -> None:
    """Run the command line; what it imports takes a while, and Ctrl-C may come meanwhile."""
    exit_on_signal("encircle")
    from encircle.cli.main import main as command_line

    exit_process(command_line())


if __name__ == "__main__":
    main()
