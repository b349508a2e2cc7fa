"""What a hunt is made of: one validated model, read from TOML.

Everything has a default but the start. Unknown keys, values out of range and contradictions are
refused, all of them at once, each with its key and its value. Units are in the names; ticks are
``tick_s`` long.
"""

import json
from collections.abc import Mapping
from functools import cached_property
from importlib import import_module
from math import asin, floor, pi
from typing import Annotated, Any, Literal

from pydantic import Field

from encircle.protocol.messages import PoseCarrier
from encircle.protocol.parameters import Unit
from encircle.world.scenario.channel_events import DelayChange, Heal, LossChange, RangeChange
from encircle.world.scenario.channel_model import (
    ChannelModel,
    Crash,
    Outage,
    Partition,
    Silence,
)
from encircle.world.scenario.fields import SEED_END, Deviation, Length, Model, Position
from encircle.world.scenario.robots_table import RobotOverride, Robots, RobotsTable

SPACING_BODIES = 1.5
DIGEST_VERSION = 3
"""Version of what the digest of a run is made of; it need not change with that of the wire."""
AS_THE_TEAM = RobotOverride()


class Placement(Model):
    """Robots without given positions start at random in an annulus around the target."""

    distance_m_min: Length = 4.0
    """Inner radius of the annulus."""
    distance_m_max: Length = 10.0
    """Outer radius of the annulus."""


class Team(Model):
    """The robots: how many or where, what bodies they have, how they decide."""

    robots: Robots = None
    """Number of robots, or a table if single robots are different; it or ``positions`` must be
    given."""
    positions: tuple[Position, ...] | None = None
    """Where each robot starts; at random (``placement``) if left out."""
    jitter_m: Deviation = 0.0
    """Each given start is moved by up to this along each axis, by seed."""
    placement: Placement = Placement()
    """Where robots without given positions start."""
    strategy: str = "xi-star"
    """Name of the robots' policy: a shipped one, that of an installed plug-in, or
    ``path/file.py:function``."""
    policy_parameters: dict[str, Any] = Field(default_factory=dict)
    """The policy's own parameters."""
    radius_m: Length = 0.5
    """Radius of a robot's body."""
    step_m_max: Length = 0.3
    """The longest step of a robot in a tick."""
    sensing_range_m: Length = 6.0
    """How far a robot detects the target, obstacles and other robots."""
    hold_ticks_max: Annotated[int, Field(ge=0, le=1000), Unit("ticks")] = 5
    """In real time, how long a robot without a new command repeats its last step."""
    motion: Literal["holonomic", "unicycle"] = "holonomic"
    """Whether robots step in any direction, or only forwards after a limited turn."""
    turn_rad_max: Annotated[float, Field(gt=0.0, le=pi), Unit("rad")] = pi / 6
    """The largest turn of a unicycle in a tick."""

    @property
    def count(self) -> int | None:
        """The number of robots as given by ``robots``, None if it is not."""
        return self.robots.count if isinstance(self.robots, RobotsTable) else self.robots

    @property
    def overrides(self) -> Mapping[str, RobotOverride]:
        """What is different about single robots, by id."""
        return self.robots.overrides if isinstance(self.robots, RobotsTable) else {}


class Target(Model):
    """The target: where it starts, its body, how it behaves."""

    position: Position = (0.0, 0.0)
    """Where the target starts."""
    behaviour: str = "flee"
    """Name of the target's behaviour: a shipped one or that of an installed plug-in."""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """The behaviour's own parameters."""
    heading_rad: Annotated[float, Field(ge=-2 * pi, le=2 * pi), Unit("rad")] = 0.0
    """Its heading before its first step."""
    radius_m: Length = 0.5
    """Radius of its body."""
    step_m_max: Length = 0.2
    """Its longest step in a tick."""
    sensing_range_m: Length = 6.0
    """How far it detects robots and obstacles."""


class Sensing(Model):
    """How good the robots' sensors are."""

    noise_m_std: Annotated[float, Field(ge=0.0, le=100.0), Unit("m")] = 0.0
    """Standard deviation of a detection of the target, per axis."""
    localisation_noise_m_std: Annotated[float, Field(ge=0.0, le=100.0), Unit("m")] = 0.0
    """Standard deviation of a robot's own position, per axis, drawn anew at each tick. All that it
    senses is shifted by the same error."""
    localisation_drift_m_per_sqrt_s: Annotated[
        float, Field(ge=0.0, le=100.0), Unit("m/sqrt(s)")
    ] = 0.0
    """Drift of a robot's own position, per axis: after a time t, its standard deviation is this
    times the square root of t. It adds to the noise."""
    rays: Annotated[int, Field(ge=8, le=360)] = 24
    """Number of rays of a range scan, equally spaced."""


class Obstacle(Model):
    """A fixed disc."""

    position: Position
    """Its centre."""
    radius_m: Length
    """Its radius."""


class MoveTarget(Model):
    """The target is moved by hand, to a position or as near to it as it fits."""

    kind: Literal["move-target"]
    """The kind of event."""
    tick: Annotated[int, Field(ge=1), Unit("tick")]
    """The tick at which it stands there."""
    position: Position
    """Where it is moved to."""


