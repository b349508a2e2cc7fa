"""Many short random hunts with random faults: what must hold at every tick does, in all of them.

What that is, is listed in ``helpers_witness`` (every packet has one fate, bodies never overlap,
who is lost is not asked, ...) and ``helpers_swarm_checks`` (a seed is one run, however it is come
by).
A failure names its seed and the line that plays it again. The environment variable
ENCIRCLE_SWARM_SEED takes one seed in place of the usual ones. ``python tests/helpers/swarm.py
memory --runs 10000`` plays as many as nightly, with figures.
"""

import os
from collections import Counter

import pytest
from helpers_clocked_swarm import checked_by_clock
from helpers_scenarios import scenario_of
from helpers_swarm import play
from helpers_swarm_checks import CHECKED_EVERY, CHECKS, checked
from swarm import swarm

from encircle.world.channel.loss_causes import CAUSES
from encircle.world.scenario.channel_model import Crash

ONE = os.environ.get("ENCIRCLE_SWARM_SEED")
SEEDS = range(60) if ONE is None else range(int(ONE), int(ONE) + 1)
FOUND = [1019, 8906]
"""Of earlier swarms: a recording that was cut before the round showed who was back, and one of a
robot that came back while the scenario held it down and all others were lost."""
CHECKED_SEEDS = [k for k in range(200, 240) if k % CHECKED_EVERY < len(CHECKS)] + FOUND
CHECKED_SEEDS = CHECKED_SEEDS if ONE is None else [int(ONE)]
BY_CLOCK_SEEDS = range(30) if ONE is None else SEEDS
NIGHTLY_SEEDS = range(10_000)
PER_TEST = 10
PER_NIGHTLY_TEST = 250
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
            if seed % 12 == 3:
                same = play(seed, ahead=False).digest == results[seed].digest
                assert same, "working ahead has an effect"
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


@pytest.mark.parametrize("seed", CHECKED_SEEDS)
def test_a_seed_is_one_run_however_it_is_come_by(seed):
    assert checked(seed).result.ticks > 0


@pytest.mark.parametrize("seeds", chunks(BY_CLOCK_SEEDS, PER_TEST), ids=named)
def test_a_swarm_of_hunts_by_the_clock_holds_together(seeds):
    faults = sum((checked_by_clock(seed).faults for seed in seeds), Counter())
    assert ONE or min(faults[kind] for kind in ("kill", "return", "freeze", "overtaken")) > 0


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("seeds", chunks(NIGHTLY_SEEDS, PER_NIGHTLY_TEST), ids=named)
def test_a_large_swarm_of_hunts_holds_together(seeds):
    said = []
    figures = swarm("memory", seeds, said.append)
    assert figures["failed"] == 0, "\n".join(said)


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
