"""The findings of a study as plain sentences, each with the numbers that it depends on.

A sentence is made from numbers alone. It calls a difference higher or lower only if both its
interval and its p, corrected for all tests of the study, say so; otherwise the difference is
undecided, never absent. If the difference would be decided without correction, the sentence says
that too.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from encircle.statistics.comparisons import Difference, Verdict
from encircle.statistics.intervals import Interval
from encircle.studies.plan import Axis, Plan
from encircle.studies.summary import Comparison, OverallComparison, Summary, Tolerance

NAMED_MAX = 4
VERDICT_TEXTS = {
    "rate": {Verdict.HIGHER: "capture rate higher", Verdict.LOWER: "capture rate lower"},
    "order": {
        Verdict.HIGHER: "captured later in more seeds",
        Verdict.LOWER: "captured earlier in more seeds",
    },
    "time_s": {
        Verdict.HIGHER: "mean time to capture higher",
        Verdict.LOWER: "mean time to capture lower",
    },
}
"""The words for each outcome of a comparison that is decided."""
OUTCOME_NAMES = {
    "rate": "capture rate",
    "order": "captured later or earlier",
    "time_s": "mean time to capture",
}


def summary_sentences(summary: Summary) -> list[str]:
    """The sentences of a study: the range of rates, one for each axis, one for each comparison."""
    plan = summary.plan
    sentences = [rate_range_text(summary)]
    sentences += [tolerance_text(plan, ones) for ones in tolerances_by_axis(summary)]
    for ones, over in comparisons_by_level(summary):
        if over is None:
            sentences += [_comparison_sentence(plan, one) for one in ones]
        else:
            sentences.append(f"{_overall_sentence(plan, over)} {settings_text(plan, ones)}")
    return sentences


def tolerances_by_axis(summary: Summary) -> list[tuple[Tolerance, ...]]:
    """The tolerated levels, grouped by axis."""
    names = dict.fromkeys(one.axis for one in summary.tolerances)
    return [tuple(one for one in summary.tolerances if one.axis == name) for name in names]


def comparisons_by_level(
    summary: Summary,
) -> list[tuple[tuple[Comparison, ...], OverallComparison | None]]:
    """Comparisons of each level in every setting, and the comparison over all settings.

    With a single setting, all levels are in one group.
    """
    if not summary.overall:
        return [(summary.comparisons, None)] if summary.comparisons else []
    step = len(summary.overall)
    return [(summary.comparisons[k::step], over) for k, over in enumerate(summary.overall)]


def levels_text(plan: Plan, levels: Mapping[str, Any]) -> str:
    """Levels as a person reads them: ``packet loss 30 %, strategy xi-0``."""
    axes = [axis for axis in plan.all_axes if axis.name in levels and len(axis.levels) > 1]
    return ", ".join(f"{_label(axis)} {_level_with_unit(axis, levels[axis.name])}" for axis in axes)


def rate_range_text(summary: Summary) -> str:
    """The lowest and the highest capture rate of all cells."""
    best = max(summary.cells, key=lambda cell: cell.rate.value)
    worst = min(summary.cells, key=lambda cell: cell.rate.value)
    runs = "1 run" if best.runs == 1 else f"{best.runs} runs"
    if len(summary.cells) == 1:
        return f"The target is captured in {_percent(best.rate)} of {runs}."
    if best.rate.value == worst.rate.value:
        return f"The target is captured in {_percent(best.rate)} of {runs} in every cell."
    low, high = (
        f"{_percent(cell.rate)} ({levels_text(summary.plan, cell.levels)})"
        for cell in (worst, best)
    )
    return f"The capture rate goes from {low} to {high}, {runs} each."


def tolerance_text(plan: Plan, ones: Sequence[Tolerance]) -> str:
    """Up to which level of an axis capture holds, in one setting or in several, as a sentence."""
    axis = axis_of(plan, ones[0])
    if len(ones) == 1:
        return _tolerance_sentence(plan, ones[0])
    holds = f"Along {_label(axis)}, capture stays at or above {100 * plan.tolerated_rate:g} %"
    if len(ones) <= NAMED_MAX:
        each = (
            f"at {levels_text(plan, one.others)} {_tolerance_clause(axis, one)}" for one in ones
        )
        return f"{holds}: {'; '.join(each)}."
    return f"{holds} {_tolerances_clause(axis, ones)} of {len(ones)} settings."


def _tolerance_clause(axis: Axis, one: Tolerance) -> str:
    value, low, high = one.level
    if np.isnan(value):
        return f"not even at the first level{_sure_below(axis, high)}"
    if one.rising:
        return f"from {_axis_value_with_unit(axis, value)} on {bounds_text(axis, one.level)}"
    if value >= axis.display_values[-1] and np.isinf(high):
        return (
            f"up to {_axis_value_with_unit(axis, value)}, the largest tried{_sure_up_to(axis, low)}"
        )
    return f"up to {_axis_value_with_unit(axis, value)} {bounds_text(axis, one.level)}"


def _tolerances_clause(axis: Axis, ones: Sequence[Tolerance]) -> str:
    """The range of tolerated levels over many settings."""
    failing = sum(bool(np.isnan(one.level.value)) for one in ones)
    rising = sum(one.rising for one in ones)
    falling = sorted(
        one.level.value for one in ones if not one.rising and not np.isnan(one.level.value)
    )
    parts = []
    if falling:
        low, high = (axis_value_text(axis, value) for value in (falling[0], falling[-1]))
        ends = high if low == high else f"between {low} and {high}"
        parts.append(f"up to {ends} {axis.unit}".rstrip() + f" in {len(falling)}")
    if unsure := sum(np.isneginf(one.level.low) and np.isfinite(one.level.value) for one in ones):
        parts.append(f"surely at no level in {unsure}")
    parts += [f"from a level on in {rising}"] if rising else []
    parts += [f"not even at the first level in {failing}"] if failing else []
    return ", ".join(parts)


def axis_of(plan: Plan, one: Tolerance) -> Axis:
    """The axis of a tolerated level."""
    return next(axis for axis in plan.all_axes if axis.name == one.axis)


def _tolerance_sentence(plan: Plan, one: Tolerance) -> str:
    axis = axis_of(plan, one)
    at = _at_levels(plan, one.others)
    rate = f"{100 * plan.tolerated_rate:g} %"
    value, low, high = one.level
    first, last = axis.display_values[0], axis.display_values[-1]
    where = f"{_label(axis)} {_axis_value_with_unit(axis, value)} {bounds_text(axis, one.level)}"
    if np.isnan(value):
        even = f"{_label(axis)} {_axis_value_with_unit(axis, first)}{_sure_below(axis, high)}"
        return f"Capture is below {rate}{at} even at {even}."
    if one.rising:
        return f"Capture is at or above {rate}{at} from {where} on."
    holds = f"Capture stays at or above {rate}{at} up to"
    if value >= last and np.isinf(high):
        tried = f"the largest {_label(axis)} tried{_sure_up_to(axis, low)}"
        return f"{holds} {_axis_value_with_unit(axis, last)}, {tried}."
    return f"{holds} {where}."


def bounds_text(axis: Axis, level: Interval) -> str:
    """``[12, beyond 95]``: bounds of a value on an axis, open beyond the levels of the study."""
    first, last = (axis_value_text(axis, axis.display_values[k]) for k in (0, -1))
    lower = axis_value_text(axis, level.low) if np.isfinite(level.low) else f"below {first}"
    upper = axis_value_text(axis, level.high) if np.isfinite(level.high) else f"beyond {last}"
    return f"[{lower}, {upper}]"


def _sure_up_to(axis: Axis, low: float) -> str:
    """Up to which level capture holds by the lower bound; empty if that is the last level."""
    if low >= axis.display_values[-1]:
        return ""
    if np.isinf(low):
        return ", surely at no level tried"
    return f", surely up to {_axis_value_with_unit(axis, low)}"


def _sure_below(axis: Axis, high: float) -> str:
    """From which level on capture is below the rate by the upper bound; empty if from the first."""
    if high <= axis.display_values[0]:
        return ""
    if np.isinf(high):
        return ", surely below at no level tried"
    return f", surely below from {_axis_value_with_unit(axis, high)} on"


def _comparison_sentence(plan: Plan, one: Comparison) -> str:
    return _difference_sentence(plan, one, _at_levels(plan, one.others))


def _overall_sentence(plan: Plan, one: OverallComparison) -> str:
    return _difference_sentence(
        plan, one, f", averaged over {one.settings} settings within each seed"
    )


def _difference_sentence(plan: Plan, one: Comparison | OverallComparison, where: str) -> str:
    axis = plan.compared_axis
    assert axis is not None
    parts = [
        _difference_text("capture rate", one.rate, 100.0, "points"),
        _order_text(one.order),
        _difference_text("mean time to capture, up to the limit,", one.time_s, 1.0, "s"),
    ]
    effect = one.time_s.effect_size.value
    sized = is_decided(one.time_s) and np.isfinite(effect)
    size = f", effect size d_z {effect:+.2f}" if sized else ""
    against = f"{_level_with_unit(axis, one.level)} against {_level_with_unit(axis, one.baseline)}"
    return f"{against}{where}: {'; '.join(parts)}{size}."


def _difference_text(what: str, test: Difference, scale: float, unit: str) -> str:
    """The verdict on a difference, with its interval and both p."""
    word = "the same with every seed" if test.ties == test.pairs else str(test.verdict)
    numbers = f"{test.mean.signed_text(scale)} {unit}{_p_values_text(test)}"
    return f"{what} {word}{_uncorrected_text(test)} ({numbers})"


def settings_text(plan: Plan, ones: Sequence[Comparison]) -> str:
    """In which settings a level differs from the baseline, for each outcome, in one sentence."""
    if not any(is_decided(_test_of(one, outcome)) for one in ones for outcome in VERDICT_TEXTS):
        return f"Of the {len(ones)} settings none is decided."
    clauses = [_where_decided(plan, ones, outcome) for outcome in VERDICT_TEXTS]
    return f"Of the {len(ones)} settings: {'; '.join(clauses)}."


def _where_decided(plan: Plan, ones: Sequence[Comparison], outcome: str) -> str:
    sentences = []
    for verdict, text in VERDICT_TEXTS[outcome].items():
        where = [
            levels_text(plan, one.others)
            for one in ones
            if _test_of(one, outcome).verdict is verdict
        ]
        if where:
            more = len(where) - NAMED_MAX
            rest = f" and {more} more" if more > 0 else ""
            sentences.append(f"{text} at {'; '.join(where[:NAMED_MAX])}{rest}")
    return ", ".join(sentences) or f"{OUTCOME_NAMES[outcome]} undecided in all"


def verdict_text(one: Comparison | OverallComparison) -> str:
    """The verdict on a comparison, in a few words."""
    tests = {outcome: _test_of(one, outcome) for outcome in VERDICT_TEXTS}
    sentences = [
        VERDICT_TEXTS[outcome][test.verdict] for outcome, test in tests.items() if is_decided(test)
    ]
    if sentences:
        return "; ".join(sentences)
    if all(test.ties == test.pairs for test in tests.values()):
        return "the same with every seed"
    alone = any(test.uncorrected_verdict is not Verdict.UNDECIDED for test in tests.values())
    return "undecided after correction" if alone else "undecided"


def is_decided(test: Difference) -> bool:
    """Whether a difference is called higher or lower."""
    return test.verdict is not Verdict.UNDECIDED


def _test_of(one: Comparison | OverallComparison, outcome: str) -> Difference:
    test: Difference = getattr(one, outcome)
    return test


def _order_text(test: Difference) -> str:
    """Whether one level captures later in more seeds than it captures earlier."""
    word = VERDICT_TEXTS["order"].get(test.verdict, "captured later or earlier undecided")
    counts = f"later in {test.worse}, earlier in {test.better} of {test.pairs}"
    numbers = f"{test.mean.signed_text(100.0)} points{_p_values_text(test)}"
    return f"{word}{_uncorrected_text(test)} ({counts}, {numbers})"


def _uncorrected_text(test: Difference) -> str:
    undecided = test.verdict is Verdict.UNDECIDED
    alone = test.uncorrected_verdict is not Verdict.UNDECIDED
    return " after correction" if undecided and alone else ""


def _p_values_text(test: Difference) -> str:
    """Both p; a single pair has none."""
    if test.pairs < 2:
        return ", a single seed"
    return f", p {p_text(test.p)}, corrected {p_text(test.p_corrected)}"


def p_text(p: float) -> str:
    """``< 0.001``, or three digits after the point."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _at_levels(plan: Plan, others: Mapping[str, Any]) -> str:
    where = levels_text(plan, others)
    return f" at {where}" if where else ""


def _label(axis: Axis) -> str:
    return axis.label or axis.name.replace("_", " ")


def _level_with_unit(axis: Axis, level: Any) -> str:
    return f"{axis.display_level(level)} {axis.unit}".rstrip()


def _axis_value_with_unit(axis: Axis, value: float) -> str:
    return f"{axis_value_text(axis, value)} {axis.unit}".rstrip()


def axis_value_text(axis: Axis, value: float) -> str:
    """A value on a numeric axis, at a level or between two, without unit."""
    if value in axis.display_values:
        return axis.display_level(axis.levels[axis.display_values.index(value)])
    return axis.display_value(value)


def _percent(rate: Interval) -> str:
    return f"{100 * rate.value:.0f} % [{100 * rate.low:.0f}, {100 * rate.high:.0f}]"
