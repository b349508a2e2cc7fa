"""Weak signals against theory: Rayleigh fading over path loss, shadowing, and how they drift."""

import numpy as np
import pytest
from helpers_channel import ALPHA, Flown, channel, distances, links_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.integrate import quad

from encircle.world.channel import channel as radio
from encircle.world.channel import path_loss
from encircle.world.channel.loss_causes import Cause

TWO_SIDED = stats.norm.isf(ALPHA / 2)
LINE = distances(np.array([[2.0**k - 1.0, 0.0] for k in range(5)]))
"""Robots at 0, 1, 3, 7 and 15 m: ten distances from 1 to 15 m, both ways."""


def model(**keys):
    return (
        "channel.loss={model='path-loss', "
        + ", ".join(f"{key}={value!r}" for key, value in keys.items())
        + "}"
    )


def signals(robots, seed=1, **keys):
    losses = channel(model(**keys), robots=robots, seed=seed).losses
    assert losses is not None
    assert losses.signals is not None
    return losses.signals


def binomial(lost, chance):
    return stats.binomtest(int(lost.sum()), lost.size, chance).pvalue


@pytest.mark.parametrize(("range_m", "exponent"), [(6.0, 2.0), (9.0, 4.0), (3.0, 2.7)])
def test_without_coherence_success_is_exp_of_minus_distance_over_range_to_the_exponent(
    range_m, exponent
):
    flown = Flown(
        channel(model(range_m=range_m, exponent=exponent), robots=5), 4000, distances_m=LINE
    )
    lost = flown.lost(Cause.WEAK_SIGNAL)
    assert (lost == flown.lost()).all()
    for distance in np.unique(LINE[links_of(5)]):
        chance = 1.0 - np.exp(-((distance / range_m) ** exponent))
        assert binomial(lost[:, distance == LINE], chance) > ALPHA / 10, distance
    # The two directions of a pair, and one tick and the next, are independent.
    both = lost[:, 0, 2], lost[:, 2, 0]
    assert abs(np.corrcoef(*both)[0, 1]) < TWO_SIDED / 4000**0.5
    assert abs(np.corrcoef(lost[1:, 0, 2], lost[:-1, 0, 2])[0, 1]) < TWO_SIDED / 3999**0.5


def gains(robots, ticks, seed=1, **keys):
    """(T, N, N) the complex gains of T ticks."""
    of = signals(robots, seed, **keys)
    state, seen = path_loss.first_state(of), []
    for tick in range(ticks):
        state, _ = path_loss.chances(of, state, tick, np.ones((robots, robots)))
        seen.append(state.gains)
    return np.array(seen)


