"""What a hunt is made of: one validated model, read from TOML.

Everything has a default but the start. Unknown keys, values out of range and contradictions are
refused, all of them at once, each with its key and its value. Units are in the names; ticks are
``tick_s`` long.
"""

import json
from functools import cached_property
from math import asin, floor, pi
from typing import Annotated, Any, Literal

from pydantic import Field

from encircle.protocol import VERSION
from encircle.world.scenario.channel_model import (
    ChannelModel,
    Crash,
    Outage,
    Partition,
    Silence,
)
from encircle.world.scenario.fields import ROBOTS_MAX, Length, Model, Position

SPACING_BODIES = 1.5


class Placement(Model):
    """Robots without given positions start at random in an annulus around the target."""

    distance_m_min: Length = 4.0
    distance_m_max: Length = 10.0


class Team(Model):
    """The robots: how many or where, what bodies they have, how they decide.

    With given ``positions`` every start is moved by up to ``jitter_m`` along each axis, by seed.
    In real time a robot whose command does not come repeats its last step for up to
    ``hold_ticks_max`` ticks and then stands still.
    """

    robots: Annotated[int, Field(ge=1, le=ROBOTS_MAX)] | None = None
    positions: tuple[Position, ...] | None = None
    jitter_m: Annotated[float, Field(ge=0.0, le=1e5)] = 0.0
    placement: Placement = Placement()
    strategy: str = "xi-star"
    radius_m: Length = 0.5
    step_m_max: Length = 0.3
    sensing_range_m: Length = 6.0
    hold_ticks_max: Annotated[int, Field(ge=0, le=1000)] = 5
    motion: Literal["holonomic", "unicycle"] = "holonomic"
    turn_rad_max: Annotated[float, Field(gt=0.0, le=pi)] = pi / 6


class Target(Model):
    """The target: where it starts, its body, how it behaves."""

    position: Position = (0.0, 0.0)
    behaviour: str = "flee"
    parameters: dict[str, Any] = Field(default_factory=dict)
    heading_rad: Annotated[float, Field(ge=-2 * pi, le=2 * pi)] = 0.0
    radius_m: Length = 0.5
    step_m_max: Length = 0.2
    sensing_range_m: Length = 6.0


class Sensing(Model):
    """How good the robots' sensors are: detection noise per axis, rays of the scan."""

    noise_m_std: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    rays: Annotated[int, Field(ge=8, le=360)] = 24


class Obstacle(Model):
    """A fixed disc."""

    position: Position
    radius_m: Length


class MoveTarget(Model):
    """The target is moved by hand: at ``tick`` it stands at ``position``, or as near as it fits."""

    kind: Literal["move-target"]
    tick: Annotated[int, Field(ge=1)]
    position: Position


class Capture(Model):
    """Captured: ``count`` robots within ``stop_distance_m``, no gap between them of pi or more."""

    count: Annotated[int, Field(ge=2)] | None = None
    stop_distance_m: Length = 1.3


class Scenario(Model):
    """One hunt, complete.

    ``clock``: ticks end when all have answered (``lockstep``) or by the ``wall`` clock. ``radio``:
    poses pass through the ``world`` or, by the wall clock only, ``direct`` from robot to robot.
    """

    title: str = ""
    description: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    tick_s: Annotated[float, Field(ge=1e-4, le=60.0)] = 0.1
    ticks_max: Annotated[int, Field(ge=1, le=1_000_000)] = 600
    team: Team
    target: Target = Target()
    robot: dict[str, Any] = Field(default_factory=dict)
    sensing: Sensing = Sensing()
    obstacles: tuple[Obstacle, ...] = ()
    events: tuple[
        Annotated[MoveTarget | Silence | Outage | Partition | Crash, Field(discriminator="kind")],
        ...,
    ] = ()
    channel: ChannelModel = ChannelModel()
    radio: Literal["world", "direct"] = "world"
    clock: Literal["lockstep", "wall"] = "lockstep"
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
        return {**self.robot, **self.bodies}

    @property
    def bodies(self) -> dict[str, float]:
        """The robots' parameters that follow from what bodies there are."""
        return {
            "radius_m": self.team.radius_m,
            "target_radius_m": self.target.radius_m,
            "step_m_max": self.team.step_m_max,
            "sensing_range_m": self.team.sensing_range_m,
            "stop_distance_m": self.capture.stop_distance_m,
        }


def digest_header(scenario: Scenario, seed: int) -> str:
    """What the digest of a run begins with: its configuration, as JSON.

    Without what is at its default: keys that a later version adds change no digest.
    """
    words = {"title", "description", "seed"}
    changed = scenario.model_dump(mode="json", exclude=words, exclude_defaults=True)
    return json.dumps({"version": VERSION, "seed": seed, "scenario": changed}, sort_keys=True)
