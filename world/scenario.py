"""What a hunt is made of: one validated model, read from TOML.

Everything has a default but the start. Unknown keys, values out of range and contradictions are
refused, all of them at once, each with its key and its value. Units are in the names; ticks are
``tick_s`` long.
"""

import json
import tomllib
from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib import resources
from importlib.metadata import entry_points
from math import asin, floor, hypot, pi
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from protocol.parameters import Parameters
from world.targets import behaviour_named, check_parameters

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
Position = tuple[Coordinate, Coordinate]
Length = Annotated[float, Field(gt=0.0, le=1e5, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0.0, le=600.0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Tick = Annotated[int, Field(ge=0, le=10_000_000)]
ROBOTS_MAX = 256
SPACING_BODIES = 1.5
STARTING_GAP_M = 1e-4
SPREAD_MAX = 1e3


class ScenarioError(ValueError):
    """A scenario that cannot be run; the message lists every problem, one per line."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class Placement(_Model):
    """Robots without given positions start at random in an annulus around the target."""

    distance_m_min: Length = 4.0
    distance_m_max: Length = 10.0


class Team(_Model):
    """The robots: how many or where, what bodies they have, how they decide."""

    robots: Annotated[int, Field(ge=1, le=ROBOTS_MAX)] | None = None
    positions: tuple[Position, ...] | None = None
    placement: Placement = Placement()
    strategy: str = "xi-star"
    radius_m: Length = 0.5
    step_m_max: Length = 0.3
    sensing_range_m: Length = 6.0
    motion: Literal["holonomic", "unicycle"] = "holonomic"
    turn_rad_max: Annotated[float, Field(gt=0.0, le=pi)] = pi / 6


class Target(_Model):
    """The target: where it starts, its body, how it behaves."""

    position: Position = (0.0, 0.0)
    behaviour: str = "flee"
    parameters: dict[str, Any] = {}
    heading_rad: Annotated[float, Field(ge=-2 * pi, le=2 * pi)] = 0.0
    radius_m: Length = 0.5
    step_m_max: Length = 0.2
    sensing_range_m: Length = 6.0


class Sensing(_Model):
    """How good the robots' sensors are: detection noise per axis, rays of the scan."""

    noise_m_std: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    rays: Annotated[int, Field(ge=8, le=360)] = 24


class Obstacle(_Model):
    """A fixed disc."""

    position: Position
    radius_m: Length


class MoveTarget(_Model):
    """The target is moved by hand: at ``tick`` it stands at ``position``, or as near as it fits."""

    kind: Literal["move-target"]
    tick: Annotated[int, Field(ge=1)]
    position: Position


class Silence(_Model):
    """A robot's radio is off, both ways, for packets sent from ``tick`` on for ``ticks`` ticks."""

    kind: Literal["silence"]
    tick: Tick
    ticks: Annotated[int, Field(ge=1)]
    robot: str


class Loss(_Model):
    """Loss of packets. For Gilbert-Elliott the probabilities are per packet of a link."""

    model: Literal["none", "bernoulli", "gilbert-elliott"] = "none"
    rate: Probability = 0.0
    good_to_bad: Probability = 0.0
    bad_to_good: Probability = 1.0
    loss_good: Probability = 0.0
    loss_bad: Probability = 1.0


class Delay(_Model):
    """Delay of packets in s; gamma and lognormal by mean and standard deviation."""

    model: Literal["constant", "uniform", "gamma", "lognormal"] = "constant"
    mean_s: Seconds = 0.0
    std_s: Seconds = 0.0
    low_s: Seconds = 0.0
    high_s: Seconds = 0.0


class LinkOverride(_Model):
    """Another loss or delay for the links from ``sender`` to ``receiver``; left out means any."""

    sender: str | None = None
    receiver: str | None = None
    loss: Loss | None = None
    delay: Delay | None = None


class ChannelModel(_Model):
    """The radio between the robots."""

    loss: Loss = Loss()
    delay: Delay = Delay()
    order: Literal["kept", "free"] = "free"
    links: tuple[LinkOverride, ...] = ()


class Capture(_Model):
    """Captured: ``count`` robots within ``stop_distance_m``, no gap between them of pi or more."""

    count: Annotated[int, Field(ge=2)] | None = None
    stop_distance_m: Length = 1.3


class Scenario(_Model):
    """One hunt, complete."""

    title: str = ""
    description: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    tick_s: Annotated[float, Field(ge=1e-4, le=60.0)] = 0.1
    ticks_max: Annotated[int, Field(ge=1, le=1_000_000)] = 600
    team: Team
    target: Target = Target()
    robot: dict[str, Any] = {}
    sensing: Sensing = Sensing()
    obstacles: tuple[Obstacle, ...] = ()
    events: tuple[Annotated[MoveTarget | Silence, Field(discriminator="kind")], ...] = ()
    channel: ChannelModel = ChannelModel()
    capture: Capture = Capture()

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """Robot ids, in robot order: r1, r2, ..."""
        count = len(self.team.positions) if self.team.positions else self.team.robots or 0
        return tuple(f"r{k + 1}" for k in range(count))

    @cached_property
    def capture_count(self) -> int:
        """Robots needed for a capture: all, up to what fits around the target."""
        return self.capture.count or min(len(self.ids), self.fits_around)

    @cached_property
    def fits_around(self) -> int:
        """How many robots fit at the stop distance with half a body's width between neighbours.

        More would fit if they took equal places; robots that hunt do not (``docs/paper.md``).
        """
        half_room = SPACING_BODIES * self.team.radius_m / self.capture.stop_distance_m
        return floor(pi / asin(min(1.0, half_room)))

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """The robots' parameters: those set under ``robot``, and what their bodies are."""
        return {**self.robot, **self._bodies}

    @property
    def _bodies(self) -> dict[str, float]:
        return {
            "radius_m": self.team.radius_m,
            "target_radius_m": self.target.radius_m,
            "step_m_max": self.team.step_m_max,
            "sensing_range_m": self.team.sensing_range_m,
            "stop_distance_m": self.capture.stop_distance_m,
        }

    def problems(self) -> list[str]:
        """Contradictions between values that are each in range; empty if there are none."""
        return [
            *_problems_of_team(self),
            *_problems_of_names(self),
            *_problems_of_channel(self.channel),
            *_overlaps(self),
        ]


def load(source: str | Path | Mapping[str, Any], overrides: Sequence[str] = ()) -> Scenario:
    """A scenario from a shipped name, a TOML file or a mapping, with ``key=value`` overrides.

    Keys are dotted (``channel.loss.rate``), list items by number (``obstacles.0.radius_m``); values
    are TOML, or plain text if they are not. Raises ``ScenarioError`` listing every problem.
    """
    name, tree = _read(source)
    for override in overrides:
        _override(tree, override)
    try:
        scenario = Scenario.model_validate(tree)
    except ValidationError as error:
        lines = [
            f"{'.'.join(_path(e['loc']))} = {_shown(e['input'])}: {_plain(e['msg'])}"
            for e in error.errors()
        ]
        lines += _further_problems(tree, [_path(e["loc"]) for e in error.errors()])
        raise ScenarioError(_listed(name, lines)) from None
    if problems := scenario.problems():
        raise ScenarioError(_listed(name, problems))
    return scenario


def _path(location: Sequence[str | int]) -> list[str]:
    return [str(part) for part in location if part not in EVENT_KINDS]


def _further_problems(tree: dict[str, Any], refused: list[list[str]]) -> list[str]:
    """Contradictions elsewhere in a scenario some of whose values are refused already."""
    rest = {key: value for key, value in tree.items() if [key] not in refused}
    for path in refused:
        table = rest.get(path[0])
        if len(path) > 1 and isinstance(table, dict):
            rest[path[0]] = {key: value for key, value in table.items() if key != path[1]}
    try:
        problems = Scenario.model_validate(rest).problems()
    except ValidationError:
        return []
    touched = {".".join(path[:2]) for path in refused}
    return [
        line
        for line in problems
        # A value that was taken out may itself be what is missing now.
        if "give either" not in line and not any(key in line for key in touched)
    ]


EVENT_KINDS = ("move-target", "silence")


def shipped() -> dict[str, Path]:
    """The scenarios that come with the package, by name."""
    folder = resources.files("world") / "scenarios"
    files = [Path(str(f)) for f in folder.iterdir() if f.name.endswith(".toml")]
    return {path.stem: path for path in sorted(files)}


def _read(source: str | Path | Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    if isinstance(source, Mapping):
        return "scenario", _copied(source)
    known = shipped()
    path = known.get(str(source), Path(source))
    try:
        with open(path, "rb") as file:
            tree = json.load(file) if path.suffix == ".json" else tomllib.load(file)
            return str(source), tree
    except (FileNotFoundError, IsADirectoryError):
        raise ScenarioError(
            f"scenario {str(source)!r} is neither a file nor one of: {', '.join(known)}"
        ) from None
    except ValueError as error:  # tomllib's and json's decode errors, and wrong UTF-8
        raise ScenarioError(f"scenario {str(source)!r} cannot be parsed: {error}") from None
    except OSError as error:
        raise ScenarioError(f"scenario {str(source)!r} cannot be read: {error.strerror}") from None


def _copied(tree: Any) -> Any:
    if isinstance(tree, Mapping):
        return {key: _copied(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_copied(value) for value in tree]
    return tree


def _override(tree: dict[str, Any], override: str) -> None:
    key, separator, text = override.partition("=")
    if not separator or not key:
        raise ScenarioError(
            f"override {override!r}: must be key=value, as in target.step_m_max=0.39"
        )
    try:
        parsed = tomllib.loads(f"value = {text}")
        value = parsed["value"] if len(parsed) == 1 else text
    except tomllib.TOMLDecodeError:
        value = text
    *path, last = key.split(".")
    place: Any = tree
    try:
        for part in path:
            place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
        if isinstance(place, list):
            place[int(last)] = value
        else:
            place[last] = value
    except (ValueError, IndexError, TypeError, AttributeError):
        raise ScenarioError(f"override {override!r}: there is no such key") from None


def _problems_of_team(scenario: Scenario) -> list[str]:
    found = []
    team, placement = scenario.team, scenario.team.placement
    if team.positions is None and team.robots is None:
        found.append("team: give either robots (a number) or positions")
    if team.positions is not None and team.robots not in (None, len(team.positions)):
        found.append(f"team.robots = {team.robots}: but {len(team.positions)} positions are given")
    if team.positions is not None and not 1 <= len(team.positions) <= ROBOTS_MAX:
        found.append(f"team.positions: {len(team.positions)} given, must be 1 to {ROBOTS_MAX}")
    if placement.distance_m_min > placement.distance_m_max:
        found.append(
            f"team.placement.distance_m_min = {placement.distance_m_min}:"
            f" must be at most distance_m_max = {placement.distance_m_max}"
        )
    touching = team.radius_m + scenario.target.radius_m
    if scenario.capture.stop_distance_m < touching:
        found.append(
            f"capture.stop_distance_m = {scenario.capture.stop_distance_m}: bodies of radius"
            f" {team.radius_m} and {scenario.target.radius_m} cannot come closer than {touching}"
        )
    if scenario.capture.count is not None and scenario.capture.count > len(scenario.ids):
        found.append(
            f"capture.count = {scenario.capture.count}: the team has {len(scenario.ids)} robots"
        )
    return found


def _problems_of_names(scenario: Scenario) -> list[str]:
    found = []
    strategies = sorted(e.name for e in entry_points(group="encircle.strategies"))
    if scenario.team.strategy not in strategies:
        found.append(
            f"team.strategy = {scenario.team.strategy!r}: unknown strategy;"
            f" known are: {', '.join(strategies)}"
        )
    try:
        behaviour = behaviour_named(scenario.target.behaviour)
    except ValueError as error:
        found.append(f"target.behaviour = {scenario.target.behaviour!r}: {error}")
    else:
        try:
            check_parameters(behaviour, scenario.target.parameters)
        except ValueError as error:
            found.extend(
                f"target.parameters.{problem} (target.behaviour = {scenario.target.behaviour!r})"
                for problem in str(error).split("; ")
            )
    found += [
        f"robot.{name} = {scenario.robot[name]!r}: belongs under team, target or capture"
        for name in sorted(set(scenario.robot) & set(scenario._bodies))
    ]
    try:
        Parameters.from_mapping(scenario.parameters)
    except ValueError as error:
        found.extend(f"robot.{problem}" for problem in str(error).split("; "))
    for place, event in enumerate(scenario.events):
        if isinstance(event, Silence) and event.robot not in scenario.ids:
            found.append(
                f"events.{place}.robot = {event.robot!r}: robots are {', '.join(scenario.ids)}"
            )
    for place, link in enumerate(scenario.channel.links):
        for end, robot in (("sender", link.sender), ("receiver", link.receiver)):
            if robot is not None and robot not in scenario.ids:
                found.append(
                    f"channel.links.{place}.{end} = {robot!r}: robots are {', '.join(scenario.ids)}"
                )
    return found


def _problems_of_channel(channel: ChannelModel) -> list[str]:
    found = []
    named: list[tuple[str, Delay | Loss]] = [
        ("channel.delay", channel.delay),
        ("channel.loss", channel.loss),
    ]
    for place, link in enumerate(channel.links):
        named.append((f"channel.links.{place}.delay", link.delay or Delay()))
        named.append((f"channel.links.{place}.loss", link.loss or Loss()))
    for key, model in named:
        if isinstance(model, Delay):
            drawn = model.model in ("gamma", "lognormal")
            if drawn and not (model.mean_s > 0.0 and model.std_s > 0.0):
                found.append(f"{key}: {model.model} needs mean_s and std_s above 0")
            elif drawn and not 1 / SPREAD_MAX <= model.std_s / model.mean_s <= SPREAD_MAX:
                found.append(
                    f"{key}.std_s = {model.std_s}: must be from 1/{SPREAD_MAX:g} to"
                    f" {SPREAD_MAX:g} times mean_s = {model.mean_s}"
                )
            if model.model == "uniform" and model.low_s > model.high_s:
                found.append(
                    f"{key}.low_s = {model.low_s}: must be at most high_s = {model.high_s}"
                )
            _unused(found, key, model, DELAY_KEYS[model.model])
        else:
            _unused(found, key, model, LOSS_KEYS[model.model])
    return found


DELAY_KEYS = {
    "constant": {"mean_s"},
    "uniform": {"low_s", "high_s"},
    "gamma": {"mean_s", "std_s"},
    "lognormal": {"mean_s", "std_s"},
}
LOSS_KEYS: dict[str, set[str]] = {
    "none": set(),
    "bernoulli": {"rate"},
    "gilbert-elliott": {"good_to_bad", "bad_to_good", "loss_good", "loss_bad"},
}


def _unused(found: list[str], key: str, model: Delay | Loss, used: set[str]) -> None:
    """A value that its model ignores was surely meant to have an effect."""
    for name in sorted(model.model_fields_set - used - {"model"}):
        value = getattr(model, name)
        if value != type(model).model_fields[name].default:
            found.append(
                f"{key}.{name} = {value}: has no meaning for model {model.model!r},"
                f" which takes {', '.join(sorted(used)) or 'nothing'}"
            )


def _overlaps(scenario: Scenario) -> list[str]:
    bodies = [("target.position", scenario.target.position, scenario.target.radius_m)]
    bodies += [
        (f"team.positions.{k}", position, scenario.team.radius_m)
        for k, position in enumerate(scenario.team.positions or ())
    ]
    fixed = [
        (f"obstacles.{k}.position", o.position, o.radius_m)
        for k, o in enumerate(scenario.obstacles)
    ]
    found = []
    for k, (name, (x, y), radius) in enumerate(bodies):
        for other, (ox, oy), other_radius in [*bodies[:k], *fixed]:
            if hypot(x - ox, y - oy) < radius + other_radius + STARTING_GAP_M:
                found.append(f"{name} = {(x, y)}: overlaps {other} = {(ox, oy)}")
    return found


def _plain(message: str) -> str:
    return "unknown key" if message == "Extra inputs are not permitted" else message


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:80] + "..."


def _listed(name: str, lines: Sequence[str]) -> str:
    many = "one problem" if len(lines) == 1 else f"{len(lines)} problems"
    return "\n".join([f"scenario {name!r} has {many}:", *(f"  {line}" for line in lines)])
