"""The findings at the head of a study's report: a line or a row for each, grouped.

A line stands for each axis along which capture is looked for, and a heading for each comparison,
with a row of a table for each setting instead of a sentence. What is long is folded.
"""

from collections.abc import Sequence

from encircle.studies.charts.views import label, varied
from encircle.studies.csv_files import COMPARISONS
from encircle.studies.report import page
from encircle.studies.report.claims import (
    by_axis,
    by_level,
    range_text,
    settings_text,
    tolerance_text,
    verdict_text,
)
from encircle.studies.report.tables import cut_text, interval_text, many, tested_text
from encircle.studies.summary import Comparison, Overall, Summary

GROUPS_SHOWN, ROWS_SHOWN, ROWS_MAX = 8, 16, 1000
DIFFERENCES = (
    "Capture rate, difference (points)",
    "p",
    "Seeds later / earlier",
    "p",
    "Mean time to capture, up to the limit, difference (s)",
    "p",
    "What is decided",
)


def findings_of(summary: Summary) -> list[str]:
    """Everything that is said to be found, as parts of a page."""
    tolerated = [tolerance_text(summary.plan, ones) for ones in by_axis(summary)]
    parts = [page.bullets([range_text(summary), *tolerated])]
    groups = [_comparisons(summary, *group) for group in by_level(summary)]
    parts += [part for group in groups[:GROUPS_SHOWN] for part in group]
    if rest := groups[GROUPS_SHOWN:]:
        told = f"{many(len(rest), 'more comparison')}"
        parts.append(page.folded(told, [part for group in rest for part in group]))
    return parts


def _comparisons(summary: Summary, ones: Sequence[Comparison], over: Overall | None) -> list[str]:
    """One comparison: its heading, where it is decided, and a row for each setting.

    Without settings: a row for each level.
    """
    plan, axis = summary.plan, summary.plan.compared
    assert axis is not None
    baseline = f"{axis.shown(ones[0].baseline)} {axis.unit}".rstrip()
    if over is None:
        heading, named = f"{label(axis)} against {baseline}", [axis]
        rows = [(axis.shown(one.level), *_row(one)) for one in ones[:ROWS_MAX]]
        parts = [page.heading(heading, 3)]
    else:
        heading = f"{f'{axis.shown(over.level)} {axis.unit}'.rstrip()} against {baseline}"
        named = [other for other in varied(plan) if other is not axis]
        average = (f"all {over.settings}, averaged", *("" for _ in named[1:]), *_row(over))
        rows = [average] + [
            (*(other.shown(one.others[other.name]) for other in named), *_row(one))
            for one in ones[:ROWS_MAX]
        ]
        parts = [page.heading(heading, 3), page.paragraph(settings_text(plan, ones))]
    caption = (
        f"{heading}: differences on {many(ones[0].rate.pairs, 'common seed')},"
        f" {baseline} subtracted; p corrected, in brackets uncorrected"
        f"{cut_text(len(ones), ROWS_MAX, COMPARISONS)}"
    )
    head = [*(other.title for other in named), *DIFFERENCES]
    return [
        *parts,
        _folded(heading, page.table(caption, head, rows, len(named), told=1), len(rows)),
    ]


def _row(one: Comparison | Overall) -> tuple[str, ...]:
    rate, order, time_s = one.rate, one.order, one.time_s
    return (
        interval_text(rate.mean, "+z.0f", 100.0),
        tested_text(rate),
        f"{order.worse} / {order.better}",
        tested_text(order),
        interval_text(time_s.mean, "+z.1f"),
        tested_text(time_s),
        verdict_text(one),
    )


def _folded(told: str, table: str, rows: int) -> str:
    return page.folded(f"{told}: {many(rows, 'row')}", [table]) if rows > ROWS_SHOWN else table
