"""Every comparison of a study as a line of a file, with p and corrected p of each of its tests."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from encircle.studies.summary import CLAIMS, Comparison, Overall, Summary

COMPARISONS = "comparisons.csv"
NAMES = {"rate": "capture_rate", "order": "later_share", "time_s": "time_s_restricted"}
NUMBERS = ("difference", "low", "high", "p", "p_corrected")


def write_comparisons(summary: Summary, path: Path) -> None:
    """One line per comparison; ``all`` where it is over all levels of an axis."""
    axis = summary.plan.compared
    assert axis is not None
    others = [other.name for other in summary.plan.all_axes if other is not axis]
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        measured = [f"{NAMES[name]}_{end}" for name in CLAIMS for end in (*NUMBERS, "decision")]
        writer.writerow([axis.name, "baseline", *others, "pairs", *measured])
        for one in summary.comparisons:
            writer.writerow([one.level, one.baseline, *one.others.values(), *_numbers(one)])
        for over in summary.overall:
            writer.writerow([over.level, over.baseline, *("all" for _ in others), *_numbers(over)])


def _numbers(one: Comparison | Overall) -> Iterator[Any]:
    yield one.rate.pairs
    for name in CLAIMS:
        test = getattr(one, name)
        yield from (f"{number:.10g}" for number in (*test.mean, test.p, test.p_corrected))
        yield str(test.decision)
