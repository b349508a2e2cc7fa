"""What each field of a message may hold: checks by the field's name, of values just unpacked.

A check returns the value, converted if senders may write it in another way, or raises
``ValueError`` with what it must be. What honest senders send is recognised by its types, in a few
passes that run in C, for this is where decoding spends its time.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar

from encircle.protocol.keys import is_name
from encircle.protocol.messages import (
    CAUSE_CODE_MAX,
    ENDS,
    FAILED_PREFIX,
    HEARD_MAX,
    RADIOS,
    RAYS_MAX,
    RAYS_MIN,
    REASON_MAX,
    RELAYED_MAX,
    Observation,
    Point,
    Radio,
    Setup,
    State,
    Timing,
)

A = TypeVar("A")
B = TypeVar("B")

TEXT_MAX = 256
LIST_MAX = 256
NAME_SHOWN_MAX = 40
COUNT_MAX = 2**53 - 1
NUMBER_MAX = 1e9
"""Larger numbers are refused: squared and summed they must stay finite and keep their meaning."""
_FLOAT, _STR, _BYTES, _NUMBERS = {float}, {str}, {bytes}, {float, int}
_PLAIN, _HOLDERS = {str, bytes, bool, type(None)}, {dict, tuple}
_SIGHTING = (str, float, float)


def check_of(kind: type[Any], name: str) -> Callable[[Any], Any]:
    """The check of a field of a kind of message."""
    return _BY_KIND.get((kind, name)) or _BY_NAME[name]


def problem_of(message: Any) -> str | None:
    """What fields that are each right for themselves have wrong together; None if nothing."""
    check = _TOGETHER.get(type(message))
    return None if check is None else check(message)


def _number(value: Any) -> float:
    if type(value) in _NUMBERS and -NUMBER_MAX < value < NUMBER_MAX:
        return float(value)
    raise ValueError(f"a number between -{NUMBER_MAX:g} and {NUMBER_MAX:g}")


def _duration(value: Any) -> float:
    if (number := _number(value)) > 0.0:
        return number
    raise ValueError("a number above 0")


def _angle(value: Any) -> float:
    if -math.pi <= (number := _number(value)) <= math.pi:
        return number
    raise ValueError("an angle from -pi to pi")


def _count(value: Any) -> int:
    if type(value) is int and 0 <= value <= COUNT_MAX:
        return value
    raise ValueError("a whole number of at least 0")


def _integer(value: Any) -> int:
    if type(value) is int and abs(value) <= COUNT_MAX:
        return value
    raise ValueError("a whole number")


def _text(value: Any) -> str:
    if type(value) is str and len(value) <= TEXT_MAX:
        return value
    raise ValueError(f"text of at most {TEXT_MAX} characters")


def _reason(value: Any) -> str:
    if value in ENDS or (_text(value).startswith(FAILED_PREFIX) and len(value) <= REASON_MAX):
        return str(value)
    raise ValueError(
        f"{', '.join(ENDS)}, or {FAILED_PREFIX!r} and why, {REASON_MAX} characters in all"
    )


def _truth(value: Any) -> bool:
    if type(value) is bool:
        return value
    raise ValueError("true or false")


def _point(value: Any) -> Point:
    if type(value) is tuple and len(value) == 2:
        x, y = value
        if type(x) is float and type(y) is float and -NUMBER_MAX < x < NUMBER_MAX > y > -NUMBER_MAX:
            return value  # what honest senders send, without another call
        return _number(x), _number(y)
    raise ValueError("a pair of numbers")


def _scan(value: Any) -> tuple[float, ...]:
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
    lengths = _numbers(value)
    if RAYS_MIN <= len(lengths) <= RAYS_MAX and min(lengths) >= 0.0:
        return lengths
    raise ValueError(f"a list of {RAYS_MIN} to {RAYS_MAX} lengths, none below 0")


def _texts(value: Any) -> tuple[str, ...]:
    if type(value) is tuple and set(map(type, value)) <= _STR and len(value) <= LIST_MAX:
        return value
    raise ValueError(f"a list of at most {LIST_MAX} texts")


def _team(value: Any) -> tuple[str, ...]:
    if len(set(names := _texts(value))) == len(names) and all(map(is_name, names)):
        return names
    raise ValueError("a list of robots' names, each once")


def _packets(value: Any) -> tuple[bytes, ...]:
    if type(value) is tuple and set(map(type, value)) <= _BYTES:
        return value
    raise ValueError("a list of bytes")


def _seen(value: Any) -> tuple[tuple[str, float, float], ...]:
    if type(value) is not tuple:
        raise ValueError("a list")
    for item in value:
        if type(item) is not tuple or tuple(map(type, item)) != _SIGHTING or len(item[0]) > 32:
            return tuple([_sighting(sighting) for sighting in value])
        if not (-NUMBER_MAX < item[1] < NUMBER_MAX > item[2] > -NUMBER_MAX):
            raise ValueError("made of a robot's id and two numbers each")
    return value


def _sighting(value: Any) -> tuple[str, float, float]:
    if type(value) is not tuple or len(value) != 3:
        raise ValueError("made of a robot's id and two numbers each")
    return _text(value[0]), _number(value[1]), _number(value[2])


def _relayed(value: Any) -> tuple[tuple[str, int, float, float], ...]:
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
            and -NUMBER_MAX < x < NUMBER_MAX > y > -NUMBER_MAX
            and 0 <= tick <= COUNT_MAX
            and len(origin) <= TEXT_MAX
        ):
            return False
    return True


def _report(value: Any) -> tuple[str, int, float, float]:
    if type(value) is not tuple or len(value) != 4:
        raise ValueError("made of a robot's id, a tick and two numbers each")
    origin, tick, x, y = value
    return _text(origin), _count(tick), _number(x), _number(y)


def _parameters(value: Any) -> dict[str, Any]:
    mapping = _map(value)
    for name, part in mapping.items():
        try:
            _parameter(part)
        except ValueError as error:
            raise ValueError(f"{error}, under {name[:NAME_SHOWN_MAX]!r}") from None
    return mapping


def _parameter(value: Any) -> None:
    waiting: list[Any] = [(value,)]
    while waiting:  # no recursion: a stranger may nest them a thousand deep
        holder = waiting.pop()
        for part in _map(holder).values() if type(holder) is dict else holder:
            if type(part) in _HOLDERS:
                waiting.append(part)
            elif type(part) in _NUMBERS:
                _number(part)
            elif type(part) not in _PLAIN:
                raise ValueError("made of numbers, texts, truth values, lists and maps")


def _map(value: Any) -> dict[str, Any]:
    if type(value) is dict and all(type(name) is str for name in value):
        return value
    raise ValueError("a map with string keys")


def _counts(value: Any) -> dict[str, int]:
    return {_text(name): _count(number) for name, number in _map(value).items()}


def _radio(value: Any) -> str:
    if value in RADIOS:
        return str(value)
    raise ValueError(f"one of {', '.join(RADIOS)}")


def _timing(value: Any) -> Timing:
    if type(value) is not tuple or len(value) != 3 or type(value[2]) is not tuple:
        raise ValueError("two times in us and a list")
    if len(value[2]) > HEARD_MAX:
        raise ValueError(f"at most {HEARD_MAX} messages heard")
    return _count(value[0]), _count(value[1]), tuple([_heard(item) for item in value[2]])


def _heard(value: Any) -> tuple[str, int, int]:
    if type(value) is not tuple or len(value) != 3:
        raise ValueError("made of a sender, a number and a time in us each")
    return _text(value[0]), _count(value[1]), _count(value[2])


def _optional(check: Callable[[Any], A]) -> Callable[[Any], A | None]:
    return lambda value: None if value is None else check(value)


def _many(check: Callable[[Any], A]) -> Callable[[Any], tuple[A, ...]]:
    def checked(value: Any) -> tuple[A, ...]:
        if type(value) is not tuple:
            raise ValueError("a list")
        return tuple([check(item) for item in value])

    return checked


def _pair(first: Callable[[Any], A], second: Callable[[Any], B]) -> Callable[[Any], tuple[A, B]]:
    def checked(value: Any) -> tuple[A, B]:
        if type(value) is not tuple or len(value) != 2:
            raise ValueError("a list of two")
        return first(value[0]), second(value[1])

    return checked


_numbers = _many(_number)

_BY_NAME: dict[str, Callable[[Any], Any]] = {
    "robot": _text,
    "tick": _count,
    "sequence": _count,
    "tick_s": _duration,
    "strategy": _text,
    "parameters": _parameters,
    "position": _point,
    "velocity": _point,
    "step": _point,
    "heading_rad": _angle,
    "headings_rad": _many(_angle),
    "target": _point,
    "detection": _optional(_point),
    "goal": _optional(_point),
    "estimate": _optional(_point),
    "scan": _scan,
    "seen": _seen,
    "inbox": _packets,
    "lost": _texts,
    "sent_us": _optional(_count),
    "admitted": _optional(_many(_pair(_text, _count))),
    "answered": _optional(_count),
    "timing": _optional(_timing),
    "radio": _radio,
    "first_tick": _count,
    "answer_tick": _count,
    "mode": _text,
    "xi": _optional(_number),
    "point": _optional(_count),
    "predictor": _optional(_text),
    "team": _texts,
    "relayed": _relayed,
    "published": _truth,
    "refused": _counts,
    "reason": _reason,
    "robots": _many(_point),
    "captured": _truth,
    "contacts": _many(_pair(_text, _text)),
    "fates": _many(_many(_integer)),
    "copies": _many(_many(_integer)),
}
_BY_KIND: dict[tuple[type[Any], str], Callable[[Any], Any]] = {
    (Observation, "target"): _optional(_point),
    (Setup, "team"): _team,
}


def _together_setup(setup: Setup) -> str | None:
    if setup.answer_tick >= setup.first_tick:
        return None
    return f"answer_tick is {setup.answer_tick}, must be first_tick ({setup.first_tick}) or later"


def _together_state(state: State) -> str | None:
    count, headings = len(state.robots), len(state.headings_rad)
    return None if count == headings else f"headings_rad has {headings} for {count} robots"


def _together_radio(radio: Radio) -> str | None:
    """Squares of one size; what is delivered is so after it was sent."""
    count, tick = len(radio.fates), radio.tick
    for name, table in (("fates", radio.fates), ("copies", radio.copies)):
        if table == () and name == "copies":
            continue
        if [len(row) for row in table] != [count] * count or any(table[k][k] for k in range(count)):
            return f"{name} must be {count} rows of {count}, 0 from a robot to itself"
        lowest = 0 if name == "copies" else -CAUSE_CODE_MAX
        if not all(lowest <= fate <= 0 or fate > tick for row in table for fate in row):
            return f"{name} must be ticks after {tick}, or {lowest} to 0"
    for sent, copied in zip(radio.fates, radio.copies, strict=False):
        if any(copy and not fate for fate, copy in zip(sent, copied, strict=True)):
            return "copies of a packet that was not sent"
    return None


_TOGETHER: dict[type[Any], Callable[[Any], str | None]] = {
    Setup: _together_setup,
    State: _together_state,
    Radio: _together_radio,
}
