"""Many robots in memory: golden digests, made before anything was written for many robots.

Small teams take other ways through the code here and there, so their digests do
not vouch for these.
"""

import pytest

from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.loading.load import load

LOSSY = {
    "channel": {
        "loss": {"model": "gilbert-elliott", "good_to_bad": 0.1, "bad_to_good": 0.3},
        "delay": {"model": "gamma", "mean_s": 0.3, "std_s": 0.2},
    },
    "sensing": {"noise_m_std": 0.05},
    "robot": {"detections": "relay"},
    "obstacles": [{"position": [15.0, 5.0], "radius_m": 1.0}],
}


def hunt_of(robots: int, sensing_range_m: float) -> dict:
    """A few ticks of a hunt whose target walks round a square."""
    square = [[60.0, 0.0], [60.0, 60.0], [0.0, 60.0], [0.0, 0.0]]
    near_and_far = {"distance_m_min": 5.0, "distance_m_max": 8.0 + robots / 2.0}
    return {
        "ticks_max": 4,
        "team": {
            "robots": robots,
            "placement": near_and_far,
            "sensing_range_m": sensing_range_m,
        },
        "target": {
            "behaviour": "patrol",
            "parameters": {"waypoints": square},
            "step_m_max": 0.39,
        },
    }


@pytest.mark.parametrize(
    ("robots", "sensing_range_m", "more", "digest"),
    [
        (64, 200.0, {}, "5c9cbf2638ae0038e2f018277aac6400"),
        (64, 25.0, LOSSY, "375b68d4fad7343b61f53e0715692cd8"),
        (24, 25.0, LOSSY, "a5f26cce098e852de6be66ea92a0ddec"),
        (200, 25.0, {}, "aa990c86bf970fd951a540f403617551"),
    ],
)
def test_the_run_is_the_one_it_always_was(robots, sensing_range_m, more, digest):
    arena = engine.build(load(hunt_of(robots, sensing_range_m) | more), 1)
    assert run_in_memory(arena, "wide", print).digest == digest
