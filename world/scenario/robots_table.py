"""``team.robots`` as a table: how many robots, and what is different about single ones.

    [team.robots]
    count = 4

    [team.robots.r3]
    step_m_max = 0.15

A number is a table with that ``count`` and nothing else, and such a table becomes the number again:
both are the same scenario. Which robots there are is checked in ``encircle.world.loading.robots``.
"""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag

from encircle.world.scenario.fields import ROBOTS_MAX, Length, Model, Probability

RobotCount = Annotated[int, Field(ge=1, le=ROBOTS_MAX)]


class RobotOverride(Model):
    """What is different about one robot; what is left out is as for the whole team."""

    strategy: str | None = None
    """Name of its policy."""
    policy_parameters: dict[str, Any] | None = None
    """Its policy's own parameters. They replace those of the team one by one; of a robot with
    another policy than the team's they are all that is given."""
    step_m_max: Length | None = None
    """Its longest step in a tick."""
    sensing_range_m: Length | None = None
    """How far it detects the target, obstacles and other robots."""
    radio_range_m: Length | None = None
    """How far its radio reaches, both ways: packets pass between two robots within the range of
    both. No limit if left out."""
    loss_rate: Probability = 0.0
    """Probability that its radio loses a packet, sent or received, besides what the channel
    loses."""


class RobotsTable(Model):
    """Number of robots, and a table for each robot that is different."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, RobotOverride]

    count: RobotCount | None = None
    """Number of robots; may be left out where ``team.positions`` are given."""

    @property
    def overrides(self) -> Mapping[str, RobotOverride]:
        """What is different, by robot id."""
        return self.__pydantic_extra__


def _kind(value: Any) -> str:
    return "table" if isinstance(value, Mapping | RobotsTable) else "number"


def _shortest(robots: int | RobotsTable | None) -> int | RobotsTable | None:
    """Without tables that say nothing, and as the number where nothing else is said."""
    if not isinstance(robots, RobotsTable):
        return robots
    kept = {robot: own for robot, own in robots.overrides.items() if own != RobotOverride()}
    return RobotsTable(count=robots.count, **kept) if kept else robots.count  # type: ignore[arg-type]  # extras


Robots = Annotated[
    Annotated[
        Annotated[RobotCount, Tag("number")] | Annotated[RobotsTable, Tag("table")],
        Discriminator(_kind),
    ]
    | None,
    AfterValidator(_shortest),
]
"""The number of robots, or a ``RobotsTable`` if single robots are different."""
