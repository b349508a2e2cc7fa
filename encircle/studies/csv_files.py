"""A study's numbers as CSV files: one line per cell, one line per comparison.

The numbers are those of ``encircle.studies.summary``, each with its interval or its p.
"""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from encircle.studies.summary import OUTCOMES, Comparison, OverallComparison, Summary

CELLS_FILE, COMPARISONS_FILE = "summary.csv", "comparisons.csv"
COLUMN_NAMES = {
    "rate": "capture_rate",
    "order": "later_less_earlier",
    "time_s": "time_s_restricted",
}
NUMBERS = ("difference", "low", "high", "p", "p_corrected")


def write_cells(summary: Summary, path: Path) -> None:
    """Write one line per cell: levels, capture rate, times, means of measures, with intervals."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        names = [axis.name for axis in summary.plan.all_axes]
        measured = list(summary.cells[0].means)
        spread = [
            f"{name}{end}"
            for name in ("capture_rate", "time_s_restricted", *measured)
            for end in ("", "_low", "_high")
        ]
        delay = ["delay_model", "delay_s_mean_asked"]
        writer.writerow(["cell", *names, "runs", *spread, "median_s", *delay])
        for cell, tick_s in zip(summary.cells, summary.tick_s, strict=True):
            intervals = (cell.rate, cell.time_s, *(cell.means[name] for name in measured))
            numbers = [f"{v:.10g}" for interval in intervals for v in interval]
            levels = [cell.levels[name] for name in names]
            median_s = f"{cell.survival.median * tick_s:.10g}"
            delay = [cell.delay.model, f"{cell.delay.s_mean:.10g}"]
            writer.writerow([cell.cell, *levels, cell.runs, *numbers, median_s, *delay])


def write_comparisons(summary: Summary, path: Path) -> None:
    """Write one line per comparison; ``all`` stands for all levels of an axis."""
    axis = summary.plan.compared_axis
    assert axis is not None
    others = [other.name for other in summary.plan.all_axes if other is not axis]
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        measured = [
            f"{COLUMN_NAMES[name]}_{end}" for name in OUTCOMES for end in (*NUMBERS, "decision")
        ]
        writer.writerow([axis.name, "baseline", *others, "pairs", *measured])
        for comparison in summary.comparisons:
            writer.writerow(
                [
                    comparison.level,
                    comparison.baseline,
                    *comparison.others.values(),
                    *_numbers(comparison),
                ]
            )
        for overall in summary.overall:
            writer.writerow(
                [overall.level, overall.baseline, *("all" for _ in others), *_numbers(overall)]
            )


def _numbers(comparison: Comparison | OverallComparison) -> Iterator[Any]:
    yield comparison.rate.pairs
    for name in OUTCOMES:
        test = getattr(comparison, name)
        yield from (f"{number:.10g}" for number in (*test.mean, test.p, test.p_corrected))
        yield str(test.verdict)
