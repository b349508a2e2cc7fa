"""What is shown to people: lines in which nothing moves the cursor, and a log with an end to it.

Names, reasons and errors come from strangers, out of files and from plug-ins. A control character
in one of them would let whoever wrote it recolour, overwrite or reorder what a terminal shows, and
a line break add a line that looks like one of ours. So every shell says what it says by ``say``,
``say_error`` or ``bounded_log``, and whatever draws text elsewhere takes it from ``printable``.

A program that starts nodes and reads their standard error sets ``KINDS_VARIABLE`` in their
environment: then each line begins with what kind of line it is.
"""

import os
import sys
import threading
from collections.abc import Callable
from enum import StrEnum
from typing import TextIO
from unicodedata import category

LINES_MAX = 50
_OUTPUT, _ERRORS = threading.RLock(), threading.RLock()
"""One each: who does not read one stream must not keep what is said on the other."""
KINDS_VARIABLE = "ENCIRCLE_LINE_KINDS"


class LineKind(StrEnum):
    """What a line on standard error tells of.

    ``PROBLEM``: what may end the process. ``PLUGIN``: a plug-in that failed. ``REFUSAL``: a message
    that was refused, and ``EVENT``: what happened to a robot; the process goes on after both.
    """

    PROBLEM = "problem"
    PLUGIN = "plug-in"
    REFUSAL = "refusal"
    EVENT = "event"


_KINDS = {kind.value: kind for kind in LineKind}
_AFTER_KIND = "\t"
"""``printable`` leaves no tab in a line."""


def kind_and_text(line: str) -> tuple[LineKind, str]:
    """A line that a node has said, taken apart; what has no kind is a problem, as of Python."""
    kind, separator, text = line.partition(_AFTER_KIND)
    return (_KINDS[kind], text) if separator and kind in _KINDS else (LineKind.PROBLEM, line)


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
        write_line(sys.stdout, printable(line))


def say_error(*lines: str, kind: LineKind = LineKind.PROBLEM) -> None:
    """Lines to standard error."""
    before = f"{kind}{_AFTER_KIND}" if KINDS_VARIABLE in os.environ else ""
    for line in lines:
        write_line(sys.stderr, before + printable(line))


def write_line(stream: TextIO | None, line: str) -> None:
    """Write one line; lines of several threads never mix. Without a stream nothing happens.

    ``print`` writes the line's end apart, so that another thread's line may come between.
    """
    if stream is not None:
        with _ERRORS if stream is sys.stderr else _OUTPUT:
            stream.write(f"{line}\n")
            stream.flush()


def bounded_log(lines_max: int = LINES_MAX) -> Callable[[str], None]:
    """A log of refusals to standard error, which goes silent after so many lines and says so."""
    left = lines_max

    def log(line: str) -> None:
        nonlocal left
        left -= 1
        if left >= 0:
            say_error(line, kind=LineKind.REFUSAL)
        if left == 0:
            say_error("further messages are counted but not shown", kind=LineKind.REFUSAL)

    return log
