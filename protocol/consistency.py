"""What fields that are each right for themselves have wrong together."""

from collections.abc import Callable, Iterable
from typing import Any

from encircle.protocol.messages import CAUSE_CODE_MAX, Observation, Pose, Radio, Setup, State
from encircle.protocol.wire.limits import PLACE_MAX
from encircle.protocol.wire.target_estimate import is_sound


def problem_of(message: Any) -> str | None:
    """What the fields of a message have wrong together; None if nothing."""
    check = _CHECKS.get(type(message))
    return None if check is None else check(message)


def _problem_of_setup(setup: Setup) -> str | None:
    if setup.answer_tick >= setup.first_tick:
        return None
    return f"answer_tick is {setup.answer_tick}, must be first_tick ({setup.first_tick}) or later"


def _problem_of_observation(observation: Observation) -> str | None:
    """Whoever decides on it must be able to calculate with it."""
    return (
        _misplaced("position", observation.position)
        or _misplaced("target", observation.target or ())
        or _misplaced("seen", [number for _, *place in observation.seen for number in place])
    )


def _misplaced(what: str, numbers: Iterable[float]) -> str | None:
    """What is wrong with places in m or velocities in m/s, None if nothing."""
    for number in numbers:
        if abs(number) > PLACE_MAX:
            return f"{what} has {number:g}, must be from {-PLACE_MAX:g} to {PLACE_MAX:g}"
    return None


def _problem_of_pose(pose: Pose) -> str | None:
    """As an observation, and what is wrong with its estimate."""
    problem = (
        _misplaced("position", pose.position)
        or _misplaced("velocity", pose.velocity)
        or _misplaced("detection", pose.detection or ())
        or _misplaced("relayed", [number for _, _, *place in pose.relayed for number in place])
        or _misplaced("estimate", () if pose.estimate is None else pose.estimate[1:5])
    )
    return problem or _problem_of_estimate(pose)


def _problem_of_estimate(pose: Pose) -> str | None:
    """It is made of detections of its tick or earlier, and can be fused with others."""
    estimate = pose.estimate
    if estimate is None:
        return None
    if estimate.detected_tick > pose.tick:
        return (
            f"estimate holds a detection of tick {estimate.detected_tick}, must be of tick"
            f" {pose.tick} or earlier"
        )
    if is_sound((estimate.p00, estimate.p01, estimate.p11)):
        return None
    return (
        f"estimate has the covariance {estimate.p00:g}, {estimate.p01:g}, {estimate.p11:g}, must be"
        " positive definite"
    )


def _problem_of_state(state: State) -> str | None:
    count, headings = len(state.robots), len(state.headings_rad)
    return None if count == headings else f"headings_rad has {headings} for {count} robots"


def _problem_of_radio(radio: Radio) -> str | None:
    """Squares of one size; delivery is after sending; only what was sent is copied."""
    count, tick = len(radio.fates), radio.tick
    for name, table in (("fates", radio.fates), ("copies", radio.copies)):
        if table == () and name == "copies":
            continue
        if [len(row) for row in table] != [count] * count or any(table[k][k] for k in range(count)):
            return f"{name} must be {count} rows of {count}, 0 from a robot to itself"
        lowest = 0 if name == "copies" else -CAUSE_CODE_MAX
        if not all(lowest <= fate <= 0 or fate > tick for row in table for fate in row):
            return f"{name} must be ticks after {tick}, or {lowest} to 0"
    for fates, copies in zip(radio.fates, radio.copies, strict=False):
        if any(copy and not fate for fate, copy in zip(fates, copies, strict=True)):
            return "copies of a packet that was not sent"
    return None


_CHECKS: dict[type[Any], Callable[[Any], str | None]] = {
    Observation: _problem_of_observation,
    Pose: _problem_of_pose,
    Setup: _problem_of_setup,
    State: _problem_of_state,
    Radio: _problem_of_radio,
}
