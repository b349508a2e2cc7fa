"""Offsets between simulated clocks whose truth is known: it lies within the bound that is told."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.protocol.clocks import DRIFT, READING_US, WINDOW_US, Exchange, Offsets

EPOCH_US = 1_700_000_000_000_000


class Remote:
    """A clock that is ahead by ``offset_us`` at true time 0 and runs faster by ``drift``."""

    def __init__(self, offset_us: int, drift: float) -> None:
        self.offset_us, self.drift = offset_us, drift

    def ahead_us(self, true_us: float) -> float:
        return self.offset_us + self.drift * true_us

    def shows(self, true_us: float) -> int:
        return int(EPOCH_US + true_us + self.ahead_us(true_us))

    def exchange(self, at_us: int, out_us: int, works_us: int, back_us: int) -> Exchange:
        arrives, leaves = at_us + out_us, at_us + out_us + works_us
        times = (self.shows(arrives), self.shows(leaves))
        return Exchange(EPOCH_US + at_us, *times, EPOCH_US + leaves + back_us)


def run_of_exchanges(remote: Remote, seed: int, count: int = 300) -> list[Exchange]:
    """One every 20 ms, with delays of 1 ms and exponential queues, more of them on the way out."""
    generator = np.random.default_rng(seed)
    out_us = 1000 + generator.exponential(4000, count).astype(int)
    back_us = 1000 + generator.exponential(500, count).astype(int)
    works_us = generator.integers(50, 3000, count)
    return [
        remote.exchange(20_000 * k, *(int(part[k]) for part in (out_us, works_us, back_us)))
        for k in range(count)
    ]


def test_equal_ways_and_clocks_of_one_speed_give_the_offset_exactly():
    exchange = Remote(123_456, 0.0).exchange(0, 700, 300, 700)
    assert exchange.offset_us == 123_456
    assert exchange.round_trip_us == 1400


@pytest.mark.parametrize(("out_us", "back_us"), [(1400, 0), (0, 1400), (1000, 400)])
def test_unequal_ways_are_wrong_by_half_their_difference(out_us, back_us):
    exchange = Remote(-5000, 0.0).exchange(0, out_us, 300, back_us)
    assert exchange.offset_us - -5000 == (out_us - back_us) / 2
    # Half the round trip, the drift over what it took, and the reading of a clock.
    assert exchange.error_us == 700 + 1.5 * DRIFT * 1700 + READING_US


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    st.integers(-(10**12), 10**12),
    st.floats(-DRIFT, DRIFT),
    st.integers(0, 500_000),
    st.integers(0, 500_000),
    st.integers(0, 500_000),
    st.integers(0, 50_000_000),
    st.floats(-1.0, 1.0),
)
def test_the_truth_is_within_the_bound_whatever_delays_and_drift(
    offset_us, drift, out_us, works_us, back_us, at_us, apart
):
    remote = Remote(offset_us, drift)
    exchange = remote.exchange(at_us, out_us, works_us, back_us)
    true_us = at_us + apart * 0.9 * WINDOW_US
    found = Offsets([exchange]).at(EPOCH_US + true_us)
    assert found is not None
    assert abs(found.offset_us - remote.ahead_us(true_us)) <= found.error_us


@pytest.mark.parametrize("drift", [-DRIFT, 0.0, 3e-5, DRIFT])
@pytest.mark.parametrize("seed", range(5))
def test_the_truth_is_within_the_bound_all_through_a_run(drift, seed):
    remote = Remote(3_600_000_000, drift)
    offsets = Offsets(run_of_exchanges(remote, seed))
    assert offsets.is_steady
    for true_us in range(-50_000, 6_100_000, 7_919):
        found = offsets.at(EPOCH_US + true_us)
        assert found is not None
        assert abs(found.offset_us - remote.ahead_us(true_us)) <= found.error_us
        there = offsets.of_remote(remote.shows(true_us))
        assert there is not None
        assert abs(there.offset_us - remote.ahead_us(true_us)) <= there.error_us


def test_of_all_exchanges_the_one_with_the_smallest_bound_is_taken():
    known = run_of_exchanges(Remote(17, 5e-5), 3, 120)
    offsets = Offsets(known)
    for time_us in range(EPOCH_US - 30_000, EPOCH_US + 2_600_000, 12_345):
        best = min(
            x.error_us + DRIFT * max(0, x.asked_us - time_us, time_us - x.arrival_us) for x in known
        )
        found = offsets.at(time_us)
        assert found is not None
        assert found.error_us == pytest.approx(best, abs=1e-9)


def test_the_bound_grows_with_the_time_since_the_last_exchange_until_nothing_is_known():
    exchange = Remote(0, 0.0).exchange(0, 100, 0, 100)
    offsets = Offsets([exchange])
    for later_us in (0, 1_000_000, WINDOW_US):
        found = offsets.at(exchange.arrival_us + later_us)
        assert found is not None
        assert found.error_us == exchange.error_us + DRIFT * later_us
    assert offsets.at(exchange.arrival_us + WINDOW_US + 1) is None
    assert offsets.at(exchange.asked_us - WINDOW_US - 1) is None


def test_a_gap_longer_than_the_window_leaves_both_sides_with_their_own():
    early, late = Remote(5, 0.0), Remote(5_000, 0.0)
    known = [early.exchange(k * 1000, 10, 10, 10) for k in range(5)]
    known += [late.exchange(3 * WINDOW_US + k * 1000, 900, 10, 900) for k in range(5)]
    offsets = Offsets(known)
    assert offsets.at(EPOCH_US + 4000).offset_us == 5
    assert offsets.at(EPOCH_US + 3 * WINDOW_US + 100).offset_us == 5000
    assert offsets.at(EPOCH_US + 3 * WINDOW_US // 2) is None


def test_nothing_is_known_without_exchanges():
    assert Offsets([]).at(EPOCH_US) is None
    assert Offsets([]).of_remote(EPOCH_US) is None
    assert Offsets([]).last is None
    assert Offsets([]).is_steady


def test_a_clock_that_is_set_anew_is_found_out():
    before, after = Remote(0, 0.0), Remote(50_000, 0.0)
    known = [before.exchange(k * 20_000, 1000, 100, 3000) for k in range(10)]
    known += [after.exchange(k * 20_000, 1000, 100, 3000) for k in range(10, 20)]
    assert not Offsets(known).is_steady
    assert all(Offsets(part).is_steady for part in (known[:10], known[10:]))


def test_the_order_in_which_exchanges_are_given_does_not_matter():
    known = run_of_exchanges(Remote(1, 0.0), 9, 50)
    times = range(EPOCH_US, EPOCH_US + 1_000_000, 50_000)
    found = [[Offsets(order).at(t) for t in times] for order in (known, known[::-1])]
    assert found[0] == found[1]
    assert all(a.arrival_us <= b.arrival_us for a, b in pairwise(Offsets(known[::-1]).exchanges))
