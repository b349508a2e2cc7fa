"""A log for what arrives from strangers: one line each, and an end to it."""

import sys
from collections.abc import Callable

LINES_MAX = 50


def bounded_log(lines_max: int = LINES_MAX) -> Callable[[str], None]:
    """A log to standard error that goes silent after so many lines, saying so."""
    left = lines_max

    def log(line: str) -> None:
        nonlocal left
        left -= 1
        if left >= 0:
            print(line, file=sys.stderr, flush=True)
        if left == 0:
            print("further messages are counted but not shown", file=sys.stderr, flush=True)

    return log
