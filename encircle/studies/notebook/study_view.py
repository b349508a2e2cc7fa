"""A study in a notebook: how far it is, and its cells with intervals so far."""

from collections.abc import Iterator
from pathlib import Path

from encircle.notebook.html import LINE, framed, table, text
from encircle.statistics.intervals import Interval, capture_rate, restricted_mean_time
from encircle.studies.notebook.looking_on import CellSoFar, SoFar, runs_so_far
from encircle.studies.plan import Plan

ROWS_MAX = 60
NO_VALUE = "\N{EN DASH}"
NOTE = (
    "Rates with Wilson's 95 % interval; a run without capture counts with its limit in the mean"
    " time. What may be said of differences is in the report: encircle study"
)


def study_html(plan: Plan, directory: Path) -> str:
    """A study as HTML; only what is on disk is looked at, and nothing is run."""
    so_far = runs_so_far(directory, plan)
    head = [*([axis.title for axis in plan.all_axes] or ["cell"])]
    names = len(head)
    head += ["runs", "captured", "capture rate (%)", "mean time to capture (s)"]
    rows = list(_rows(plan, so_far))
    parts = [_progress(plan, so_far, directory), table(head, rows, names)]
    more = len(plan.cells) - len(rows)
    cut = f" {more} more cells are not shown." if more > 0 else ""
    return framed(plan.title or plan.name, [f"<div>{''.join(parts)}</div>"], f"{NOTE}.{cut}")


def _progress(plan: Plan, so_far: SoFar, directory: Path) -> str:
    """How many runs there are, in words and as a bar."""
    words = f"{so_far.runs:,} of {plan.runs:,} runs"
    if so_far.failed:
        words += f", {so_far.failed:,} failed"
    words += f", in {directory}"
    if so_far.problem:
        words = so_far.problem
    return (
        f'<div style="margin-bottom:6px;border-bottom:1px solid {LINE};padding-bottom:4px">'
        f'<progress value="{so_far.runs}" max="{plan.runs}"></progress> {text(words)}</div>'
    )


def _rows(plan: Plan, so_far: SoFar) -> Iterator[list[str]]:
    for index, cell in enumerate(so_far.cells[:ROWS_MAX]):
        levels = plan.levels(index)
        named = [axis.display_level(levels[axis.name]) for axis in plan.all_axes] or ["all"]
        yield [*named, *_numbers(plan, index, cell)]


def _numbers(plan: Plan, index: int, cell: CellSoFar) -> list[str]:
    runs = f"{len(cell.captured)}" + (f" ({cell.failed} failed)" if cell.failed else "")
    if not cell.captured:
        return [runs, NO_VALUE, NO_VALUE, NO_VALUE]
    scenario = plan.scenario_of(index)
    seconds = [ticks * scenario.tick_s for ticks in cell.ticks]
    limit_s = scenario.ticks_max * scenario.tick_s
    rate = capture_rate(cell.captured)
    time_s = restricted_mean_time(seconds, cell.captured, limit_s)
    in_percent = Interval(*(100.0 * bound for bound in rate))
    return [runs, f"{sum(cell.captured)}", f"{in_percent:.1f}", f"{time_s:.2f}"]
