"""Sentences of a study where numbers have no bounds, or bounds beyond the levels."""

import re
from contextlib import closing
from math import inf, nan
from types import SimpleNamespace

import pytest
from helpers_studies import LOSS, Truth, filled, loss_only, never, study_plan

from encircle.statistics.comparisons import Difference
from encircle.statistics.intervals import Interval, capture_rate
from encircle.studies.report.result_tables import result_tables
from encircle.studies.report.sentences import summary_sentences
from encircle.studies.summary import Comparison, OverallComparison, Tolerance, summarise

PLAN = study_plan(axes=[LOSS], strategies=["xi-star", "xi-0"])
AT = {"strategy": "xi-0"}
CELL = SimpleNamespace(rate=capture_rate([True, False]), runs=2, levels=PLAN.levels(0))


def always(_levels):
    return Truth(0.1)


def sentences_of(*, tolerances=(), comparisons=(), overall=()):
    """The sentences after the first one, of a study with the given parts only."""
    parts = {"tolerances": tolerances, "comparisons": comparisons, "overall": overall}
    return summary_sentences(SimpleNamespace(plan=PLAN, cells=[CELL], **parts))[1:]


def tolerance(value, low, high, rising=False):
    (sentence,) = sentences_of(
        tolerances=[Tolerance("loss", AT, Interval(value, low, high), rising)]
    )
    return sentence


UP_TO = "Capture stays at or above 90 % at strategy xi-0 up to"
BELOW = "Capture is below 90 % at strategy xi-0 even at packet loss 0 %"
FROM = "Capture is at or above 90 % at strategy xi-0 from"


@pytest.mark.parametrize(
    ("level", "sentence"),
    [
        (
            (0.8, -inf, inf),
            f"{UP_TO} 80 %, the largest packet loss tried, surely at no level tried.",
        ),
        ((0.8, 0.0, inf), f"{UP_TO} 80 %, the largest packet loss tried, surely up to 0 %."),
        ((0.8, 0.57, inf), f"{UP_TO} 80 %, the largest packet loss tried, surely up to 57 %."),
        ((0.8, 0.8, inf), f"{UP_TO} 80 %, the largest packet loss tried."),
        ((0.5, -inf, inf), f"{UP_TO} packet loss 50 % [below 0, beyond 80]."),
        ((0.5, 0.45, 0.55), f"{UP_TO} packet loss 50 % [45, 55]."),
        ((0.0, -inf, 0.13), f"{UP_TO} packet loss 0 % [below 0, 13]."),
        ((nan, -inf, 0.0), f"{BELOW}."),
        ((nan, -inf, 0.33), f"{BELOW}, surely below from 33 % on."),
        ((nan, -inf, inf), f"{BELOW}, surely below at no level tried."),
        ((0.5, 0.45, 0.55, True), f"{FROM} packet loss 50 % [45, 55] on."),
        ((0.5, -inf, inf, True), f"{FROM} packet loss 50 % [below 0, beyond 80] on."),
        ((0.8, 0.7, inf, True), f"{FROM} packet loss 80 % [70, beyond 80] on."),
    ],
)
def test_a_tolerance_is_no_surer_than_its_bounds(level, sentence):
    assert tolerance(*level) == sentence


def test_a_bound_that_is_infinite_is_never_called_sure_of_a_level():
    # Bounds as the statistics give them: infinite, or between the levels.
    bounds = [-inf, 0.0, 0.13, 0.8, inf]
    for value in (nan, 0.0, 0.13, 0.8):
        for low in bounds[:-1]:
            for high in bounds[1:]:
                for rising in (False, True):
                    if value != value and (rising or low != -inf):
                        continue
                    if not (low <= value <= high or value != value):
                        continue
                    sentence = tolerance(value, low, high, rising)
                    assert not re.search(r"\b(nan|inf)\b", sentence)
                    sure = re.search(r"surely (?:up to|below from) (\d+)", sentence)
                    if sure:
                        bound = high if value != value else low
                        assert float(sure[1]) == pytest.approx(100 * bound)


