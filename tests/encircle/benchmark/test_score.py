"""Scores, intervals and ranks against closed forms, scipy and enumeration."""

from itertools import combinations

import numpy as np
import pytest
from helpers_benchmark import made_outcomes
from scipy import stats

from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.publish import PAGE
from encircle.benchmark.published import published
from encircle.benchmark.score import (
    independent_difference,
    rank_shares,
    resampled_scores,
    scores,
    share_interval,
)
from encircle.statistics.comparisons import Verdict, holm_p, sign_flip_p
from encircle.statistics.intervals import Interval


def test_a_score_is_the_mean_over_tasks_of_the_share_of_captures():
    outcomes = made_outcomes([0.8, 0.3, 0.5], seed=3)
    by_hand = {
        name: np.mean([np.mean([tick > 0 for tick in runs]) for runs in outcomes.capture_ticks[k]])
        for k, name in enumerate(outcomes.policies)
    }
    ranked = scores(outcomes).of
    assert {s.policy: s.over_all.value for s in ranked} == pytest.approx(by_hand)
    assert [s.policy for s in ranked] == sorted(by_hand, key=by_hand.get, reverse=True)
    assert [s.rank for s in ranked] == [1, 2, 3]


def test_the_time_score_counts_a_run_without_capture_as_the_whole_limit():
    ticks = np.array([[[50, 0], [40, 200]]])
    outcomes = Outcomes(("p",), ("a-3-x", "b-3-x"), (1, 2), ticks, np.array([100, 200]))
    (score,) = scores(outcomes).of
    assert score.time.value == pytest.approx(np.mean([0.5, 1.0, 0.2, 1.0]))


def test_the_interval_over_seeds_is_student_s_with_a_seed_of_everything_and_one_of_nothing():
    means = np.random.default_rng(4).random(30)
    more = np.append(means, (0.0, 1.0))
    expected = stats.t.interval(0.95, 31, more.mean(), stats.sem(more))
    assert share_interval(means) == pytest.approx((means.mean(), *expected))


def test_the_interval_over_seeds_keeps_a_width_if_all_runs_end_alike():
    value, low, high = share_interval(np.ones(100))
    assert (value, high) == (1.0, 1.0)
    assert 0.95 < low < 0.99


def test_the_interval_over_seeds_covers_the_truth():
    rng = np.random.default_rng(6)
    rates = rng.random(24)
    trials = rng.random((2000, 24, 20)) < rates[:, None]
    bounds = [share_interval(trial.mean(axis=0)) for trial in trials]
    covered = np.mean([b.low <= rates.mean() <= b.high for b in bounds])
    # A share of 2,000 has a standard error of half a point.
    assert covered > 0.935


def test_resamples_of_seeds_and_tasks_have_the_variance_of_their_closed_form():
    captured = made_outcomes([0.5, 0.2], seed=1, seeds=9, tasks=7).captured
    drawn = resampled_scores(captured, 40_000)
    for runs, values in zip(captured.astype(float), drawn.T, strict=True):
        tasks, seeds = runs.shape
        # E[w_i w_j] of multinomial weights of n draws from n: 1 + (i == j) - 1 / n.
        of_tasks = 1.0 - 1.0 / tasks + np.eye(tasks)
        of_seeds = 1.0 - 1.0 / seeds + np.eye(seeds)
        square = np.einsum("ts,ur,tu,sr->", runs, runs, of_tasks, of_seeds) / runs.size**2
        variance = square - runs.mean() ** 2
        assert values.mean() == pytest.approx(runs.mean(), abs=5 * np.sqrt(variance / 40_000))
        assert values.var() == pytest.approx(variance, rel=0.05)


def test_resamples_of_the_seeds_of_one_task_are_as_scipy_draws_them():
    captured = made_outcomes([0.4], seed=8, seeds=40, tasks=1).captured
    drawn = resampled_scores(captured, 20_000)[:, 0]
    theirs = stats.bootstrap(
        (captured[0, 0].astype(float),), np.mean, n_resamples=20_000, rng=2, method="percentile"
    )
    # Bounds are multiples of 1 / 40, so that draws of different streams may be one apart.
    ours = np.quantile(drawn, (0.025, 0.975))
    assert ours == pytest.approx(tuple(theirs.confidence_interval), abs=0.0251)


def test_the_wide_interval_never_lies_inside_the_narrow_one():
    for rates in ([1.0, 0.0], [0.5, 0.5], [0.9, 0.1]):
        for score in scores(made_outcomes(rates)).of:
            assert score.over_all.low <= score.over_seeds.low
            assert score.over_all.high >= score.over_seeds.high


