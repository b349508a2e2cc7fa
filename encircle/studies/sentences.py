"""What a study found, in plain sentences, each of which quotes the numbers that it rests on.

They are made from the numbers alone. A difference is said to be higher or lower only if its
interval and its p, corrected for all tests of the study, say so both; else it is undecided, never
absent. What would be decided without correction is told as such.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from encircle.comparisons import Decision, Difference
from encircle.statistics import Interval
from encircle.studies.plan import Axis, Plan
from encircle.studies.summary import Comparison, Overall, Summary, Tolerated


def findings(summary: Summary) -> list[str]:
    """The sentences of a study: its range, what is tolerated, and every comparison."""
    plan = summary.plan
    return [
        _range(summary),
        *(_tolerance(plan, one) for one in summary.tolerated),
        *(_overall(plan, one) for one in summary.overall),
        *(_comparison(plan, one) for one in summary.comparisons),
    ]


def where_text(plan: Plan, levels: Mapping[str, Any]) -> str:
    """Levels as a person reads them: ``packet loss 30 %, strategy xi-0``."""
    axes = [axis for axis in plan.all_axes if axis.name in levels and len(axis.levels) > 1]
    return ", ".join(f"{_label(axis)} {_level(axis, levels[axis.name])}" for axis in axes)


def _range(summary: Summary) -> str:
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


def _tolerance(plan: Plan, one: Tolerated) -> str:
    axis = next(a for a in plan.all_axes if a.name == one.axis)
    at = _at(plan, one.others)
    rate = f"{100 * plan.tolerated_rate:g} %"
    value, low, high = one.level
    first, last = float(axis.levels[0]), float(axis.levels[-1])
    lower = _number(axis, low) if np.isfinite(low) else f"below {_number(axis, first)}"
    upper = _number(axis, high) if np.isfinite(high) else f"beyond {_number(axis, last)}"
    if np.isnan(value):
        sure = "" if high <= first else _sure(axis, "from", high, " on")
        return f"Capture is below {rate}{at} even at {_label(axis)} {_level(axis, first)}{sure}."
    if one.rising:
        where = f"{_label(axis)} {_level(axis, value)} [{lower}, {upper}]"
        return f"Capture is at or above {rate}{at} from {where} on."
    holds = f"Capture stays at or above {rate}{at} up to"
    if value >= last and np.isinf(high):
        sure = "" if low >= last else _sure(axis, "up to", low, "")
        return f"{holds} {_level(axis, last)}, the largest {_label(axis)} tried{sure}."
    return f"{holds} {_label(axis)} {_level(axis, value)} [{lower}, {upper}]."


def _sure(axis: Axis, before: str, level: float, after: str) -> str:
    """Up to or from which level a claim is sure; a bound that is infinite is none of them."""
    if np.isinf(level):
        return ", surely at no level tried"
    return f", surely {before} {_level(axis, level)}{after}"


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
    size = f", effect size d_z {effect:+.2f}" if np.isfinite(effect) else ""
    against = f"{_level(axis, one.level)} against {_level(axis, one.baseline)}"
    return f"{against}{where}: {'; '.join(parts)}{size}."


def _claim(what: str, test: Difference, scale: float, unit: str) -> str:
    """What is decided of a difference, with its interval and both p."""
    word = "the same with every seed" if test.ties == test.pairs else str(test.decision)
    return f"{what} {word}{_alone(test)} ({signed(test.mean, scale)} {unit}{_p(test)})"


def _order(test: Difference) -> str:
    """Whether one level captures later in more seeds than it does earlier."""
    word = {
        Decision.HIGHER: "captured later in more seeds",
        Decision.LOWER: "captured earlier in more seeds",
        Decision.UNDECIDED: "captured later or earlier undecided",
    }[test.decision]
    counts = f"later in {test.worse}, earlier in {test.better} of {test.pairs}"
    return f"{word}{_alone(test)} ({counts}, {signed(test.mean, 100.0)} points{_p(test)})"


def _alone(test: Difference) -> str:
    undecided = test.decision is Decision.UNDECIDED
    alone = test.decision_alone is not Decision.UNDECIDED
    return " after correction" if undecided and alone else ""


def _p(test: Difference) -> str:
    """Both p; a single pair can tell nothing."""
    if test.pairs < 2:
        return ", a single seed"
    return f", p {p_text(test.p)}, corrected {p_text(test.p_corrected)}"


def p_text(p: float) -> str:
    """``< 0.001``, or three digits after the point."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def signed(interval: Interval, scale: float) -> str:
    """``-2.1 [-8.3, +4.1]``, or the value alone if it has no bounds."""
    value, low, high = (scale * bound for bound in interval)
    return f"{value:+.3g}" if np.isnan(low) else f"{value:+.3g} [{low:+.3g}, {high:+.3g}]"


def _at(plan: Plan, others: Mapping[str, Any]) -> str:
    where = where_text(plan, others)
    return f" at {where}" if where else ""


def _label(axis: Axis) -> str:
    return axis.label or axis.name.replace("_", " ")


def _level(axis: Axis, level: Any) -> str:
    return f"{_number(axis, level)} {axis.unit}".rstrip()


def _number(axis: Axis, level: Any) -> str:
    if isinstance(level, float) and level not in axis.levels:
        shown = level * axis.scale
        return f"{shown:.0f}" if abs(shown) >= 1000.0 else f"{shown:.3g}"
    return axis.shown(level)


def _percent(rate: Interval) -> str:
    return f"{100 * rate.value:.0f} % [{100 * rate.low:.0f}, {100 * rate.high:.0f}]"