def test_settings_together_are_no_surer_than_each():
    levels = [(0.8, -inf, inf), (nan, -inf, inf), (nan, -inf, 0.0), (0.5, 0.4, 0.6)]
    ones = [Tolerance("loss", AT, Interval(*level), False) for level in levels]
    (sentence,) = sentences_of(tolerances=ones)
    assert "up to 80 %, the largest tried, surely at no level tried;" in sentence
    assert "not even at the first level, surely below at no level tried;" in sentence
    assert "not even at the first level;" in sentence
    (sentence,) = sentences_of(tolerances=ones * 2)
    assert "up to between 50 and 80 % in 4, surely at no level in 2, not even" in sentence


def difference(mean, p=1.0, p_corrected=1.0, ties=0, pairs=20, effect=nan):
    better = worse = (pairs - ties) // 2
    return Difference(mean, Interval(effect), better, worse, ties, pairs, p, p_corrected)


def sentence_of(test):
    one = Comparison("xi-0", "xi-star", {"loss": 0.2}, test, test, test, nan)
    over = OverallComparison("xi-0", "xi-star", 5, test, test, test)
    return sentences_of(comparisons=[one], overall=[over])


def test_a_single_seed_has_no_interval_and_no_p():
    for sentence in sentence_of(difference(Interval(0.25), pairs=1)):
        assert not re.search(r"\b(nan|inf|p)\b", sentence)
        assert "capture rate undecided (+25 points, a single seed)" in sentence
        assert "+0.25 s, a single seed)" in sentence


def test_what_is_the_same_with_every_seed_keeps_its_interval():
    for sentence in sentence_of(difference(Interval(0.0, -0.1, 0.1), ties=20)):
        assert "capture rate the same with every seed (+0 [-10, +10] points, p 1.000," in sentence


def test_what_only_the_uncorrected_p_decides_is_told_as_that():
    low = difference(Interval(-0.2, -0.3, -0.1), p=0.004, p_corrected=0.08)
    for sentence in sentence_of(low):
        sentences_of = (
            "undecided after correction (-20 [-30, -10] points, p 0.004, corrected 0.080)"
        )
        assert f"capture rate {sentences_of}" in sentence
        assert sentence.count("undecided after correction") == 3
        assert not re.search(r"\b(higher|lower|later in more)\b", sentence)


def test_a_decision_is_never_against_its_own_p_or_interval():
    bounds = ((-0.3, -0.1), (-0.1, 0.3), (0.1, 0.3), (0.0, 0.2), (nan, nan))
    for low, high in bounds:
        for p_corrected in (0.0001, 0.05, 0.051, 1.0):
            mean = Interval((low + high) / 2 if low == low else 0.1, low, high)
            for sentence in sentence_of(difference(mean, p_corrected / 3, p_corrected)):
                claimed = re.findall(r"\b(higher|lower|in more seeds)\b", sentence)
                decided = p_corrected <= 0.05 and (low > 0 or high < 0)
                # Once for the mean over all settings, once for the only setting.
                assert len(claimed) == (6 if decided else 0)


@pytest.mark.parametrize("truth", [never, always, loss_only])
@pytest.mark.parametrize("seeds", [1, 2, 5])
def test_no_number_without_a_value_is_told(tmp_path, truth, seeds):
    plan = study_plan(axes=[LOSS], strategies=["xi-star", "xi-0"], seeds=seeds)
    with closing(filled(plan, tmp_path / "t", truth)) as table:
        summary = summarise(plan, table)
    assert len(summary.comparisons) == len(LOSS["values"])
    text = " ".join([*summary_sentences(summary), *result_tables(summary)])
    assert not re.search(r"\b(nan|inf)\b", text)
    # 5 seeds have 32 sign changes, so the smallest two-sided p is 2/32, above 0.05.
    assert not re.search(r"\b(higher|in more seeds)\b", " ".join(summary_sentences(summary)))