Event = Annotated[
    MoveTarget
    | Silence
    | Outage
    | Partition
    | Heal
    | LossChange
    | DelayChange
    | RangeChange
    | Crash,
    Field(discriminator="kind"),
]
"""What can happen at a tick: it stands in a scenario, or is given while the run goes on."""


class Capture(Model):
    """Captured: ``count`` robots within ``stop_distance_m``, no gap between them of pi or more."""

    count: Annotated[int, Field(ge=2)] | None = None
    """Robots that a capture takes; all, up to what fits around the target, if left out."""
    stop_distance_m: Length = 1.3
    """How near to the target's centre a robot's centre must be; robots go no nearer."""


class Scenario(Model):
    """One hunt, complete."""

    title: str = ""
    """A title for people."""
    description: str = ""
    """A description for people."""
    seed: Annotated[int, Field(ge=0, lt=SEED_END)] = 1
    """Seed of every random draw."""
    tick_s: Annotated[float, Field(ge=1e-4, le=60.0), Unit("s")] = 0.1
    """Length of a tick."""
    ticks_max: Annotated[int, Field(ge=1, le=1_000_000), Unit("ticks")] = 600
    """When the run ends if there is no capture."""
    team: Team
    """The robots."""
    target: Target = Target()
    """The target."""
    robot: dict[str, Any] = Field(default_factory=dict)
    """The robots' parameters, the same for all robots."""
    sensing: Sensing = Sensing()
    """How good the robots' sensors are."""
    obstacles: tuple[Obstacle, ...] = ()
    """Fixed discs."""
    events: tuple[Event, ...] = ()
    """What happens at given ticks."""
    channel: ChannelModel = ChannelModel()
    """The radio between the robots."""
    radio: Literal["world", "direct"] = "world"
    """Whether poses pass through the world or, by the wall clock only, from robot to robot."""
    clock: Literal["lockstep", "wall"] = "lockstep"
    """Whether a tick ends when all robots have answered, or at a time (in real time)."""
    capture: Capture = Capture()
    """What a capture is."""

    def _repr_html_(self) -> str:
        # Notebooks ask for it. By name, as the room is not one that the world may know.
        view = import_module("encircle.notebook.scenario_view")
        html: str = view.scenario_html(self)
        return html

    @property
    def is_direct(self) -> bool:
        """Whether robots send their poses to each other, and not through the world."""
        return PoseCarrier(self.radio) is PoseCarrier.DIRECT

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """Robot ids, in robot order: r1, r2, ..."""
        count = len(self.team.positions) if self.team.positions else self.team.count or 0
        return tuple(f"r{k + 1}" for k in range(count))

    @cached_property
    def capture_count(self) -> int:
        """Robots needed for a capture: all, up to what fits around the target."""
        return self.capture.count or min(len(self.ids), self.fits_around)

    @cached_property
    def fits_around(self) -> int:
        """How many robots fit at the stop distance with half a body's width between neighbours.

        More would fit if they stood at equal gaps; robots that hunt do not (``docs/paper.md``).
        """
        half_room = SPACING_BODIES * self.team.radius_m / self.capture.stop_distance_m
        return floor(pi / asin(min(1.0, half_room)))

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """The team's parameters: those set under ``robot``, and those of the bodies."""
        return {**self.robot, **self.bodies}

    def with_event(self, event: Any) -> "Scenario":
        """The same with one event more, the last; it is not checked against the rest."""
        return self.model_copy(update={"events": (*self.events, event)})

    def override_of(self, robot: str) -> RobotOverride:
        """What is different about one robot."""
        return self.team.overrides.get(robot, AS_THE_TEAM)

    def strategy_of(self, robot: str) -> str:
        """Name of a robot's policy."""
        own = self.override_of(robot).strategy
        return self.team.strategy if own is None else own

    def policy_parameters_of(self, robot: str) -> dict[str, Any]:
        """The own parameters of a robot's policy: the team's with the robot's in place.

        Of a robot whose policy is another than the team's, only the robot's.
        """
        is_as_team = self.strategy_of(robot) == self.team.strategy
        of_team = self.team.policy_parameters if is_as_team else {}
        return {**of_team, **(self.override_of(robot).policy_parameters or {})}

    def parameters_of(self, robot: str) -> dict[str, Any]:
        """A robot's parameters: the team's, with its own body in place."""
        own = self.override_of(robot)
        bodies = {"step_m_max": own.step_m_max, "sensing_range_m": own.sensing_range_m}
        return {**self.parameters, **{k: v for k, v in bodies.items() if v is not None}}

    @property
    def bodies(self) -> dict[str, float]:
        """The team's parameters that follow from team, target and capture (``BODIES``)."""
        return {
            "radius_m": self.team.radius_m,
            "target_radius_m": self.target.radius_m,
            "step_m_max": self.team.step_m_max,
            "sensing_range_m": self.team.sensing_range_m,
            "stop_distance_m": self.capture.stop_distance_m,
        }


def digest_header(scenario: Scenario, seed: int) -> str:
    """What the digest of a run begins with: its configuration, as JSON.

    Values at their defaults are left out, so that keys of a later version change no digest.
    """
    texts = {"title", "description", "seed"}
    changed = scenario.model_dump(mode="json", exclude=texts, exclude_defaults=True)
    return json.dumps(
        {"version": DIGEST_VERSION, "seed": seed, "scenario": changed}, sort_keys=True
    )
