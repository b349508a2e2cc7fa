"""Checks of an observation against the robot that receives it, its team and its run.

The codec has checked each field by itself. Positions of bodies are not checked: there is nothing to
compare them with.
"""

from collections.abc import Sequence

from encircle.agents.brain.brain import RobotConfig, indices_of
from encircle.protocol.messages import QUANTUM_M, Observation, PoseCarrier, Setup


def problem_of(observation: Observation, setup: Setup, config: RobotConfig) -> str | None:
    """What is wrong with an observation for a robot that has had a setup; None if nothing."""
    problem = None
    if observation.seen:
        problem = _misnamed("seen", [name for name, _, _ in observation.seen], config)
    if observation.lost and problem is None:
        problem = _misnamed("lost", observation.lost, config)
    if problem is not None:
        return problem
    farthest_m, range_m = max(observation.scan, default=0.0), config.parameters.sensing_range_m
    # A scan of the range itself may have been rounded up to the next quantum.
    if farthest_m > range_m + QUANTUM_M:
        return f"scan of {farthest_m:g} m, must be at most {range_m:g} m"
    if observation.sent_us is not None:
        return _problem_by_clock(observation, setup, config)
    if observation.admitted is not None or observation.answered is not None:
        return "admitted and answered must be null where sent_us is"
    return None


def _problem_by_clock(observation: Observation, setup: Setup, config: RobotConfig) -> str | None:
    answered, admitted = observation.answered, observation.admitted
    if answered is not None and not setup.first_tick <= answered < observation.tick:
        return f"answered {answered}, must be from {setup.first_tick} to {observation.tick - 1}"
    if admitted is not None and setup.radio != PoseCarrier.DIRECT:
        return f"admitted must be null where the radio is {setup.radio!r}"
    return _misnamed("admitted", [sender for sender, _ in admitted or ()], config, ordered=False)


def _misnamed(
    what: str, names: Sequence[str], config: RobotConfig, ordered: bool = True
) -> str | None:
    """Whether these are peers of the team, and if ``ordered`` each once and in robot order."""
    indices, before = indices_of(config.team), -1
    known = [indices.get(name, -1) for name in names]
    if -1 not in known and config.own not in known and known == sorted(set(known)):
        return None
    for name in names:
        index = indices.get(name)
        if index is None or name == config.robot:
            return f"{what} {name!r}, must be a peer of this team"
        if ordered and index <= before:
            return f"{what} {name!r}: must be each once, in robot order"
        before = index
    return None
