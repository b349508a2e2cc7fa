"""Draws: against a Philox written out by hand (Salmon et al., SC 2011), and as promised."""

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from encircle.world.random_streams import (
    Purpose,
    block_ticks,
    link_block,
    link_uniforms,
    normal_pairs,
    uniforms,
)

ALPHA = 1e-3
WORD = 2**64 - 1
MULTIPLIERS = (0xD2E7470EE14C6C93, 0xCA5A826395121157)
WEYL = (0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B)
SEEDS = st.integers(0, 2**63 - 1)
PURPOSES = st.sampled_from(Purpose)
TICKS = st.integers(0, 2**63)


def philox(counter, key):
    """Philox4x64-10: four words of counter and two of key to four random words."""
    a, b, c, d = counter
    k, m = key
    for _ in range(10):
        high_a, low_a = divmod(a * MULTIPLIERS[0], 2**64)
        high_c, low_c = divmod(c * MULTIPLIERS[1], 2**64)
        a, b, c, d = high_c ^ b ^ k, low_c, high_a ^ d ^ m, low_a
        k, m = (k + WEYL[0]) & WORD, (m + WEYL[1]) & WORD
    return a, b, c, d


def expected(seed, purpose, tick, count):
    """The draws that seed, purpose and tick mean: 53 bits of each word, block after block."""
    words = []
    block = 1  # numpy counts on before each block
    while len(words) < count:
        words += philox((block, 0, tick, 0), (seed, int(purpose)))
        block += 1
    return [(word >> 11) * 2.0**-53 for word in words[:count]]


@settings(deadline=None, derandomize=True, max_examples=60)
@given(seed=SEEDS, purpose=PURPOSES, tick=TICKS, count=st.integers(1, 40))
def test_draws_are_philox_with_seed_and_purpose_as_key_and_the_tick_as_counter(
    seed, purpose, tick, count
):
    assert uniforms(seed, purpose, tick, count).tolist() == expected(seed, purpose, tick, count)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    seed=SEEDS, purpose=PURPOSES, tick=TICKS, count=st.integers(0, 300), more=st.integers(1, 300)
)
def test_draw_k_is_the_same_however_many_are_taken(seed, purpose, tick, count, more):
    few = uniforms(seed, purpose, tick, count)
    assert len(few) == count
    assert (uniforms(seed, purpose, tick, count + more)[:count] == few).all()


@pytest.mark.parametrize("robots", [1, 2, 4, 9, 40])
@pytest.mark.parametrize("more", [1, 3])
def test_a_link_has_the_same_draw_whatever_the_size_of_the_team(robots, more):
    small = link_uniforms(5, Purpose.LOSS, 17, robots)
    large = link_uniforms(5, Purpose.LOSS, 17, robots + more)
    assert small.shape == (robots, robots)
    assert (large[:robots, :robots] == small).all()


def place(sender, receiver):
    """Szudzik's pairing: where a link's draw stands, whatever the size of the team."""
    if sender < receiver:
        return receiver**2 + sender
    return sender**2 + sender + receiver


@settings(deadline=None, derandomize=True, max_examples=40)
@given(seed=SEEDS, purpose=PURPOSES, tick=TICKS, robots=st.integers(1, 9))
def test_links_draw_what_their_seed_purpose_and_tick_mean_whatever_is_drawn_at_once(
    seed, purpose, tick, robots
):
    drawn = link_uniforms(seed, purpose, tick, robots)
    places = expected(seed, purpose, tick, robots * robots)
    for sender in range(robots):
        for receiver in range(robots):
            assert drawn[sender, receiver] == places[place(sender, receiver)]


