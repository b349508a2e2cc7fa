"""Measures of the radio against closed forms of known losses and delays."""

from dataclasses import replace
from math import isnan

import numpy as np
import pytest
from helpers_measures import scenario, standing
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.measures import radio

CHEAP = settings(max_examples=60, deadline=None, derandomize=True)


def fates(ticks, robots, delay, every):
    """Every k-th packet of each link comes, after a delay; the others are lost."""
    sent = np.arange(ticks)
    due = np.where(sent % every == 0, sent + delay, -1)[:, None, None]
    return np.where(np.eye(robots, dtype=bool), 0, due)


def test_an_undisturbed_link_has_age_one_from_the_start():
    log = standing(25)
    assert radio.ages_ticks(log).shape == (25, 12)
    assert (radio.ages_ticks(log) == 1).all()
    assert (radio.age_ticks_mean(log), radio.age_ticks_max(log)) == (1.0, 1.0)
    assert (radio.delivery_ratio(log), radio.delay_ticks_mean(log)) == (1.0, 1.0)
    assert radio.delay_s_mean(log) == pytest.approx(0.1)
    assert radio.unheard_share(log) == 0.0


@pytest.mark.parametrize("delay", [1, 2, 5])
@pytest.mark.parametrize("every", [1, 2, 7])
def test_the_age_of_a_link_that_delivers_every_kth_packet_is_a_sawtooth(delay, every):
    # From the first delivery on the age runs through delay, delay + 1, ... delay + every - 1.
    periods = 6
    ticks = delay + periods * every
    log = standing(ticks, due=fates(ticks, 4, delay, every))
    before = delay * (delay + 1) / 2
    after = periods * every * (delay + (every - 1) / 2)
    assert radio.age_ticks_mean(log) == pytest.approx((before + after) / ticks)
    assert radio.age_ticks_max(log) == delay + every - 1
    assert radio.ages_ticks(log)[:delay, 0].tolist() == list(range(1, delay + 1))
    assert radio.delivery_ratio(log) == pytest.approx(len(range(0, ticks, every)) / ticks)
    assert radio.delay_ticks_mean(log) == delay
    assert radio.unheard_share(log) == pytest.approx((delay - 1) / (ticks - 1))


def test_a_link_over_which_nothing_comes_keeps_ageing():
    due = standing(9).due
    due[:, 2, 3] = -1
    log = standing(9, due=due)
    dead = 3 * 2 + 2  # links in the order of senders, then receivers, without own ones
    assert radio.ages_ticks(log)[:, dead].tolist() == list(range(1, 10))
    assert radio.age_ticks_mean(log) == pytest.approx((11 * 1 + 5.0) / 12)
    assert radio.age_ticks_mean_worst(log) == pytest.approx(5.0)
    assert radio.age_ticks_max(log) == 9.0
    assert radio.unheard_share(log) == pytest.approx(1 / 12)
    assert radio.delivery_ratio(log) == pytest.approx(11 / 12)


def test_the_age_does_not_grow_again_when_packets_overtake_each_other():
    # Sent at 0 with delay 4, at 1 with delay 1; later ones are lost.
    due = np.zeros((6, 2, 2), np.int64)
    due[:, 0, 1], due[:, 1, 0] = [4, 2, -1, -1, -1, -1], range(1, 7)
    log = standing(6, 2, due=due)
    assert radio.ages_ticks(log)[:, 0].tolist() == [1, 2, 1, 2, 3, 4]
    assert radio.delay_ticks_mean(log) == pytest.approx((4 + 1 + 6) / 8)


def test_the_percentile_is_of_all_links_and_ticks():
    ticks = 101
    due = np.zeros((ticks, 2, 2), np.int64)
    due[:, 0, 1] = due[:, 1, 0] = -2
    log = standing(ticks, 2, due=due)  # ages 1 to 101, twice
    assert radio.age_ticks_p95(log) == pytest.approx(np.percentile(np.arange(1, 102).repeat(2), 95))
    assert radio.age_ticks_mean(log) == pytest.approx(51.0)
    assert radio.delivery_ratio(log) == 0.0
    assert isnan(radio.delay_ticks_mean(log))
    assert isnan(radio.delay_s_mean(log))


