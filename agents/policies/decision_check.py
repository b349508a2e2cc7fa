"""What a policy may answer: checked at once, since policies are other people's code.

A step that is not finite, or a value that no message can hold, would otherwise fail later and
elsewhere, where nothing shows which policy it came from.
"""

from typing import Any

from encircle.agents.policies.interface import Decision
from encircle.protocol.messages import CommandMode
from encircle.protocol.plugins import InvalidPluginResult, pair_of_m, shown
from encircle.protocol.wire.limits import COUNT_MAX, NUMBER_MAX, TEXT_MAX
from encircle.protocol.wire.payload import FrozenMap, payload

_KEPT_MODES = tuple(map(str, CommandMode))


def validated(answer: Any) -> tuple[Any, Decision]:
    """What a policy remembers and its decision, numbers as plain ones, what it says frozen.

    ``InvalidPluginResult`` if the answer is no such pair.
    """
    if type(answer) is not tuple or len(answer) != 2 or not isinstance(answer[1], Decision):
        raise InvalidPluginResult(
            f"{shown(answer)}: must be what it remembers, and a Decision (encircle.Decision)"
        )
    memory, (mode, step, goal, xi, point, predictor, say) = answer
    _check_text("mode", mode)
    if mode in _KEPT_MODES:
        raise InvalidPluginResult(
            f"mode = {mode!r}: is kept for commands that no policy has decided on"
        )
    if predictor is not None:
        _check_text("predictor", predictor)
    if say is None and _is_plain(step, goal, xi, point):
        return memory, answer[1]
    return memory, Decision(
        mode,
        pair_of_m("step", step),
        pair_of_m("goal", goal),
        xi if xi is None else _prediction_step(xi),
        point if point is None else _point(point),
        predictor,
        None if say is None else _payload(say),
    )


def _is_plain(step: Any, goal: Any, xi: Any, point: Any) -> bool:
    """Whether the numbers are as they are to be, as most are; else it takes a longer look."""
    if not (type(step) is type(goal) is tuple and len(step) == len(goal) == 2):
        return False
    (x, y), (goal_x, goal_y) = step, goal
    return (
        type(x) is type(y) is type(goal_x) is type(goal_y) is float
        # NaN is not between anything.
        and -NUMBER_MAX < x < NUMBER_MAX > y > -NUMBER_MAX
        and -NUMBER_MAX < goal_x < NUMBER_MAX > goal_y > -NUMBER_MAX
        and (xi is None or (type(xi) is float and -NUMBER_MAX < xi < NUMBER_MAX))
        and (point is None or (type(point) is int and 0 <= point <= COUNT_MAX))
    )


def _payload(say: Any) -> FrozenMap:
    try:
        return payload(say)
    except ValueError as error:
        raise InvalidPluginResult(f"say = {shown(say)}: must be {error}") from None


def _check_text(name: str, value: Any) -> None:
    if type(value) is str and len(value) <= TEXT_MAX and (value.isascii() or _is_encodable(value)):
        return
    raise InvalidPluginResult(
        f"{name} = {shown(value)}: must be text of at most {TEXT_MAX} characters"
    )


def _is_encodable(text: str) -> bool:
    """Whether it can be encoded: half of a surrogate pair cannot be."""
    return text.encode(errors="replace").decode() == text


def _prediction_step(xi: Any) -> float:
    try:
        number = float(xi)
    except (TypeError, ValueError, OverflowError):
        number = NUMBER_MAX
    if isinstance(xi, str) or not -NUMBER_MAX < number < NUMBER_MAX:
        raise InvalidPluginResult(f"xi = {shown(xi)}: must be a prediction step, or None")
    return number


def _point(point: Any) -> int:
    try:
        number = point.__index__()
    except (AttributeError, TypeError):
        number = -1
    if isinstance(point, bool) or not 0 <= number <= COUNT_MAX:
        raise InvalidPluginResult(
            f"point = {shown(point)}: must be the number of a point from 0 on, or None"
        )
    return int(number)
