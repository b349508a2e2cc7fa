"""Hunts made for measuring: they never end early, and every robot decides in full at every tick.

The target patrols faster than the robots run, always in their sight, so the team keeps computing
rings, assignments and xi* and never gets to rest in a closed ring.
"""

from typing import Any

SIDE_M = 60.0
SENSING_M = 200.0


def endless_hunt(robots: int, ticks: int) -> dict[str, Any]:
    """A scenario of so many robots and ticks that is never over before."""
    square = [[SIDE_M, 0.0], [SIDE_M, SIDE_M], [0.0, SIDE_M], [0.0, 0.0]]
    return {
        "title": f"endless hunt with {robots} robots",
        "ticks_max": ticks,
        "team": {
            "robots": robots,
            "placement": {"distance_m_min": 5.0, "distance_m_max": 8.0 + robots / 2.0},
            "sensing_range_m": SENSING_M,
        },
        "target": {
            "behaviour": "patrol",
            "parameters": {"waypoints": square},
            "step_m_max": 0.39,
        },
    }


def ordinary_hunt(robots: int) -> dict[str, Any]:
    """A hunt as in the paper's first simulation, from random starts."""
    return {
        "title": f"hunt with {robots} robots",
        "ticks_max": 300,
        "team": {
            "robots": robots,
            "placement": {"distance_m_min": 5.0, "distance_m_max": 8.0 + robots / 2.0},
        },
    }