def test_shares_of_ranks_by_enumeration():
    drawn = np.random.default_rng(2).integers(0, 4, (300, 5)) / 3.0
    expected = np.zeros((5, 5))
    for row in drawn:
        for policy in range(5):
            above = int((row > row[policy]).sum())
            equal = int((row == row[policy]).sum())
            expected[policy, above : above + equal] += 1.0 / equal
    shares = rank_shares(drawn)
    assert shares == pytest.approx(expected / 300)
    assert shares.sum(axis=0) == pytest.approx(1.0)
    assert shares.sum(axis=1) == pytest.approx(1.0)


def test_pairs_are_tested_within_seeds_and_corrected_together():
    outcomes = made_outcomes([0.9, 0.5, 0.45], seed=5)
    ranked = scores(outcomes)
    means = dict(zip(outcomes.policies, outcomes.captured.mean(axis=1), strict=True))
    names = [score.policy for score in ranked.of]
    couples = list(combinations(names, 2))
    assert [(pair.a, pair.b) for pair in ranked.pairs] == couples
    alone = [sign_flip_p(means[b] - means[a]) for a, b in couples]
    assert [pair.difference.p for pair in ranked.pairs] == pytest.approx(alone)
    corrected = [pair.difference.p_corrected for pair in ranked.pairs]
    assert corrected == pytest.approx(holm_p(alone))
    assert ranked.pair("p0", "p1").mean.value == pytest.approx(
        means["p1"].mean() - means["p0"].mean()
    )


def test_clear_differences_leave_one_rank_and_no_difference_leaves_all():
    ranked = scores(made_outcomes([0.1, 0.9, 0.5], seeds=60)).of
    assert [(s.policy, s.best, s.worst) for s in ranked] == [
        ("p1", 1, 1),
        ("p2", 2, 2),
        ("p0", 3, 3),
    ]
    assert [s.rank_shares[k] for k, s in enumerate(ranked)] == pytest.approx([1.0] * 3, abs=0.05)
    same = made_outcomes([0.5], seeds=30)
    twice = Outcomes(
        ("a", "b"), same.tasks, same.seeds, same.capture_ticks[[0, 0]], same.limit_ticks
    )
    for score in scores(twice).of:
        assert (score.rank, score.best, score.worst) == (1, 1, 2)
        assert score.rank_shares == pytest.approx([0.5, 0.5])
    assert scores(twice).pairs[0].difference.verdict is Verdict.UNDECIDED


def test_a_single_seed_has_no_bounds_of_either_kind_and_no_shares_of_ranks():
    ranked = scores(made_outcomes([0.5, 0.9, 0.0], seeds=1))
    for score in ranked.of:
        assert np.isnan([*score.over_seeds[1:], *score.over_all[1:], *score.time[1:]]).all()
        assert np.isnan(score.rank_shares).all()
        assert not score.is_bounded
        assert (score.best, score.worst) == (1, 3)
        assert score.over_all.value == pytest.approx(score.over_seeds.value)
    assert all(pair.difference.verdict is Verdict.UNDECIDED for pair in ranked.pairs)
    assert all(score.is_bounded for score in scores(made_outcomes([0.5], seeds=2)).of)


def test_twelve_seeds_are_the_fewest_that_can_decide_anything_among_twelve_policies():
    """The smallest p of S sign flips is 2 / 2^S; Holm's first is that of 66 pairs."""
    fewest = next(seeds for seeds in range(1, 100) if 66 * 2 / 2**seeds <= 0.05)
    assert fewest == 12
    for seeds, decided in ((fewest - 1, 0), (fewest, 11)):
        ranked = scores(made_outcomes([1.0, *[0.0] * 11], seeds=seeds))
        assert sum(pair.difference.verdict is not Verdict.UNDECIDED for pair in ranked.pairs) == (
            decided
        )


def test_what_the_page_says_of_a_first_try_with_three_seeds():
    means = published().outcomes.captured.mean(axis=1)
    widths = [
        bounds.high - bounds.low
        for policy in means
        for bounds in map(share_interval, policy[:99].reshape(33, 3))
    ]
    assert 0.75 <= min(widths) < 0.76
    assert sign_flip_p(np.array([0.2, 0.4, 0.6])) == 0.25
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert "no p is below 0.25" in text
    assert "are 75 points wide or wider" in text
    assert "nothing can be decided with fewer than 12 seeds" in text


def test_a_difference_of_independent_estimates_is_that_of_two_normal_means():
    # Symmetric intervals of half widths 3 and 4: the difference has half width 5.
    difference = independent_difference(Interval(10.0, 7.0, 13.0), Interval(30.0, 26.0, 34.0))
    assert difference == pytest.approx((20.0, 15.0, 25.0))


def test_the_same_runs_give_the_same_scores():
    outcomes = made_outcomes([0.4, 0.6])
    first, second = scores(outcomes), scores(outcomes)
    assert [s.over_all for s in first.of] == [s.over_all for s in second.of]
    assert all(
        (a.rank_shares == b.rank_shares).all() for a, b in zip(first.of, second.of, strict=True)
    )
