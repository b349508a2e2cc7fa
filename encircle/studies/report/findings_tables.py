"""The findings at the head of a study's report, in groups.

There is a line for each axis with tolerated levels. There is a heading for each comparison, with a
table that has a row for each setting. Long tables are collapsed.
"""

from collections.abc import Sequence

from encircle.scene.counts import counted
from encircle.studies.charts.layout import axis_label, varied_axes
from encircle.studies.csv_files import COMPARISONS_FILE
from encircle.studies.report import page
from encircle.studies.report.result_tables import (
    interval_text,
    test_text,
    truncation_text,
)
from encircle.studies.report.sentences import (
    comparisons_by_level,
    rate_range_text,
    settings_text,
    tolerance_text,
    tolerances_by_axis,
    verdict_text,
)
from encircle.studies.summary import Comparison, OverallComparison, Summary

GROUPS_SHOWN, ROWS_SHOWN, ROWS_MAX = 8, 16, 1000
DIFFERENCE_HEADS = (
    "Capture rate, difference (points)",
    "p",
    "Seeds later / earlier",
    "p",
    "Mean time to capture, up to the limit, difference (s)",
    "p",
    "What is decided",
)


def finding_sections(summary: Summary) -> list[str]:
    """All findings, as parts of a page."""
    tolerated = [
        tolerance_text(summary.plan, comparisons) for comparisons in tolerances_by_axis(summary)
    ]
    parts = [page.bullets([rate_range_text(summary), *tolerated])]
    groups = [_comparison_sections(summary, *group) for group in comparisons_by_level(summary)]
    parts += [part for group in groups[:GROUPS_SHOWN] for part in group]
    if rest := groups[GROUPS_SHOWN:]:
        heading = f"{counted(len(rest), 'more comparison')}"
        parts.append(page.collapsible(heading, [part for group in rest for part in group]))
    return parts


def _comparison_sections(
    summary: Summary, comparisons: Sequence[Comparison], overall: OverallComparison | None
) -> list[str]:
    """One comparison: its heading, where it is decided, and a row for each setting.

    With a single setting it has a row for each level.
    """
    plan, axis = summary.plan, summary.plan.compared_axis
    assert axis is not None
    baseline = f"{axis.display_level(comparisons[0].baseline)} {axis.unit}".rstrip()
    if overall is None:
        heading, name_axes = f"{axis_label(axis)} against {baseline}", [axis]
        rows = [
            (axis.display_level(comparison.level), *_row(comparison))
            for comparison in comparisons[:ROWS_MAX]
        ]
        parts = [page.heading(heading, 3)]
    else:
        heading = (
            f"{f'{axis.display_level(overall.level)} {axis.unit}'.rstrip()} against {baseline}"
        )
        name_axes = [other for other in varied_axes(plan) if other is not axis]
        average = (
            f"all {overall.settings}, averaged",
            *("" for _ in name_axes[1:]),
            *_row(overall),
        )
        rows = [average] + [
            (
                *(other.display_level(comparison.others[other.name]) for other in name_axes),
                *_row(comparison),
            )
            for comparison in comparisons[:ROWS_MAX]
        ]
        parts = [page.heading(heading, 3), page.paragraph(settings_text(plan, comparisons))]
    caption = (
        f"{heading}: differences on {counted(comparisons[0].rate.pairs, 'common seed')},"
        f" {baseline} subtracted; p corrected, in brackets uncorrected"
        f"{truncation_text(len(comparisons), ROWS_MAX, COMPARISONS_FILE)}"
    )
    head = [*(other.title for other in name_axes), *DIFFERENCE_HEADS]
    return [
        *parts,
        _collapsed_if_long(
            heading, page.table(caption, head, rows, len(name_axes), text_columns=1), len(rows)
        ),
    ]


def _row(comparison: Comparison | OverallComparison) -> tuple[str, ...]:
    rate, order, time_s = comparison.rate, comparison.order, comparison.time_s
    return (
        interval_text(rate.mean, "+z.0f", 100.0),
        test_text(rate),
        f"{order.worse} / {order.better}",
        test_text(order),
        interval_text(time_s.mean, "+z.1f"),
        test_text(time_s),
        verdict_text(comparison),
    )


def _collapsed_if_long(heading: str, table: str, rows: int) -> str:
    return (
        page.collapsible(f"{heading}: {counted(rows, 'row')}", [table])
        if rows > ROWS_SHOWN
        else table
    )
