"""Mutated packets for everybody who takes in what others send: taken, or refused and counted.

``helpers_receivers`` says who that is and what they are held to, ``helpers_mutations`` how packets
are changed. A failure names its seed and the packet. The environment variable ENCIRCLE_SWARM_SEED
takes one seed in place of the usual ones; ``python tests/helpers/swarm.py packets --packets
1000000`` gives as many as nightly, with figures.
"""

import os
import random
from collections import Counter

import pytest
from helpers_messages import GOLDEN
from helpers_mutations import CHANGES, mutant
from helpers_receivers import Receiver, mutated, watch
from swarm import swarm

ONE = os.environ.get("ENCIRCLE_SWARM_SEED")
SEEDS = range(3) if ONE is None else [int(ONE)]
PACKETS = 700
NIGHTLY_SEEDS = range(100)
PER_NIGHTLY_TEST = 5
PAYLOADS = [bytes.fromhex(hexadecimal) for hexadecimal in GOLDEN.values()]


@pytest.mark.parametrize("seed", SEEDS)
def test_whatever_is_sent_is_taken_or_refused(seed):
    figures = mutated(seed, PACKETS)
    names = {name.split(":")[0] for name in figures if ": taken" in name}
    assert {"robot", "steered robot", "robot by the clock", "viewer", "frames"} <= names
    assert {"world", "world by the clock"} & names
    assert figures["packets"] == PACKETS
    assert figures["watched"] > 0


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("first", range(0, len(NIGHTLY_SEEDS), PER_NIGHTLY_TEST))
def test_a_million_packets_are_taken_or_refused(first):
    said = []
    figures = swarm("packets", NIGHTLY_SEEDS[first : first + PER_NIGHTLY_TEST], said.append)
    assert figures["failed"] == 0, "\n".join(said)


def test_every_way_of_changing_a_packet_changes_it():
    draws, made = random.Random(1), Counter()
    for number in range(3000):
        payload = PAYLOADS[number % len(PAYLOADS)]
        change, packet = mutant(draws, payload, PAYLOADS)
        made[change] += packet != payload
    assert {*CHANGES, "long"} == set(made)
    assert min(made.values()) > 0


class Greedy(Receiver):
    """Takes memory and works out of all proportion."""

    def __init__(self, size, calls):
        self.size, self.calls = size, calls

    def give(self, key, payload):
        taken = bytes(self.size)
        for _ in range(self.calls):
            len(taken)
        return "taken"


@pytest.mark.parametrize(("size", "calls"), [(1 << 26, 0), (0, 10**6)])
def test_who_takes_more_than_its_length_allows_is_found_out(size, calls):
    assert watch(Greedy(10, 10), "key", b"packet") == "taken"
    with pytest.raises(AssertionError, match=r"\d+ (bytes of memory|calls)"):
        watch(Greedy(size, calls), "key", b"packet")
