"""What a study found, in plain sentences, each of which quotes the numbers that it rests on.

They are made from the numbers alone. A difference is said to be higher or lower only if its
interval and its p, corrected for all tests of the study, say so both; else it is undecided, never
absent. What would be decided without correction is told as such.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from encircle.statistics.comparisons import Difference, Verdict
from encircle.statistics.intervals import Interval
from encircle.studies.plan import Axis, Plan
from encircle.studies.summary import Comparison, Overall, Summary, Tolerance

NAMED_MAX = 4
WORDS = {
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
"""What is said of each claim of a comparison where it is decided."""
NOUNS = {
    "rate": "capture rate",
    "order": "captured later or earlier",
    "time_s": "mean time to capture",
}


def summary_sentences(summary: Summary) -> list[str]:
    """The sentences of a study: its range, and one for each axis and each comparison."""
    plan = summary.plan
    sentences = [range_text(summary)]
    sentences += [tolerance_text(plan, ones) for ones in by_axis(summary)]
    for ones, over in by_level(summary):
        if over is None:
            sentences += [_comparison(plan, one) for one in ones]
        else:
            sentences.append(f"{_overall(plan, over)} {settings_text(plan, ones)}")
    return sentences


def by_axis(summary: Summary) -> list[tuple[Tolerance, ...]]:
    """What is tolerated, together for each axis."""
    names = dict.fromkeys(one.axis for one in summary.tolerated)
    return [tuple(one for one in summary.tolerated if one.axis == name) for name in names]


def by_level(summary: Summary) -> list[tuple[tuple[Comparison, ...], Overall | None]]:
    """Comparisons of each level in every setting, and over all of them.

    If there is a single setting all levels are together.
    """
    if not summary.overall:
        return [(summary.comparisons, None)] if summary.comparisons else []
    step = len(summary.overall)
    return [(summary.comparisons[k::step], over) for k, over in enumerate(summary.overall)]


def where_text(plan: Plan, levels: Mapping[str, Any]) -> str:
    """Levels as a person reads them: ``packet loss 30 %, strategy xi-0``."""
    axes = [axis for axis in plan.all_axes if axis.name in levels and len(axis.levels) > 1]
    return ", ".join(f"{_label(axis)} {_level(axis, levels[axis.name])}" for axis in axes)


def range_text(summary: Summary) -> str:
    """The lowest and the highest capture rate of all cells."""
    best = max(summary.cells, key=lambda cell: cell.rate.value)
    worst = min(summary.cells, key=lambda cell: cell.rate.value)
    runs = "1 run" if best.runs == 1 else f"{best.runs} runs"
    if len(summary.cells) == 1:
        return f"The target is captured in {_percent(best.rate)} of {runs}."
    if best.rate.value == worst.rate.value:
        return f"The target is captured in {_percent(best.rate)} of {runs} in every cell."
    low, high = (
        f"{_percent(cell.rate)} ({where_text(summary.plan, cell.levels)})" for cell in (worst, best)
    )
    return f"The capture rate goes from {low} to {high}, {runs} each."


def tolerance_text(plan: Plan, ones: Sequence[Tolerance]) -> str:
    """How far capture holds along an axis, in one setting or in several: a sentence."""
    axis = axis_of(plan, ones[0])
    if len(ones) == 1:
        return _tolerance(plan, ones[0])
    holds = f"Along {_label(axis)}, capture stays at or above {100 * plan.tolerated_rate:g} %"
    if len(ones) <= NAMED_MAX:
        each = (f"at {where_text(plan, one.others)} {_held(axis, one)}" for one in ones)
        return f"{holds}: {'; '.join(each)}."
    return f"{holds} {_span(axis, ones)} of {len(ones)} settings."


def _held(axis: Axis, one: Tolerance) -> str:
    value, low, high = one.level
    if np.isnan(value):
        return f"not even at the first level{_sure_below(axis, high)}"
    if one.rising:
        return f"from {_place(axis, value)} on {bounds_text(axis, one.level)}"
    if value >= axis.shown_values[-1] and np.isinf(high):
        return f"up to {_place(axis, value)}, the largest tried{_sure_up_to(axis, low)}"
    return f"up to {_place(axis, value)} {bounds_text(axis, one.level)}"


def _span(axis: Axis, ones: Sequence[Tolerance]) -> str:
    """From where to where capture holds in many settings."""
    failing = sum(bool(np.isnan(one.level.value)) for one in ones)
    rising = sum(one.rising for one in ones)
    falling = sorted(
        one.level.value for one in ones if not one.rising and not np.isnan(one.level.value)
    )
    parts = []
    if falling:
        low, high = (place_text(axis, value) for value in (falling[0], falling[-1]))
        ends = high if low == high else f"between {low} and {high}"
        parts.append(f"up to {ends} {axis.unit}".rstrip() + f" in {len(falling)}")
    if unsure := sum(np.isneginf(one.level.low) and np.isfinite(one.level.value) for one in ones):
        parts.append(f"surely at no level in {unsure}")
    parts += [f"from a level on in {rising}"] if rising else []
    parts += [f"not even at the first level in {failing}"] if failing else []
    return ", ".join(parts)


def axis_of(plan: Plan, one: Tolerance) -> Axis:
    """The axis along which something is tolerated."""
    return next(axis for axis in plan.all_axes if axis.name == one.axis)


def _tolerance(plan: Plan, one: Tolerance) -> str:
    axis = axis_of(plan, one)
    at = _at(plan, one.others)
    rate = f"{100 * plan.tolerated_rate:g} %"
    value, low, high = one.level
    first, last = axis.shown_values[0], axis.shown_values[-1]
    where = f"{_label(axis)} {_place(axis, value)} {bounds_text(axis, one.level)}"
    if np.isnan(value):
        even = f"{_label(axis)} {_place(axis, first)}{_sure_below(axis, high)}"
        return f"Capture is below {rate}{at} even at {even}."
    if one.rising:
        return f"Capture is at or above {rate}{at} from {where} on."
    holds = f"Capture stays at or above {rate}{at} up to"
    if value >= last and np.isinf(high):
        tried = f"the largest {_label(axis)} tried{_sure_up_to(axis, low)}"
        return f"{holds} {_place(axis, last)}, {tried}."
    return f"{holds} {where}."


def bounds_text(axis: Axis, level: Interval) -> str:
    """``[12, beyond 95]``: bounds of a place on an axis, open beyond the levels tried."""
    first, last = (place_text(axis, axis.shown_values[k]) for k in (0, -1))
    lower = place_text(axis, level.low) if np.isfinite(level.low) else f"below {first}"
    upper = place_text(axis, level.high) if np.isfinite(level.high) else f"beyond {last}"
    return f"[{lower}, {upper}]"


def _sure_up_to(axis: Axis, low: float) -> str:
    """Up to which level capture surely holds, if not up to the last; none if no bound says so."""
    if low >= axis.shown_values[-1]:
        return ""
    if np.isinf(low):
        return ", surely at no level tried"
    return f", surely up to {_place(axis, low)}"


def _sure_below(axis: Axis, high: float) -> str:
    """From which level on capture is surely below, if not from the first."""
    if high <= axis.shown_values[0]:
        return ""
    if np.isinf(high):
        return ", surely below at no level tried"
    return f", surely below from {_place(axis, high)} on"


def _comparison(plan: Plan, one: Comparison) -> str:
    return _difference(plan, one, _at(plan, one.others))


def _overall(plan: Plan, one: Overall) -> str:
    return _difference(plan, one, f", averaged over {one.settings} settings within each seed")


def _difference(plan: Plan, one: Comparison | Overall, where: str) -> str:
    axis = plan.compared
    assert axis is not None
    parts = [
        _claim("capture rate", one.rate, 100.0, "points"),
        _order(one.order),
        _claim("mean time to capture, up to the limit,", one.time_s, 1.0, "s"),
    ]
    effect = one.time_s.effect.value
    sized = decided(one.time_s) and np.isfinite(effect)
    size = f", effect size d_z {effect:+.2f}" if sized else ""
    against = f"{_level(axis, one.level)} against {_level(axis, one.baseline)}"
    return f"{against}{where}: {'; '.join(parts)}{size}."


def _claim(what: str, test: Difference, scale: float, unit: str) -> str:
    """What is decided of a difference, with its interval and both p."""
    word = "the same with every seed" if test.ties == test.pairs else str(test.verdict)
    return f"{what} {word}{_alone(test)} ({test.mean.signed(scale)} {unit}{_p(test)})"


def settings_text(plan: Plan, ones: Sequence[Comparison]) -> str:
    """Where a level differs from the baseline, for each claim, in one sentence."""
    if not any(decided(_test(one, claim)) for one in ones for claim in WORDS):
        return f"Of the {len(ones)} settings none is decided."
    clauses = [_where_decided(plan, ones, claim) for claim in WORDS]
    return f"Of the {len(ones)} settings: {'; '.join(clauses)}."


def _where_decided(plan: Plan, ones: Sequence[Comparison], claim: str) -> str:
    sentences = []
    for verdict, words in WORDS[claim].items():
        where = [
            where_text(plan, one.others) for one in ones if _test(one, claim).verdict is verdict
        ]
        if where:
            more = len(where) - NAMED_MAX
            rest = f" and {more} more" if more > 0 else ""
            sentences.append(f"{words} at {'; '.join(where[:NAMED_MAX])}{rest}")
    return ", ".join(sentences) or f"{NOUNS[claim]} undecided in all"


def verdict_text(one: Comparison | Overall) -> str:
    """What is decided of a comparison, in a few words."""
    tests = {claim: _test(one, claim) for claim in WORDS}
    sentences = [WORDS[claim][test.verdict] for claim, test in tests.items() if decided(test)]
    if sentences:
        return "; ".join(sentences)
    if all(test.ties == test.pairs for test in tests.values()):
        return "the same with every seed"
    alone = any(test.verdict_alone is not Verdict.UNDECIDED for test in tests.values())
    return "undecided after correction" if alone else "undecided"


def decided(test: Difference) -> bool:
    """Whether a difference is said to be one."""
    return test.verdict is not Verdict.UNDECIDED


def _test(one: Comparison | Overall, claim: str) -> Difference:
    test: Difference = getattr(one, claim)
    return test


def _order(test: Difference) -> str:
    """Whether one level captures later in more seeds than it does earlier."""
    word = WORDS["order"].get(test.verdict, "captured later or earlier undecided")
    counts = f"later in {test.worse}, earlier in {test.better} of {test.pairs}"
    return f"{word}{_alone(test)} ({counts}, {test.mean.signed(100.0)} points{_p(test)})"


def _alone(test: Difference) -> str:
    undecided = test.verdict is Verdict.UNDECIDED
    alone = test.verdict_alone is not Verdict.UNDECIDED
    return " after correction" if undecided and alone else ""


def _p(test: Difference) -> str:
    """Both p; a single pair can tell nothing."""
    if test.pairs < 2:
        return ", a single seed"
    return f", p {p_text(test.p)}, corrected {p_text(test.p_corrected)}"


def p_text(p: float) -> str:
    """``< 0.001``, or three digits after the point."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _at(plan: Plan, others: Mapping[str, Any]) -> str:
    where = where_text(plan, others)
    return f" at {where}" if where else ""


def _label(axis: Axis) -> str:
    return axis.label or axis.name.replace("_", " ")


def _level(axis: Axis, level: Any) -> str:
    return f"{axis.shown(level)} {axis.unit}".rstrip()


def _place(axis: Axis, value: float) -> str:
    return f"{place_text(axis, value)} {axis.unit}".rstrip()


def place_text(axis: Axis, value: float) -> str:
    """A place on a numeric axis, at a level or between two, without unit."""
    if value in axis.shown_values:
        return axis.shown(axis.levels[axis.shown_values.index(value)])
    return axis.shown_value(value)


def _percent(rate: Interval) -> str:
    return f"{100 * rate.value:.0f} % [{100 * rate.low:.0f}, {100 * rate.high:.0f}]"
