"""Many short random hunts with random faults: what must hold at every tick does, in all of them.

A failure names its seed and the line that plays it again. The environment variable
ENCIRCLE_SWARM_SEED takes one seed in place of the usual ones.
"""

import os
from collections import Counter

import pytest
from helpers_scenarios import scenario_of
from helpers_swarm import play

from encircle.world.channel.loss_causes import CAUSES
from encircle.world.scenario.channel_model import Crash

ONE = os.environ.get("ENCIRCLE_SWARM_SEED")
SEEDS = range(60) if ONE is None else range(int(ONE), int(ONE) + 1)
NIGHTLY_SEEDS = range(1_000, 3_200)
PER_TEST = 10
PER_NIGHTLY_TEST = 100
FILE = "tests/world/coordinator/test_swarm.py"
REPLAY = f"replay: ENCIRCLE_SWARM_SEED={{}} .venv/bin/python -m pytest -n 0 {FILE}"


def played(seeds):
    """Results by seed; the first that fails names its seed."""
    results = {}
    for seed in seeds:
        try:
            results[seed] = play(seed)
            if seed % 12 == 0:
                assert play(seed, junk=False).digest == results[seed].digest, "junk has an effect"
            if seed % 12 == 6:
                first, other = (play(seed, faults=False, order=k) for k in (1, 2))
                assert first.digest == other.digest, "the order of answers has an effect"
        except Exception as error:
            error.add_note(REPLAY.format(seed))
            raise
    return results


def chunks(seeds, size):
    return [seeds[at : at + size] for at in range(0, len(seeds), size)]


def named(seeds):
    return f"{seeds[0]}-{seeds[-1]}"


@pytest.mark.parametrize("seeds", chunks(SEEDS, PER_TEST), ids=named)
def test_a_swarm_of_hunts_holds_together(seeds):
    assert len(played(seeds)) == len(seeds)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("seeds", chunks(NIGHTLY_SEEDS, PER_NIGHTLY_TEST), ids=named)
def test_a_large_swarm_of_hunts_holds_together(seeds):
    assert len(played(seeds)) == len(seeds)


def test_the_swarm_meets_what_it_is_for():
    """Seeds that lose nothing and nobody would prove nothing."""
    scenarios = [scenario_of(seed) for seed in range(120)]
    results = [play(seed) for seed in range(40)]
    causes = {cause for result in results for cause in result.packets_lost}
    assert causes == set(CAUSES.values())
    assert sum(any(isinstance(e, Crash) for e in s.events) for s in scenarios) > 40
    departures = [what.split(":")[0] for r in results for _, _, what in r.departures]
    assert min(Counter(departures).values()) > 20
    assert sum(sum(r.refused.values()) > 0 for r in results) > 15
    assert sum(r.packets_copied > 0 for r in results) > 3
    assert {r.ended for r in results} == {"captured", "ticks"}
