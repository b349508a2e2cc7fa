"""Hunts as processes, killed, frozen and cut off by a seed: each ends in order, or with one line.

What they are held to is listed in ``helpers_struck``. The environment variable ENCIRCLE_SWARM_SEED
takes one seed in place of the usual ones; ``python tests/helpers/swarm.py processes --runs 200``
plays as many as nightly, with figures.
"""

import os
import random

import pytest
from helpers_struck import BLOWS, drawn, struck
from swarm import swarm

ONE = os.environ.get("ENCIRCLE_SWARM_SEED")
SEEDS = range(3) if ONE is None else [int(ONE)]
NIGHTLY_SEEDS = range(200)
PER_NIGHTLY_TEST = 20


@pytest.mark.parametrize("seed", SEEDS)
def test_a_hunt_that_is_struck_ends_in_order(seed):
    figures = struck(seed)
    assert figures["ended in order"] + figures["ended by SIGTERM"] == 1


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("first", range(0, len(NIGHTLY_SEEDS), PER_NIGHTLY_TEST))
def test_many_hunts_that_are_struck_end_in_order(first):
    said = []
    figures = swarm("processes", NIGHTLY_SEEDS[first : first + PER_NIGHTLY_TEST], said.append)
    assert figures["failed"] == 0, "\n".join(said)


def test_what_is_drawn_is_of_every_kind():
    scenarios = [drawn(random.Random(f"struck {seed}")) for seed in NIGHTLY_SEEDS]
    assert {scenario.clock for scenario in scenarios} == {"lockstep", "wall"}
    policies = {s.strategy_of(robot) for s in scenarios for robot in s.ids}
    assert len(policies) == 11
    assert len(set(BLOWS)) == 7