@pytest.mark.parametrize("robots", [1, 2, 4, 8, 9, 16, 33, 64, 65, 256])
def test_a_block_holds_its_ticks_one_by_one_and_is_of_bounded_size(robots):
    ticks = block_ticks(robots**2)
    block = link_block(3, Purpose.LOSS, 2, robots)
    assert block.shape == (ticks, robots, robots)
    assert 1 <= ticks <= 64
    assert ticks == 1 or block.size <= 4096
    for k in (0, ticks // 2, ticks - 1):
        assert (block[k] == link_uniforms(3, Purpose.LOSS, 2 * ticks + k, robots)).all()
        by_place = uniforms(3, Purpose.LOSS, 2 * ticks + k, robots**2)
        assert block[k][-1, 0] == by_place[place(robots - 1, 0)]


@settings(deadline=None, derandomize=True, max_examples=40)
@given(seed=SEEDS, purpose=PURPOSES, tick=TICKS, robots=st.integers(1, 40))
def test_normal_draws_are_the_quantiles_that_their_uniform_ones_are_of(seed, purpose, tick, robots):
    drawn = normal_pairs(seed, purpose, tick, robots)
    uniform = np.array(expected(seed, purpose, tick, 2 * robots)).reshape(robots, 2)
    assert (drawn == stats.norm.ppf(uniform)).all()


@pytest.mark.parametrize("draw", [link_uniforms, normal_pairs])
def test_draws_that_are_kept_cannot_be_changed(draw):
    for _ in range(2):
        drawn = draw(1, Purpose.LOSS, 5, 4)
        with pytest.raises(ValueError, match="read-only"):
            drawn[0, 1] = 0.5


def test_numbers_of_purposes_are_never_changed():
    assert {purpose.name: purpose.value for purpose in Purpose} == {
        "PLACEMENT": 1,
        "DETECTION_NOISE": 2,
        "LOSS": 3,
        "BURST_STATE": 4,
        "BURST_LOSS": 5,
        "DELAY": 6,
        "JITTER": 7,
        "TRACE_START": 8,
        "COPY": 9,
        "COPY_DELAY": 10,
        "ROBOT_RADIO_LOSS": 11,
        "LOCALISATION_NOISE": 12,
        "LOCALISATION_DRIFT": 13,
        "FADING": 14,
        "FADING_PHASE": 15,
        "SHADOWING": 16,
        "CONTENTION": 17,
    }


@pytest.mark.parametrize("robots", [2, 7, 64])
def test_no_two_links_share_a_draw(robots):
    assert len(np.unique(link_uniforms(1, Purpose.DELAY, 0, robots))) == robots**2


@pytest.mark.parametrize("purpose", Purpose)
@pytest.mark.parametrize("seed", [0, 1, 2**63 - 1])
def test_draws_of_one_tick_are_uniform(purpose, seed):
    drawn = uniforms(seed, purpose, 3, 20_000)
    assert (drawn >= 0.0).all()
    assert (drawn < 1.0).all()
    assert stats.kstest(drawn, "uniform").pvalue > ALPHA


@pytest.mark.parametrize("purpose", [Purpose.LOSS, Purpose.DELAY])
def test_draws_of_one_link_are_uniform_over_ticks_and_seeds(purpose):
    over_ticks = [link_uniforms(7, purpose, tick, 3)[2, 0] for tick in range(3000)]
    over_seeds = [link_uniforms(seed, purpose, 7, 3)[2, 0] for seed in range(3000)]
    assert stats.kstest(over_ticks, "uniform").pvalue > ALPHA
    assert stats.kstest(over_seeds, "uniform").pvalue > ALPHA


def test_streams_of_other_purposes_ticks_and_seeds_are_uncorrelated():
    streams = [
        uniforms(seed, purpose, tick, 5000)
        for seed in (1, 2, 2**32)
        for purpose in (Purpose.PLACEMENT, Purpose.LOSS, Purpose.DELAY)
        for tick in (0, 1, 2**32)
    ]
    correlations = np.corrcoef(streams)[np.triu_indices(len(streams), 1)]
    # Under independence each is normal with deviation 1 / sqrt(5000); Bonferroni over the pairs.
    bound = stats.norm.isf(ALPHA / 2 / len(correlations)) / 5000**0.5
    assert abs(correlations).max() < bound


def test_ticks_of_one_link_are_uncorrelated_with_the_next_ones():
    drawn = np.array([link_uniforms(3, Purpose.LOSS, tick, 4).ravel() for tick in range(2000)])
    bound = stats.norm.isf(ALPHA / 2 / (3 * 16)) / 2000**0.5
    for lag in (1, 2, 5):
        for link in range(16):
            series = drawn[:, link]
            assert abs(np.corrcoef(series[lag:], series[:-lag])[0, 1]) < bound


def test_draws_neither_use_nor_change_global_generators():
    np.random.seed(1)
    random.seed(1)
    before = (np.random.get_state()[1].tobytes(), random.getstate())
    first = uniforms(1, Purpose.LOSS, 0, 8)
    assert (np.random.get_state()[1].tobytes(), random.getstate()) == before
    np.random.seed(2)
    assert (uniforms(1, Purpose.LOSS, 0, 8) == first).all()
