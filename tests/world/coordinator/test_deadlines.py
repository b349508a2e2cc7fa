"""Deadlines, held steps and how punctuality is counted."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.coordinator.deadlines import (
    COARSE_US,
    DeadlineStatistics,
    HeldCommand,
    next_deadline,
    step_at,
)


@pytest.mark.parametrize(
    ("slot", "elapsed_s", "expected"),
    [
        (0, 0.0, 1),
        (0, 0.099, 1),
        (1, 0.1, 2),
        (1, 0.15, 2),
        (1, 0.25, 3),
        (1, 1.04, 11),
        (5, 0.1, 6),
    ],
)
def test_the_next_deadline_is_the_first_that_is_still_to_come(slot, elapsed_s, expected):
    assert next_deadline(slot, elapsed_s, 0.1) == expected


@settings(max_examples=500, deadline=None, derandomize=True)
@given(st.integers(0, 10**6), st.floats(0.0, 1e6), st.floats(1e-4, 60.0))
def test_no_deadline_that_is_to_come_is_left_out(slot, elapsed_s, tick_s):
    found = next_deadline(slot, elapsed_s, tick_s)
    assert found > slot
    # The one before has passed, or was the last one; in exact arithmetic but for one rounding.
    if found > slot + 1:
        assert Fraction(found - 1) * Fraction(tick_s) <= Fraction(elapsed_s) * (
            1 + Fraction(1, 2**50)
        )
    assert Fraction(found) * Fraction(tick_s) > Fraction(elapsed_s) * (1 - Fraction(1, 2**50))


def test_a_step_is_held_for_a_bounded_number_of_ticks_then_nothing():
    held = HeldCommand(10, (0.1, 0.2))
    steps = [step_at(held, tick, 3) for tick in range(10, 16)]
    assert steps == [(0.1, 0.2)] * 4 + [None] * 2
    assert step_at(held, 10, 0) == (0.1, 0.2)
    assert step_at(held, 11, 0) is None
    assert step_at(None, 0, 5) is None


def test_every_deadline_that_is_left_out_is_counted():
    punctuality = DeadlineStatistics()
    for slots in (1, 1, 3, 1, 2):
        punctuality.add_advance(slots)
    assert (punctuality.overruns, punctuality.skipped) == (2, 3)


@pytest.mark.parametrize("share", [0.01, 0.5, 0.9, 0.99, 1.0])
def test_quantiles_are_those_of_the_whole_list(share):
    late_us = np.random.default_rng(1).integers(0, 5000, 1001)
    punctuality = DeadlineStatistics()
    for value in late_us:
        punctuality.add_lateness(value / 1e6)
    exact = np.quantile(late_us, share, method="inverted_cdf")
    assert punctuality.late_us_quantile(share) == exact
    assert punctuality.late_us_max == late_us.max()


def test_great_lateness_is_told_to_the_millisecond_and_takes_no_more_room():
    punctuality = DeadlineStatistics()
    punctuality.add_lateness(-1.0)
    for us in range(1000):
        punctuality.add_lateness(3.0 + us / 1e6)
    found = punctuality.as_dict()
    assert found["jitter_s_max"] == 3.000999
    assert found["jitter_s_median"] == found["jitter_s_p99"] == 3.000999
    assert punctuality.late_us_quantile(0.0005) == 0 < COARSE_US
    assert len(punctuality._late_us) == 3
    assert DeadlineStatistics().as_dict()["jitter_s_median"] == 0.0
