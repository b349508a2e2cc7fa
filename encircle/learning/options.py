"""The options of an environment, checked: an error names option, value and what it must be."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict

from encircle.learning.acting import PAYLOAD_MAX
from encircle.learning.rewards import Reward
from encircle.protocol.errors import did_you_mean

RENDER_MODES = ("rgb_array",)


class Options(TypedDict, total=False):
    """What ``parallel_env`` takes beside a scenario; there it says what each means."""

    agents: Sequence[str] | None
    payload: int
    scan: bool
    searches: bool
    reward: Reward | Mapping[str, float] | None
    render_mode: str | None


@dataclass(frozen=True, slots=True)
class Settings:
    """Options that are in order, all of them. ``agents``: in robot order."""

    agents: tuple[str, ...]
    payload: int
    scan: bool
    searches: bool
    reward: Reward
    render_mode: str | None


def settings_of(options: Options, team: Sequence[str]) -> Settings:
    """The settings that options for a team come to; ``ValueError`` for one that makes no sense."""
    known = tuple(Options.__annotations__)
    for name, value in options.items():
        if name not in known:
            raise ValueError(
                f"{name} = {value!r}: unknown option{did_you_mean(name, known)};"
                f" known are: {', '.join(known)}"
            )
    payload, render_mode = options.get("payload", 0), options.get("render_mode")
    if type(payload) is not int or not 0 <= payload <= PAYLOAD_MAX:
        raise ValueError(f"payload = {payload!r}: must be a whole number from 0 to {PAYLOAD_MAX}")
    if render_mode is not None and render_mode not in RENDER_MODES:
        modes = ", ".join(RENDER_MODES)
        raise ValueError(f"render_mode = {render_mode!r}: must be None or {modes}")
    return Settings(
        agents_of(options.get("agents"), team),
        payload,
        _flag("scan", options.get("scan", False)),
        _flag("searches", options.get("searches", True)),
        reward_of(options.get("reward")),
        render_mode,
    )


def agents_of(wanted: Sequence[str] | None, team: Sequence[str]) -> tuple[str, ...]:
    """The agents in robot order; ``ValueError`` for one that is no robot, or for none."""
    if wanted is None:
        return tuple(team)
    asked = [wanted] if isinstance(wanted, str) else list(wanted)
    for agent in asked:
        if agent not in team:
            hint = did_you_mean(str(agent), team)
            raise ValueError(f"agents: {agent!r} is no robot{hint}; they are: {', '.join(team)}")
    if not asked:
        raise ValueError(f"agents = {wanted!r}: must name one robot of {', '.join(team)} at least")
    return tuple([robot for robot in team if robot in asked])


def reward_of(given: Reward | Mapping[str, float] | None) -> Reward:
    """The weights; ``ValueError`` for an unknown one, and as of ``Reward``."""
    if given is None or isinstance(given, Reward):
        return given or Reward()
    known = Reward.__slots__
    for name, value in given.items():
        if name not in known:
            hint = did_you_mean(name, known)
            raise ValueError(
                f"reward.{name} = {value!r}: unknown weight{hint}; known are: {', '.join(known)}"
            )
    return Reward(**given)


def _flag(name: str, value: bool) -> bool:
    if type(value) is not bool:
        raise ValueError(f"{name} = {value!r}: must be True or False")
    return value
