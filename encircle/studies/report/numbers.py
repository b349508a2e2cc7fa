"""The numbers of a report as data: what its tables and sentences are made from.

The same numbers stand in the CSV files and on the page, rounded; here they are whole, so that a
program can compare them.
"""

from collections.abc import Mapping
from math import isinf, isnan
from typing import Any

import numpy as np

from encircle.statistics.comparisons import Difference
from encircle.statistics.intervals import Interval, Survival
from encircle.studies.report.sentences import summary_sentences
from encircle.studies.summary import OUTCOMES, Cell, Comparison, OverallComparison, Summary


def report_numbers(summary: Summary) -> dict[str, Any]:
    """Every number of a summary as JSON can hold it: cells, comparisons, tolerances, sentences.

    An interval is ``[value, low, high]``. None stands for a number that is undefined, ``"inf"`` or
    ``"-inf"`` for an open bound.
    """
    return {
        "cells": [_cell(*of_cell) for of_cell in zip(summary.cells, summary.tick_s, strict=True)],
        "comparisons": [
            {**_comparison(one), "others": dict(one.others), "logrank_p": _number(one.logrank_p)}
            for one in summary.comparisons
        ],
        "overall": [{**_comparison(one), "settings": one.settings} for one in summary.overall],
        "tests": summary.tests,
        "tolerances": [
            {
                "axis": one.axis,
                "others": dict(one.others),
                "rate": summary.plan.tolerated_rate,
                "level": _interval(one.level),
                "rising": bool(one.rising),
            }
            for one in summary.tolerances
        ],
        "sentences": summary_sentences(summary),
    }


def _cell(cell: Cell, tick_s: float) -> dict[str, Any]:
    return {
        "cell": cell.cell,
        "levels": dict(cell.levels),
        "runs": cell.runs,
        "capture_rate": _interval(cell.rate),
        "time_s_restricted": _interval(cell.time_s),
        "limit_s": _number(cell.limit_s),
        "survival": _survival(cell.survival, tick_s),
        "delay_s_mean_asked": _number(cell.delay.s_mean),
        "means": {name: _interval(mean) for name, mean in cell.means.items()},
    }


def _survival(curve: Survival, tick_s: float) -> dict[str, Any]:
    return {
        "time_s": [_number(tick * tick_s) for tick in curve.ticks],
        "free": [
            [_number(number) for number in point]
            for point in np.column_stack((curve.share, curve.low, curve.high))
        ],
        "median_s": _number(curve.median * tick_s),
    }


def _comparison(one: Comparison | OverallComparison) -> dict[str, Any]:
    tests: Mapping[str, Difference] = {name: getattr(one, name) for name in OUTCOMES}
    return {
        "level": one.level,
        "baseline": one.baseline,
        **{name: _difference(test) for name, test in tests.items()},
    }


def _difference(test: Difference) -> dict[str, Any]:
    return {
        "difference": _interval(test.mean),
        "effect_size": _interval(test.effect_size),
        "better": test.better,
        "worse": test.worse,
        "ties": test.ties,
        "pairs": test.pairs,
        "p": _number(test.p),
        "p_corrected": _number(test.p_corrected),
        "decision": str(test.verdict),
    }


def _interval(interval: Interval) -> list[float | str | None]:
    return [_number(number) for number in interval]


def _number(value: float) -> float | str | None:
    number = float(value)
    if isnan(number):
        return None
    return ("inf" if number > 0 else "-inf") if isinf(number) else number
