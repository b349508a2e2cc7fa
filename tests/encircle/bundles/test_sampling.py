"""The sample of rows, and what may escape it: against all samples and all places there are."""

from collections import Counter
from itertools import combinations, product
from math import comb

import pytest
from hypothesis import given
from hypothesis import strategies as st

from encircle.bundles.sampling import altered_max, escape_probability, sampled

SMALL = [(c, s, n) for c in (1, 2, 3) for s in (1, 2, 3) for n in range(c * s + 1)]


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 150), st.integers(0, 2**32 - 1))
def test_a_sample_has_as_many_runs_as_asked_for_evenly_over_cells(cells, seeds, count, seed):
    chosen = sampled(range(cells), range(1, seeds + 1), count, seed)
    assert chosen == sorted(set(chosen))
    assert len(chosen) == min(count, cells * seeds)
    assert all(0 <= cell < cells and 1 <= own <= seeds for cell, own in chosen)
    counts = Counter(cell for cell, _ in chosen)
    of_each = [counts[cell] for cell in range(cells)]
    assert max(of_each) - min(of_each) <= 1
    assert chosen == sampled(range(cells), range(1, seeds + 1), count, seed)


def test_every_run_is_drawn_as_often_as_any_other():
    draws = 4000
    counts = Counter(
        run for seed in range(draws) for run in sampled((0, 3, 4), (1, 2, 5, 9), 5, seed)
    )
    assert len(counts) == 12
    # Five of twelve each; the standard deviation of a count is 31.
    assert all(abs(n - draws * 5 / 12) < 160 for n in counts.values())


def all_samples(cells, seeds, count):
    """Every sample with its probability: which cells have one more, and which runs of each."""
    each, rest = divmod(count, cells)
    for more in combinations(range(cells), rest):
        parts = [combinations(range(seeds), each + (cell in more)) for cell in range(cells)]
        chance = 1.0 / comb(cells, rest)
        for cell in range(cells):
            chance /= comb(seeds, each + (cell in more))
        for chosen in product(*parts):
            yield {(cell, k) for cell, own in enumerate(chosen) for k in own}, chance


def worst_by_brute_force(cells, seeds, count, altered):
    """The largest probability of escape over all places of the altered rows."""
    samples = list(all_samples(cells, seeds, count))
    assert sum(chance for _, chance in samples) == pytest.approx(1.0)
    rows = list(product(range(cells), range(seeds)))
    return max(
        sum(chance for sample, chance in samples if not sample & set(places))
        for places in combinations(rows, altered)
    )


@pytest.mark.parametrize(("cells", "seeds", "count"), SMALL)
def test_the_probability_of_escape_is_that_of_the_worst_places(cells, seeds, count):
    for altered in range(cells * seeds + 1):
        worst = worst_by_brute_force(cells, seeds, count, altered)
        assert escape_probability(cells, seeds, count, altered) == pytest.approx(worst, abs=1e-12)


@pytest.mark.parametrize(
    ("seeds", "count", "altered"), [(40, 20, 5), (5000, 20, 700), (100, 1, 95)]
)
def test_in_one_cell_it_is_the_hypergeometric_distribution(seeds, count, altered):
    expected = comb(seeds - altered, count) / comb(seeds, count)
    assert escape_probability(1, seeds, count, altered) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("cells", "seeds", "count"), [(50, 100, 20), (1, 5000, 20), (8, 25, 33)])
def test_what_may_have_escaped_is_the_most_that_is_still_as_likely_as_one_in_twenty(
    cells, seeds, count
):
    most = altered_max(cells, seeds, count)
    assert escape_probability(cells, seeds, count, most) >= 0.05
    assert escape_probability(cells, seeds, count, most + 1) < 0.05


def test_twenty_of_five_thousand_rows_leave_an_eighth_open():
    """One run from each of twenty of fifty cells: the share p with (1 - p)^20 = 0.05 is 13.9 %."""
    assert altered_max(50, 100, 20) / 5000 == pytest.approx(1 - 0.05**0.05, abs=0.001)


def test_nothing_escapes_when_all_is_run_and_anything_when_nothing_is():
    assert altered_max(6, 5, 30) == 0
    assert altered_max(6, 5, 0) == 30
