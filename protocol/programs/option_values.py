"""What the text of an option stands for: readers of values, for ``Options``.

A reader returns the value, or raises ``argparse.ArgumentTypeError`` with what is wrong with the
text.
"""

import argparse
import math
from collections.abc import Callable, Collection

from encircle.protocol.errors import did_you_mean
from encircle.protocol.keys import check_name

YES, NO = ("1", "yes", "true", "on"), ("0", "no", "false", "off")
S_MAX = 86_400.0
PACE_MIN, PACE_MAX = 0.01, 1000.0


def seconds(value: str) -> float:
    """A length of time, in s; more than 0 and at most ``S_MAX``."""
    try:
        length_s = float(value)
    except ValueError:
        length_s = math.nan
    if not 0.0 < length_s <= S_MAX:
        raise argparse.ArgumentTypeError(f"{value!r} is not a number of seconds up to {S_MAX:g}")
    return length_s


def pace(value: str) -> float:
    """How many times faster than real time; from ``PACE_MIN`` to ``PACE_MAX``."""
    try:
        factor = float(value)
    except ValueError:
        factor = math.nan
    if not PACE_MIN <= factor <= PACE_MAX:
        raise argparse.ArgumentTypeError(
            f"{value!r} is not a number from {PACE_MIN:g} to {PACE_MAX:g}"
        )
    return factor


def whole_number(value: str) -> int:
    """A whole number of either sign."""
    try:
        return int(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{value!r} is not a whole number") from None


def whole_number_in(least: int, most: int | None = None) -> Callable[[str], int]:
    """A reader of whole numbers from ``least`` to ``most``, both included."""
    limits = f"of at least {least}" if most is None else f"from {least} to {most}"

    def read(value: str) -> int:
        number = whole_number(value)
        if number < least or (most is not None and number > most):
            raise argparse.ArgumentTypeError(f"{value!r} is not a whole number {limits}")
        return number

    return read


def one_of(known: Collection[str]) -> Callable[[str], str]:
    """A reader of one of several words."""

    def read(value: str) -> str:
        if value not in known:
            raise argparse.ArgumentTypeError(
                f"{value!r} is not one of {', '.join(known)}{did_you_mean(value, known)}"
            )
        return value

    return read


def name_of(kind: str) -> Callable[[str], str]:
    """A reader of the name of a run or a robot."""

    def read(value: str) -> str:
        try:
            return check_name(kind, value)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read


def yes_or_no(value: str) -> bool:
    """A reader of whether a flag is set, for its environment variable."""
    if value.lower() not in (*YES, *NO):
        raise argparse.ArgumentTypeError(f"{value!r} is not one of {', '.join((*YES, *NO))}")
    return value.lower() in YES
