"""What is shown to people: lines in which nothing moves the cursor, and a log with an end to it.

Names, reasons and errors come from strangers, out of files and from plug-ins. A control character
in one of them would let whoever wrote it recolour, overwrite or reorder what a terminal shows, and
a line break add a line that looks like one of ours. So every shell says what it says by ``say``,
``say_error`` or ``bounded_log``, and whatever draws text elsewhere takes it from ``printable``.
"""

import sys
from collections.abc import Callable
from unicodedata import category

LINES_MAX = 50


def printable(text: str) -> str:
    r"""Text as one line of visible characters, any other as its escape: ``\x1b``, ``\u202e``."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or category(c) == "Zs" else ascii(c)[1:-1] for c in text)


def printable_lines(text: str) -> str:
    """As ``printable`` for a text that may have several lines."""
    return "\n".join(map(printable, text.split("\n")))


def say(*lines: str) -> None:
    """Lines to standard output."""
    for line in lines:
        print(printable(line), flush=True)


def say_error(*lines: str) -> None:
    """Lines to standard error."""
    for line in lines:
        print(printable(line), file=sys.stderr, flush=True)


def bounded_log(lines_max: int = LINES_MAX) -> Callable[[str], None]:
    """A log to standard error that goes silent after so many lines, saying so."""
    left = lines_max

    def log(line: str) -> None:
        nonlocal left
        left -= 1
        if left >= 0:
            say_error(line)
        if left == 0:
            say_error("further messages are counted but not shown")

    return log