def test_a_copy_that_comes_first_is_the_delivery_and_is_one():
    due = np.zeros((4, 2, 2), np.int64)
    due[:, 0, 1], due[:, 1, 0] = [4, 3, -1, -1], [-1, -1, -1, -1]
    copies = np.zeros_like(due)
    copies[:, 0, 1] = [1, 9, 3, 0]
    log = standing(4, 2, due=due, copies=copies)
    assert sorted(radio.delays_ticks(log).tolist()) == [1, 1, 2]
    assert radio.delivery_ratio(log) == pytest.approx(3 / 8)
    assert radio.ages_ticks(log)[:, 0].tolist() == [1, 1, 2, 1]


def test_what_is_in_flight_at_the_end_counts_as_delivered():
    due = np.where(np.eye(2, dtype=bool), 0, np.full((5, 2, 2), 30))
    log = standing(5, 2, due=due)
    assert radio.delivery_ratio(log) == 1.0
    assert radio.delay_ticks_mean(log) == pytest.approx(30 - 2)
    assert radio.age_ticks_max(log) == 5.0


def test_who_publishes_nothing_sends_no_packets_and_ages():
    due, sizes = standing(10).due, standing(10).sizes_bytes
    due[1::2, 0] = 0
    sizes[1::2, 0] = 0
    log = standing(10, due=due, sizes_bytes=sizes)
    assert radio.delivery_ratio(log) == 1.0
    assert radio.ages_ticks(log)[:, 0].tolist() == [1, 1, 2, 1, 2, 1, 2, 1, 2, 1]
    assert radio.messages_sent(log) == 35.0
    assert radio.messages_hz_mean(log) == pytest.approx(35 / 4 / 1.0)
    assert radio.sent_bytes(log) == 3500.0
    assert radio.sent_bytes_per_s(log) == pytest.approx(3500.0)


def test_rates_are_per_second_of_the_run():
    log = replace(standing(20), scenario=scenario(4, tick_s=0.25))
    assert radio.messages_hz_mean(log) == pytest.approx(4.0)
    assert radio.sent_bytes_per_s(log) == pytest.approx(4 * 100 * 4.0)
    assert radio.delay_s_mean(log) == pytest.approx(0.25)


@pytest.mark.parametrize("rate", [0.2, 0.5, 0.8])
def test_independent_losses_age_a_link_as_theory_says(rate):
    # Geometric: mean 1 / (1 - p), variance p / (1 - p)^2. Over 12 x 5000 ages that are correlated
    # over about 1 / (1 - p) ticks, eight standard errors: a false alarm in 10^12 seeds.
    ticks = 5000
    lost = np.random.default_rng(5).random((ticks, 4, 4)) < rate
    plain = standing(ticks)
    log = standing(ticks, due=np.where(lost & (plain.due > 0), -1, plain.due))
    error = 8 * np.sqrt(2 * rate / (1 - rate) ** 3 / (12 * ticks))
    assert radio.age_ticks_mean(log) == pytest.approx(1 / (1 - rate), abs=error)
    spread = 8 * np.sqrt(rate * (1 - rate) / (12 * ticks))
    assert radio.delivery_ratio(log) == pytest.approx(1 - rate, abs=spread)


@CHEAP
@given(st.integers(1, 30), st.integers(2, 5), st.integers(0, 2**32 - 1))
def test_ages_are_those_of_a_receiver_that_is_asked_at_every_tick(ticks, robots, seed):
    rng = np.random.default_rng(seed)
    sent = np.arange(ticks)[:, None, None]
    due, copies = (
        np.where(
            (rng.random((ticks, robots, robots)) < keep) & ~np.eye(robots, dtype=bool),
            sent + rng.integers(1, 9, (ticks, robots, robots)),
            other,
        )
        for keep, other in ((0.6, -1), (0.2, 0))
    )
    due[:, np.arange(robots), np.arange(robots)] = 0
    log = standing(ticks, robots, due=due, copies=copies)
    pairs = [(s, r) for s in range(robots) for r in range(robots) if s != r]
    for link, (s, r) in enumerate(pairs):
        for tick in range(ticks):
            came = [
                u for u in range(ticks) if 0 < due[u, s, r] <= tick or 0 < copies[u, s, r] <= tick
            ]
            assert radio.ages_ticks(log)[tick, link] == tick - max(came, default=-1)
    assert (radio.ages_ticks(log) >= 1).all()
    assert (np.diff(radio.ages_ticks(log), axis=0) <= 1).all()
    assert 0.0 <= radio.delivery_ratio(log) <= 1.0
    assert radio.age_ticks_mean(log) <= radio.age_ticks_max(log) <= ticks
