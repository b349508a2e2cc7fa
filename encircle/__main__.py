"""What ``encircle`` and ``python -m encircle`` start."""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    # ``python -m`` looks for modules in the working directory first, where a person's own
    # ``random.py`` may lie.
    del sys.path[0]

from encircle.protocol.process.interrupts import exit_on_signal, exit_process


def main() -> None:
    """Run the command line; what it imports takes a while, and Ctrl-C may come meanwhile."""
    exit_on_signal("encircle")
    from encircle.cli.main import main as command_line

    exit_process(command_line())


if __name__ == "__main__":
    main()