@pytest.mark.parametrize("coherence_s", [0.02, 0.3, 2.0])
def test_gains_are_complex_normal_at_every_tick_also_at_the_first(coherence_s):
    # 60 robots: 1,770 pairs, independent of each other.
    seen = gains(60, 12, range_m=9.0, coherence_s=coherence_s)
    pairs = np.triu_indices(60, 1)
    for tick in (0, 11):
        now = seen[tick][pairs]
        assert stats.kstest(np.abs(now) ** 2, stats.expon.cdf).pvalue > ALPHA
        assert stats.kstest(now.real, stats.norm(scale=0.5**0.5).cdf).pvalue > ALPHA
        assert stats.kstest(np.angle(now), stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > ALPHA


@pytest.mark.parametrize("coherence_s", [0.2, 1.0])
def test_gains_forget_with_the_coherence_time_and_powers_twice_as_fast(coherence_s):
    seen = gains(40, 20, range_m=9.0, coherence_s=coherence_s)
    pairs = np.triu_indices(40, 1)
    first, power = seen[0][pairs], np.abs(seen[0][pairs]) ** 2
    for lag in (1, 3, 10):
        kept = np.exp(-lag * 0.1 / coherence_s)
        later = seen[lag][pairs]
        # E[g(0)* g(lag)] = kept; |g|^2 has mean and variance 1, so the covariance is kept^2.
        product = np.conj(first) * later
        assert abs(product.real.mean() - kept) < TWO_SIDED * product.real.std() / 780**0.5
        assert abs(product.imag.mean()) < TWO_SIDED * product.imag.std() / 780**0.5
        joint = (power - 1.0) * (np.abs(later) ** 2 - 1.0)
        assert abs(joint.mean() - kept**2) < TWO_SIDED * joint.std() / 780**0.5


def test_gains_belong_to_the_pair_and_pairs_are_independent():
    seen = gains(4, 4000, range_m=9.0, coherence_s=0.02)
    assert (seen == seen.transpose(0, 2, 1)).all()
    for one, other in (((0, 1), (0, 2)), ((0, 1), (2, 3)), ((1, 2), (1, 3))):
        product = seen[:, *one] * np.conj(seen[:, *other])
        assert abs(product.real.mean()) < TWO_SIDED * product.real.std() / 4000**0.5


def test_with_a_coherence_time_the_share_lost_is_as_without_and_both_directions_fare_alike():
    keys = {"range_m": 9.0, "exponent": 3.0}
    lost = Flown(
        channel(model(**keys, coherence_s=0.2), robots=40), 60, distances_m=np.full((40, 40), 6.0)
    ).lost(Cause.WEAK_SIGNAL)
    assert (lost == lost.transpose(0, 2, 1)).all()
    chance = 1.0 - np.exp(-((6.0 / 9.0) ** 3.0))
    pairs = np.triu_indices(40, 1)
    assert binomial(lost[0][pairs], chance) > ALPHA
    assert binomial(lost[59][pairs], chance) > ALPHA
    # Bursts: given a power p, the next one is a noncentral chi-square variable. Pairs of ticks 2 s
    # apart share nothing.
    kept, needed = np.exp(-0.5), (6.0 / 9.0) ** 3.0
    spread = (1.0 - kept**2) / 2.0

    def both_lost(power):
        law = stats.ncx2(2, kept**2 * power / spread)
        return np.exp(-power) * law.cdf(needed / spread)

    again = quad(both_lost, 0.0, needed)[0] / chance
    assert again > 1.3 * chance
    first, second = lost[[0, 20, 40]][:, *pairs], lost[[1, 21, 41]][:, *pairs]
    assert binomial(second[first], again) > ALPHA


@settings(deadline=None, derandomize=True, max_examples=15)
@given(
    keys=st.fixed_dictionaries(
        {"range_m": st.floats(3.0, 20.0), "exponent": st.floats(1.0, 6.0)},
        optional={
            "coherence_s": st.floats(0.05, 3.0),
            "shadowing_db": st.floats(0.5, 10.0),
            "shadowing_s": st.floats(0.1, 30.0),
        },
    ),
    nearer=st.floats(0.2, 0.99),
)
def test_a_shorter_way_loses_no_packet_that_the_longer_one_does_not(keys, nearer):
    apart = distances(np.random.default_rng(2).uniform(-9.0, 9.0, (5, 2)))
    chan = channel(model(**keys), robots=5)
    far, near = (Flown(chan, 60, distances_m=scale * apart).lost() for scale in (1.0, nearer))
    assert not (near & ~far).any()


@settings(deadline=None, derandomize=True, max_examples=15)
@given(rate=st.floats(0.05, 0.9), distance=st.floats(0.5, 15.0))
def test_bernoulli_and_fades_of_their_own_meet_the_same_draws(rate, distance):
    chance = 1.0 - np.exp(-((distance / 8.0) ** 2.0))
    apart = np.full((3, 3), distance)
    by_rate = Flown(channel(f"channel.loss={{model='bernoulli', rate={rate}}}", robots=3), 60)
    faded = Flown(channel(model(range_m=8.0), robots=3), 60, distances_m=apart)
    more, less = (by_rate, faded) if rate >= chance else (faded, by_rate)
    assert (more.lost() | ~less.lost()).all()


SHADOW = {"range_m": 9.0, "exponent": 3.0, "fading": "none"}


@pytest.mark.parametrize("sigma_db", [4.0, 8.0])
def test_shadowing_is_normal_in_decibels_fixed_and_the_same_both_ways(sigma_db):
    of = signals(60, **SHADOW, shadowing_db=sigma_db)
    state = path_loss.first_state(of)
    start = state.shadows
    pairs = np.triu_indices(60, 1)
    assert stats.kstest(start[pairs], stats.norm.cdf).pvalue > ALPHA
    assert (start == start.T).all()
    for tick in range(5):
        state, _ = path_loss.chances(of, state, tick, np.ones((60, 60)))
        assert (state.shadows == start).all()
    # Lost at d if 30 log10(range / d) + X < 0: the share of pairs is a normal probability.
    for distance in (5.0, 9.0, 14.0):
        lost = Flown(
            channel(model(**SHADOW, shadowing_db=sigma_db), robots=60),
            3,
            distances_m=np.full((60, 60), distance),
        ).lost()
        assert (lost == lost[0]).all()
        assert (lost[0] == lost[0].T).all()
        chance = stats.norm.cdf(30.0 * np.log10(distance / 9.0) / sigma_db)
        assert binomial(lost[0][pairs], chance) > ALPHA


def test_shadowing_that_drifts_stays_normal_and_forgets_with_its_time():
    of = signals(60, **SHADOW, shadowing_db=6.0, shadowing_s=1.0)
    state, seen = path_loss.first_state(of), []
    for tick in range(21):
        state, _ = path_loss.chances(of, state, tick, np.ones((60, 60)))
        seen.append(state.shadows[np.triu_indices(60, 1)])
    for shadows in (seen[0], seen[20]):
        assert stats.kstest(shadows, stats.norm.cdf).pvalue > ALPHA
    for lag in (1, 5, 20):
        product = seen[0] * seen[lag]
        kept = np.exp(-0.1 * lag)
        assert abs(product.mean() - kept) < TWO_SIDED * product.std() / len(product) ** 0.5


def test_shadowing_and_fading_together_lose_what_integration_over_both_says():
    keys = {"range_m": 9.0, "exponent": 3.0, "shadowing_db": 6.0}
    flown = Flown(channel(model(**keys), robots=60), 40, distances_m=np.full((60, 60), 7.0)).lost()
    x, weights = np.polynomial.hermite_e.hermegauss(60)
    success = np.exp(-((7.0 / 9.0) ** 3.0) * 10.0 ** (-6.0 * x / 10.0))
    chance = 1.0 - (weights * success).sum() / weights.sum()
    # Packets of a pair share its shadow: the pairs are what is independent.
    of_pairs = flown.mean(0)[np.triu_indices(60, 1)]
    assert abs(of_pairs.mean() - chance) < TWO_SIDED * of_pairs.std() / len(of_pairs) ** 0.5


def test_without_fading_and_shadowing_the_range_is_a_disc():
    apart = np.array([[0.0, 9.0, 8.99], [9.0, 0.0, 9.01], [0.01, 80.0, 0.0]])
    lost = Flown(channel(model(**SHADOW), robots=3), 50, distances_m=apart).lost()
    assert (lost == (apart > 9.0)).all()


def test_what_is_drawn_goes_on_while_nothing_is_sent():
    chan = channel(model(range_m=8.0, coherence_s=0.6, shadowing_db=5.0, shadowing_s=2.0))
    apart = LINE[:4, :4]
    always = Flown(chan, 200, distances_m=apart)
    sizes = np.random.default_rng(1).integers(0, 2, (200, 4))
    sometimes = Flown(chan, 200, distances_m=apart, sizes_bytes=lambda tick: sizes[tick])
    sent = sizes[:, :, None] > 0
    assert (sometimes.due == np.where(sent, always.due, 0)).all()


def test_seeds_differ_and_a_seed_is_the_same_again():
    keys = {"range_m": 8.0, "coherence_s": 0.6, "shadowing_db": 5.0}
    one, again, other = (
        Flown(channel(model(**keys), seed=seed), 100, distances_m=LINE[:4, :4]).due
        for seed in (1, 1, 2)
    )
    assert (one == again).all()
    assert (one != other).any()


def test_a_link_of_its_own_has_its_own_signal_and_leaves_the_others_theirs():
    own = "channel.links=[{sender='r1', receiver='r2', loss={model='path-loss', range_m=0.001}}]"
    keys = {"range_m": 8.0, "coherence_s": 0.6, "shadowing_db": 5.0}
    plain, over = (
        Flown(channel(model(**keys), *more, robots=3), 100, distances_m=LINE[:3, :3])
        for more in ((), (own,))
    )
    assert over.lost()[:, 0, 1].all()
    rest = links_of(3)
    rest[0, 1] = False
    assert (plain.due[:, rest] == over.due[:, rest]).all()


def test_robots_at_one_place_hear_each_other():
    chan = channel(model(range_m=8.0, shadowing_db=9.0), robots=3)
    _, fates = radio.transmit(chan, radio.initial(chan), radio.Sending(0, None, np.zeros((3, 3))))
    assert (fates.due[links_of(3)] > 0).all()
