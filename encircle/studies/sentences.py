"""What a study found, in plain sentences, each of which quotes the interval that it rests on.

They are made from the numbers alone. A difference whose interval holds zero is said to be
undecided, never absent.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

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
    if np.isnan(value):
        return f"Capture is below {rate}{at} even at {_label(axis)} {_level(axis, first)}."
    if one.rising:
        lower = _number(axis, low) if np.isfinite(low) else f"below {_number(axis, first)}"
        upper = _number(axis, high) if np.isfinite(high) else f"beyond {_number(axis, last)}"
        where = f"{_label(axis)} {_level(axis, value)} [{lower}, {upper}]"
        return f"Capture is at or above {rate}{at} from {where} on."
    holds = f"Capture stays at or above {rate}{at} up to"
    if value >= last and np.isinf(high):
        sure = low if np.isfinite(low) else first
        below = f", surely up to {_level(axis, sure)}" if sure < last else ""
        return f"{holds} {_level(axis, last)}, the largest {_label(axis)} tried{below}."
    lower = _number(axis, low) if np.isfinite(low) else f"below {_number(axis, first)}"
    upper = _number(axis, high) if np.isfinite(high) else f"beyond {_number(axis, last)}"
    return f"{holds} {_label(axis)} {_level(axis, value)} [{lower}, {upper}]."


def _comparison(plan: Plan, one: Comparison) -> str:
    return _difference(plan, one, _at(plan, one.others))


def _overall(plan: Plan, one: Overall) -> str:
    return _difference(plan, one, f", averaged over {one.settings} settings within each seed")


def _difference(plan: Plan, one: Comparison | Overall, where: str) -> str:
    axis = plan.compared
    assert axis is not None
    rate, time = one.rate.mean, one.time_s.mean
    parts = []
    for what, interval, scale, unit in (
        ("capture rate", rate, 100.0, "points"),
        ("time to capture", time, 1.0, "s"),
    ):
        if interval.low == interval.high == 0.0:
            # Resamples of equal values say nothing of how sure that is.
            parts.append(f"{what} the same with every seed")
            continue
        text = f"{Interval(*(scale * v for v in interval)):+.3g} {unit}"
        decided = interval.low > 0.0 or interval.high < 0.0
        word = ("higher" if interval.value > 0 else "lower") if decided else "undecided"
        parts.append(f"{what} {word} ({text})")
    effect = one.time_s.effect.value
    size = f", effect size d_z {effect:+.2f}" if np.isfinite(effect) else ""
    against = f"{_level(axis, one.level)} against {_level(axis, one.baseline)}"
    return f"{against}{where}: {'; '.join(parts)}{size}."


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
