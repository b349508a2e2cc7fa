"""Coverage of intervals and rate of wrong verdicts, over distributions like those of real hunts.

What is true of a shape is summed over its law. Each share is held against bounds that it would miss
by chance less than once in a million; seeds are fixed besides. A push counts some studies of each
shape; ``pytest -m nightly -n 0 -rP tests/encircle/statistics/test_decisions.py`` counts more, holds
them against closer bounds, and prints them.
"""

from collections import Counter

import numpy as np
import pytest
from helpers_intervals import SHAPES, TICKS_MAX, assert_covers, holds

from encircle.statistics.comparisons import (
    Verdict,
    holm_corrected,
    order_difference,
    paired_difference,
    rate_difference,
)
from encircle.statistics.intervals import restricted_mean_time

SEEDS = (20, 40, 100)
CLAIMS = ("rate", "order", "mean")
MEASURED = ("cell", *CLAIMS)
STUDIES, STUDIES_NIGHTLY = 300, 4000


def compared(ticks):
    """The tests of the three outcomes of a study (S, 2) of two cells."""
    a, b = ticks.T
    return {
        "rate": rate_difference(a < TICKS_MAX, b < TICKS_MAX),
        "order": order_difference(a, b),
        "mean": paired_difference(a, b, TICKS_MAX),
    }


def so(truth):
    """The correct verdict; undecided if there is no difference."""
    if abs(truth) < 1e-9:
        return None
    return Verdict.HIGHER if truth > 0.0 else Verdict.LOWER


def counted(shape, seeds, studies):
    """How often intervals cover, how often verdicts are right or wrong, and the sum of widths."""
    counts, width = Counter(), Counter()
    for ticks in shape.runs(np.random.default_rng([seeds, studies]), studies, seeds):
        b = ticks[:, 1]
        cell = restricted_mean_time(b, b < TICKS_MAX, TICKS_MAX)
        tests = compared(ticks)
        intervals = {"cell": (cell, shape.mean_b)}
        intervals |= {name: (tests[name].mean, getattr(shape, name)) for name in CLAIMS}
        for name, (interval, truth) in intervals.items():
            counts[name] += holds(interval, truth)
            width[name] += interval.high - interval.low
        for name, test in tests.items():
            right = so(getattr(shape, name))
            counts[f"{name} right"] += test.uncorrected_verdict is right
            counts[f"{name} wrong"] += test.uncorrected_verdict not in (right, Verdict.UNDECIDED)
    return counts, width


def hits(count, studies):
    return np.arange(studies) < count


@pytest.mark.parametrize("seeds", SEEDS)
@pytest.mark.parametrize("name", SHAPES)
def test_intervals_cover_and_decisions_are_rarely_wrong(name, seeds):
    counts, _ = counted(SHAPES[name], seeds, STUDIES)
    for what in MEASURED:
        assert_covers(hits(counts[what], STUDIES), 0.95, 1.0)
    for what in CLAIMS:
        assert_covers(hits(counts[f"{what} wrong"], STUDIES), 0.0, 0.05)


@pytest.mark.nightly
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seeds", SEEDS)
@pytest.mark.parametrize("name", SHAPES)
def test_many_intervals_cover_and_decisions_are_rarely_wrong(name, seeds):
    counts, width = counted(SHAPES[name], seeds, STUDIES_NIGHTLY)

    def shares(*names):
        return " ".join(f"{100 * counts[name] / STUDIES_NIGHTLY:5.1f}" for name in names)

    print(
        f"{seeds:3d} seeds, {name:42s}: cover {shares(*MEASURED)};"
        f" wrong {shares(*(f'{what} wrong' for what in CLAIMS))};"
        f" right {shares(*(f'{what} right' for what in CLAIMS))};"
        f" ticks wide {width['cell'] / STUDIES_NIGHTLY:.1f} {width['mean'] / STUDIES_NIGHTLY:.1f}"
    )
    # Wilson's coverage oscillates with the rate; it is lowest for a cell in which few runs fail.
    assert_covers(hits(counts["cell"], STUDIES_NIGHTLY), 0.92, 1.0)
    for what in CLAIMS:
        assert_covers(hits(counts[what], STUDIES_NIGHTLY), 0.945, 1.0)
        assert_covers(hits(counts[f"{what} wrong"], STUDIES_NIGHTLY), 0.0, 0.05)


@pytest.mark.parametrize("common", [0.0, 0.7])
@pytest.mark.parametrize("name", ["alike, 2 % fail", "alike, 5 % fail", "1 against 5 % fail"])
def test_averages_over_settings_cover_and_are_rarely_wrong(name, common):
    # Five settings on 40 seeds; for a share of the seeds all settings end like the first one.
    shape, studies, seeds = SHAPES[name], 300, 40
    rng = np.random.default_rng(11)
    ticks = shape.runs(rng, studies, seeds * 5).reshape(studies, seeds, 5, 2)
    alike = rng.random((studies, seeds)) < common
    ticks[alike] = ticks[alike][:, :1]
    counts = Counter()
    for study in ticks:
        a, b = np.moveaxis(study, -1, 0)
        cell = restricted_mean_time(b.T, b.T < TICKS_MAX, TICKS_MAX)
        rates = [(x < TICKS_MAX).mean(axis=1) for x in (a, b)]
        rate = paired_difference(*rates, 1.0, less_is_better=False)
        time = paired_difference(a.mean(axis=1), b.mean(axis=1), TICKS_MAX)
        counts["cell"] += holds(cell, shape.mean_b)
        for what, test, truth in (("rate", rate, shape.rate), ("mean", time, shape.mean)):
            counts[what] += holds(test.mean, truth)
            counts[f"{what} wrong"] += test.uncorrected_verdict not in (
                so(truth),
                Verdict.UNDECIDED,
            )
    for what in ("cell", "rate", "mean"):
        assert_covers(hits(counts[what], studies), 0.95, 1.0)
    for what in ("rate wrong", "mean wrong"):
        assert_covers(hits(counts[what], studies), 0.0, 0.05)


def test_a_report_of_many_comparisons_is_rarely_wrong_at_all():
    # 8 comparisons of equal cells: without correction one report in three has a wrong verdict.
    shape, studies, single = SHAPES["alike, 5 % fail"], 150, 8
    ticks = shape.runs(np.random.default_rng(7), studies * single, 100)
    alone, together = [], []
    for study in ticks.reshape(studies, single, 100, 2):
        tests = holm_corrected([test for one in study for test in compared(one).values()])
        alone.append(any(test.uncorrected_verdict is not Verdict.UNDECIDED for test in tests))
        together.append(any(test.verdict is not Verdict.UNDECIDED for test in tests))
    assert np.mean(alone) > 0.2
    assert_covers(together, 0.0, 0.05)


@pytest.mark.parametrize("seeds", SEEDS)
def test_a_difference_that_all_seeds_show_is_decided_whatever_may_still_fail(seeds):
    # 36 against 45 ticks, all captured: unseen failures could change the mean, but not the order.
    rng = np.random.default_rng(2)
    ticks = np.stack((rng.integers(34, 39, seeds), rng.integers(43, 48, seeds)), axis=-1)
    counts = compared(ticks.astype(float))
    assert counts["order"].uncorrected_verdict is Verdict.HIGHER
    assert counts["order"].mean.value == 1.0
    assert counts["mean"].mean.low < counts["mean"].mean.value < counts["mean"].mean.high
    assert counts["rate"].uncorrected_verdict is Verdict.UNDECIDED
