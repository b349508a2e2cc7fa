"""What to do while nothing is known of the target: hold still, or spiral outwards.

The paper leaves the search open. The spiral is Archimedes', its arms 1.5 sensing ranges apart,
walked at full speed; each robot starts it in another direction, so that the team spreads.
"""

from math import cos, pi, sin, sqrt
from typing import NamedTuple

from encircle.protocol.messages import Point
from encircle.protocol.parameters import Parameters

ARM_SPACING_RANGES = 1.5


class Search(NamedTuple):
    """Where and when a search began."""

    x: float
    y: float
    tick: int


def search_goal(
    search: Search, tick: int, own: int, team_size: int, parameters: Parameters
) -> Point:
    """The point to head for at a tick of the search, in m."""
    if parameters.search == "hold":
        return search.x, search.y
    growth = ARM_SPACING_RANGES * parameters.sensing_range_m / (2.0 * pi)
    walked = (tick + 1 - search.tick) * parameters.step_m_max
    angle = sqrt(2.0 * walked / growth)
    bearing = angle + 2.0 * pi * own / team_size
    radius = growth * angle
    return search.x + radius * cos(bearing), search.y + radius * sin(bearing)
