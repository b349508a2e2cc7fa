"""Radios of single robots: range and loss on all their links, besides the channel's own losses."""

import numpy as np
import pytest
from helpers_channel import ALPHA, Flown, distances, links_of
from helpers_world import arena, small
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from encircle.world.channel import channel as radio
from encircle.world.channel.loss_causes import Cause
from encircle.world.coordinator.real_time_core import has_perfect_channel

ROBOTS, TICKS = 4, 3000
LINKS = links_of(ROBOTS)
BERNOULLI = "channel.loss={model='bernoulli', rate=0.3}"
BURSTS = "channel.loss={model='burst', rate=0.3, burst_packets=4}"


def mixed(*overrides, seed=1, robots=ROBOTS):
    return radio.build(small(*overrides, team={"robots": robots}), seed)


@pytest.mark.parametrize("rates", [(0.0, 0.4, 0.0, 0.0), (0.5, 0.2, 1.0, 0.1)])
@pytest.mark.parametrize("channel", [None, BERNOULLI])
def test_a_packet_passes_if_channel_sender_and_receiver_let_it(rates, channel):
    singles = [f"team.robots.r{k + 1}.loss_rate={rate}" for k, rate in enumerate(rates)]
    lost = Flown(mixed(*singles, *([channel] if channel else [])), TICKS).lost().sum(axis=0)
    passes = np.outer(1 - np.array(rates), 1 - np.array(rates)) * (0.7 if channel else 1.0)
    for sender, receiver in np.argwhere(LINKS).tolist():
        expected = 1.0 - passes[sender, receiver]
        found = stats.binomtest(int(lost[sender, receiver]), TICKS, expected)
        assert found.pvalue > ALPHA, (sender, receiver)


def test_losses_by_a_radio_are_independent_over_ticks_and_links():
    lost = Flown(mixed("team.robots.r2.loss_rate=0.5"), TICKS).lost()
    series = np.array([lost[:, s, r] for s, r in np.argwhere(LINKS) if 1 in (s, r)], float)
    bound = stats.norm.isf(ALPHA / 2 / 21) / TICKS**0.5
    assert len(series) == 6
    assert abs(np.corrcoef(series)[np.triu_indices(6, 1)]).max() < bound
    assert max(abs(np.corrcoef(s[1:], s[:-1])[0, 1]) for s in series) < bound


@pytest.mark.parametrize("channel", [BERNOULLI, BURSTS])
def test_a_weak_radio_loses_more_and_takes_nothing_from_what_the_channel_loses(channel):
    strong, weak = (
        Flown(mixed(channel, *own), 300).due for own in ([], ["team.robots.r2.loss_rate=0.4"])
    )
    own = np.zeros((ROBOTS, ROBOTS), bool)
    own[1] = own[:, 1] = True
    np.testing.assert_array_equal(weak[:, ~own], strong[:, ~own])
    # What the channel has lost is counted under its cause; what the radio loses had passed.
    np.testing.assert_array_equal(weak[strong < 0], strong[strong < 0])
    assert set(weak[(strong > 0) & (weak != strong)]) == {-Cause.LOSS}


def test_losses_of_a_robot_are_the_same_in_a_larger_team_and_more_at_a_higher_rate():
    few, many = (Flown(mixed("team.robots.r2.loss_rate=0.4", robots=n), 200).due for n in (3, 6))
    np.testing.assert_array_equal(few, many[:, :3, :3])
    some, more = (
        Flown(mixed(f"team.robots.r2.loss_rate={rate}"), 200).lost() for rate in (0.3, 0.6)
    )
    assert (some <= more).all()
    assert some.sum() < more.sum()


@given(
    st.lists(st.none() | st.floats(0.5, 9.0), min_size=3, max_size=3),
    st.none() | st.floats(0.5, 9.0),
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=3, max_size=3),
)
def test_a_link_reaches_as_far_as_the_weaker_of_its_two_radios(ranges, cutoff, places):
    singles = [f"team.robots.r{k + 1}.radio_range_m={own}" for k, own in enumerate(ranges) if own]
    loss = [f"channel.loss={{model='range', cutoff_m={cutoff}}}"] if cutoff else []
    away = distances(np.array(places))
    flown = Flown(mixed(*singles, *loss, robots=3), 1, distances_m=away)
    for sender, receiver in np.argwhere(links_of(3)).tolist():
        reach = min(m for m in (ranges[sender], ranges[receiver], cutoff, np.inf) if m)
        assert flown.lost()[0, sender, receiver] == (away[sender, receiver] > reach)
    assert not set(flown.due[flown.due < 0]) - {-Cause.OUT_OF_RANGE}


def test_out_of_range_is_named_before_chance_and_after_outages():
    both = ["team.robots.r1.radio_range_m=1", "team.robots.r1.loss_rate=1.0"]
    event = 'events=[{kind="outage", tick=1, ticks=1, sender="r1", receiver="r2"}]'
    far = distances(np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 5.0], [5.0, 5.0]]))
    due = Flown(mixed(*both, event), 2, distances_m=far).due
    assert set(due[:, 0, 1:].ravel()) == {-Cause.OUT_OF_RANGE, -Cause.OUTAGE}
    assert due[1, 0, 1] == -Cause.OUTAGE
    assert (due[0, 1:, 0] == -Cause.OUT_OF_RANGE).all()


@pytest.mark.parametrize("own", ["radio_range_m=9", "loss_rate=0.1"])
def test_a_channel_with_a_weak_radio_is_not_perfect(own):
    """Robots that hear each other directly must be told which packets the radio lets through."""
    assert has_perfect_channel(arena())
    assert has_perfect_channel(arena("team.robots.r2.step_m_max=0.1"))
    assert not has_perfect_channel(arena(f"team.robots.r2.{own}"))


def test_without_single_radios_there_is_no_such_stage():
    assert mixed().radios is None
    assert mixed("team.robots.r2.step_m_max=0.1").radios is None
