"""What a field of a message may hold: checks of values just unpacked.

A check returns the value, converted if senders may write it in another way, or raises
``ValueError`` with what it must be. What honest senders send is recognised by its types, in a few
passes that run in C, for this is where decoding spends its time.
"""

import math
from collections.abc import Callable
from typing import Any, TypeAlias

from encircle.protocol.keys import is_name
from encircle.protocol.wire.limits import (
    COUNT_MAX,
    LIST_MAX,
    NUMBER_MAX,
    PLACE_MAX,
    RAYS_MAX,
    RAYS_MIN,
    RELAYED_MAX,
    TEXT_MAX,
)

Check: TypeAlias = Callable[[Any], Any]

NAME_SHOWN_MAX = 40
_FLOAT, _STR, _BYTES, _NUMBERS = {float}, {str}, {bytes}, {float, int}
_PLAIN, _HOLDERS = {str, bytes, bool, type(None)}, {dict, tuple}
_SIGHTING = (str, float, float)
_SHORT_NAME_MAX = 32


def number(value: Any) -> float:
    """A finite number, whole ones converted."""
    if type(value) in _NUMBERS and -NUMBER_MAX < value < NUMBER_MAX:
        return float(value)
    raise ValueError(f"a number between -{NUMBER_MAX:g} and {NUMBER_MAX:g}")


def duration(value: Any) -> float:
    """A number above 0."""
    if (seconds := number(value)) > 0.0:
        return seconds
    raise ValueError("a number above 0")


def length(value: Any) -> float:
    """A number of at least 0."""
    if (metres := number(value)) >= 0.0:
        return metres
    raise ValueError("a number of at least 0")


def angle(value: Any) -> float:
    """A number from -pi to pi."""
    if -math.pi <= (radians := number(value)) <= math.pi:
        return radians
    raise ValueError("an angle from -pi to pi")


def count(value: Any) -> int:
    """A whole number that is not negative."""
    if type(value) is int and 0 <= value <= COUNT_MAX:
        return value
    raise ValueError("a whole number of at least 0")


def integer(value: Any) -> int:
    """A whole number."""
    if type(value) is int and abs(value) <= COUNT_MAX:
        return value
    raise ValueError("a whole number")


def text(value: Any) -> str:
    """Text that is not long."""
    if type(value) is str and len(value) <= TEXT_MAX:
        return value
    raise ValueError(f"text of at most {TEXT_MAX} characters")


def boolean(value: Any) -> bool:
    """True or false."""
    if type(value) is bool:
        return value
    raise ValueError("true or false")


def point(value: Any) -> tuple[float, float]:
    """Two numbers: x and y."""
    if type(value) is tuple and len(value) == 2:
        x, y = value
        if type(x) is float and type(y) is float and -NUMBER_MAX < x < NUMBER_MAX > y > -NUMBER_MAX:
            return value  # what honest senders send, without another call
        return number(x), number(y)
    raise ValueError("a pair of numbers")


def scan(value: Any) -> tuple[float, ...]:
    """Lengths, as many as a range scan has rays."""
    # An infinite or NaN entry makes the sum not finite: passes in C instead of a call for each.
    if (
        type(value) is tuple
        and set(map(type, value)) <= _FLOAT
        and RAYS_MIN <= len(value) <= RAYS_MAX
        and math.isfinite(sum(value))
        and min(value) >= 0.0
        and max(value) < NUMBER_MAX
    ):
        return value
    lengths: tuple[float, ...] = _numbers(value)
    if RAYS_MIN <= len(lengths) <= RAYS_MAX and min(lengths) >= 0.0:
        return lengths
    raise ValueError(f"a list of {RAYS_MIN} to {RAYS_MAX} lengths, none below 0")


def texts(value: Any) -> tuple[str, ...]:
    """Texts, not many."""
    if type(value) is tuple and set(map(type, value)) <= _STR and len(value) <= LIST_MAX:
        return value
    raise ValueError(f"a list of at most {LIST_MAX} texts")


def team(value: Any) -> tuple[str, ...]:
    """Names of robots, each once."""
    if len(set(names := texts(value))) == len(names) and all(map(is_name, names)):
        return names
    raise ValueError("a list of robots' names, each once")


def packets(value: Any) -> tuple[bytes, ...]:
    """Byte strings."""
    if type(value) is tuple and set(map(type, value)) <= _BYTES:
        return value
    raise ValueError("a list of bytes")


def sightings(value: Any) -> tuple[tuple[str, float, float], ...]:
    """Robots in sight, each with its position: ``(id, x, y)``."""
    if type(value) is not tuple:
        raise ValueError("a list")
    for item in value:
        if (
            type(item) is not tuple
            or tuple(map(type, item)) != _SIGHTING
            or len(item[0]) > _SHORT_NAME_MAX
        ):
            return tuple([_sighting(sighting) for sighting in value])
        if not (-NUMBER_MAX < item[1] < NUMBER_MAX > item[2] > -NUMBER_MAX):
            raise ValueError("made of a robot's id and two numbers each")
    return value


def _sighting(value: Any) -> tuple[str, float, float]:
    if type(value) is not tuple or len(value) != 3:
        raise ValueError("made of a robot's id and two numbers each")
    return text(value[0]), number(value[1]), number(value[2])


def relayed(value: Any) -> tuple[tuple[str, int, float, float], ...]:
    """Detections by others: ``(origin, tick, x, y)``."""
    if type(value) is not tuple or len(value) > RELAYED_MAX:
        raise ValueError(f"a list of at most {RELAYED_MAX}")
    if are_plain_reports(value):
        return value
    return tuple([_report(report) for report in value])


def are_plain_reports(value: tuple[Any, ...]) -> bool:
    """Whether these are what honest senders relay, with nothing to convert."""
    if len(value) > RELAYED_MAX:
        return False
    for report in value:
        if type(report) is not tuple or len(report) != 4:
            return False
        origin, tick, x, y = report
        if not (
            type(origin) is str
            and type(tick) is int
            and type(x) is type(y) is float
            and -PLACE_MAX < x < PLACE_MAX > y > -PLACE_MAX
            and 0 <= tick <= COUNT_MAX
            and len(origin) <= TEXT_MAX
        ):
            return False
    return True


def _report(value: Any) -> tuple[str, int, float, float]:
    if type(value) is not tuple or len(value) != 4:
        raise ValueError("made of a robot's id, a tick and two numbers each")
    origin, tick, x, y = value
    return text(origin), count(tick), number(x), number(y)


def parameters(value: Any) -> dict[str, Any]:
    """Anything plain by name, nested as it likes."""
    mapping = _map(value)
    for name, part in mapping.items():
        try:
            _check_parameter(part)
        except ValueError as error:
            raise ValueError(f"{error}, under {name[:NAME_SHOWN_MAX]!r}") from None
    return mapping


def _check_parameter(value: Any) -> None:
    waiting: list[Any] = [(value,)]
    while waiting:  # no recursion: a stranger may nest them a thousand deep
        holder = waiting.pop()
        for part in _map(holder).values() if type(holder) is dict else holder:
            if type(part) in _HOLDERS:
                waiting.append(part)
            elif type(part) in _NUMBERS:
                number(part)
            elif type(part) not in _PLAIN:
                raise ValueError("made of numbers, texts, truth values, lists and maps")


def _map(value: Any) -> dict[str, Any]:
    if isinstance(value, dict) and all(type(name) is str for name in value):
        return value
    raise ValueError("a map with string keys")


def optional(check: Check) -> Check:
    """None, or what passes the check."""
    return lambda value: None if value is None else check(value)


def list_of(check: Check, items_min: int = 0, items_max: int | None = None) -> Check:
    """A list whose items each pass the check, as a tuple."""
    most = math.inf if items_max is None else items_max

    def checked(value: Any) -> tuple[Any, ...]:
        if type(value) is not tuple:
            raise ValueError("a list")
        if not items_min <= len(value) <= most:
            raise ValueError(f"a list of {items_min} to {most:g} items")
        return tuple([check(item) for item in value])

    return checked


def row_of(types: str, named_tuple: type[Any] | None, *checks: Check) -> Check:
    """A list of as many items as there are checks, each passing its own.

    The value is a plain tuple, or one of the named kind; the refusal names ``types``.
    """
    make: Callable[[list[Any]], Any] = getattr(named_tuple, "_make", tuple)
    size = len(checks)
    if size == 2 and named_tuple is None:
        return _pair_of(types, *checks)

    def checked(value: Any) -> Any:
        if type(value) is not tuple or len(value) != size:
            raise ValueError(f"made of {types}")
        return make([check(item) for check, item in zip(checks, value, strict=True)])

    return checked


def _pair_of(types: str, first: Check, second: Check) -> Check:
    def checked(value: Any) -> tuple[Any, Any]:
        if type(value) is not tuple or len(value) != 2:
            raise ValueError(f"made of {types}")
        return first(value[0]), second(value[1])

    return checked


def map_of(name_check: Check, value_check: Check) -> Check:
    """A map whose names and values pass their checks."""
    return lambda value: {name_check(name): value_check(item) for name, item in _map(value).items()}


_numbers = list_of(number)
