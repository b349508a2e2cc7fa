"""The report of a study: one page to read without the program, beside the figures and the CSV.

Every number on it comes from ``encircle.studies.summary``. The same table and command give the same
bytes: there is no date unless one is passed in.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from encircle.statistics.comparisons import ALPHA
from encircle.statistics.intervals import CONFIDENCE, RESAMPLES
from encircle.studies.charts.charts import FIGURES, Chart, write_charts
from encircle.studies.csv_files import CELLS, COMPARISONS, write_cells, write_comparisons
from encircle.studies.plan import Plan
from encircle.studies.report import page
from encircle.studies.report.failures import failures
from encircle.studies.report.findings_tables import findings_of
from encircle.studies.report.setup_text import axis_rows, set_up
from encircle.studies.report.tables import many, measures, tables
from encircle.studies.summary import Summary, summarise
from encircle.studies.table import OWNER, TABLE, StudyTable

REPORT = "report.html"
VALUES_MAX = 40


def write_report(
    plan: Plan,
    table: StudyTable,
    directory: Path,
    command: str,
    *,
    summary: Summary | None = None,
    date: str = "",
) -> Path:
    """Write ``report.html``, the CSV files and the figures; returns the path of the page.

    ``table`` must be complete, or have failed runs in place of what is missing: of those the page
    tells, and if there is no seed without one, of little else. ``command`` is what repeats the
    numbers, shown as it is. ``summary`` is that of the table if it is there already.
    """
    missing = int((~table.done & ~table.failed).sum())
    assert missing == 0, f"{missing} runs are missing"
    content = [*_opening(plan, date), *failures(plan, table)]
    if table.whole_seeds:
        summary = summary or summarise(plan, table)
        write_cells(summary, directory / CELLS)
        if summary.comparisons:
            write_comparisons(summary, directory / COMPARISONS)
        charts = write_charts(summary, directory)
        content += [
            *_findings(summary),
            *_set_up(plan, summary.plan),
            *_figures(charts),
            *tables(summary),
            *measures(summary),
            *_methods(summary),
            *_again(plan, table, command, bool(summary.comparisons)),
        ]
    else:
        content += [*_set_up(plan, plan), *_again(plan, table, command, False)]
    path = directory / REPORT
    path.write_text(page.document(plan.title or plan.name, content), encoding="utf-8")
    return path


def _opening(plan: Plan, date: str) -> list[str]:
    cells, seeds = len(plan.cells), len(plan.seed_list)
    told = (
        f"Study {plan.name}: {many(cells, 'cell')}, {many(seeds, 'seed')} each,"
        f" {many(plan.runs, 'run')}." + (f" {date}" if date else "")
    )
    parts = [page.heading(plan.title or plan.name, 1), page.paragraph(told, "soft")]
    if plan.question:
        parts += [page.heading("Question"), page.paragraph(plan.question)]
    return parts


def _findings(summary: Summary) -> list[str]:
    parts = [page.heading("Findings"), *findings_of(summary)]
    note = "In brackets: 95 % intervals, each for itself."
    if summary.comparisons:
        note += f" {correction(summary)}"
    return [*parts, page.paragraph(note, "soft")]


def correction(summary: Summary) -> str:
    """How many tests there are, and what was done about that, in a line."""
    single, over, tests = len(summary.comparisons), len(summary.overall), summary.tests
    averaged = f" and {over} averaged over settings" if over else ""
    return (
        f"{many(single, 'comparison')}{averaged}, each of capture rate, order and mean time, are"
        f" {tests} tests: their p are corrected for that by Holm's procedure, the uncorrected p"
        " stands beside, and a difference is decided only if both its corrected p is at most"
        f" {ALPHA:g} and its interval leaves out zero."
    )


def _set_up(plan: Plan, shown_plan: Plan) -> list[str]:
    tree = plan.scenario_of(0).model_dump(mode="json", exclude={"seed"})
    which = "The scenario, all axes at their first level" if plan.all_axes else "The scenario"
    parts = [page.heading("Set-up")]
    if plan.all_axes:
        axes = ("Axis", "Key", "Levels")
        parts.append(page.table("What is varied", axes, axis_rows(plan, shown_plan), kind="words"))
    parts.append(page.table(which, ("What", "How it is"), set_up(plan), kind="words"))
    shown = _shortened(tree)
    cut = f"; {OWNER} has the lists that are cut short" if shown != tree else ""
    text = json.dumps(shown, indent=2, ensure_ascii=False)
    told = f"{which}, in full, defaults included{cut}"
    return [*parts, page.folded(told, [page.preformatted(text)])]


def _shortened(tree: Any) -> Any:
    """A tree without the middle of long lists."""
    if isinstance(tree, dict):
        return {key: _shortened(value) for key, value in tree.items()}
    if isinstance(tree, list):
        kept = [_shortened(value) for value in tree[:VALUES_MAX]]
        return kept if len(tree) <= VALUES_MAX else [*kept, f"... {len(tree)} in all"]
    return tree


def _figures(charts: Sequence[Chart]) -> list[str]:
    shown = [
        page.figure(number, chart.path, chart.alt, chart.caption, chart.wide)
        for number, chart in enumerate(charts, start=1)
    ]
    told = f"Each is in the directory {FIGURES} beside this page, as PNG and as PDF."
    return [page.heading("Figures"), page.paragraph(told, "soft"), page.figures(shown)]


def _methods(summary: Summary) -> list[str]:
    told = [
        f"All intervals are for {100.0 * CONFIDENCE:g} %. Without bounds: there is no interval, as"
        " for the mean of a single run.",
        "Capture rates have Wilson's interval.",
        "Survival is Kaplan and Meier's estimate: a run that does not capture is censored at its"
        " limit. Its intervals are pointwise, Greenwood's on the scale log(-log).",
        "The mean time to capture, up to the limit, is the mean of the smaller of time to capture"
        " and limit, the area under the survival curve, also called the restricted mean. Its"
        " interval joins Student's for the times of the runs that capture with Wilson's for the"
        " share of those that do not: a few of these make much of the mean, and there may be more"
        " than the runs show. That leaves it wide if runs are few. The median time is when half of"
        " the runs have captured.",
        f"Means of measures have BCa bootstrap intervals from {RESAMPLES} resamples of the seeds,"
        " the same at every call, which can tell nothing of rare runs that are not among these."
        " Runs in which a measure is not defined are left out of its mean.",
    ]
    if summary.comparisons:
        told += [
            "Comparisons are paired: all cells run the same seeds, and runs of one seed share"
            " starts and draws. Differences of rates have Newcombe's interval, their p is McNemar's"
            " exact one. Cohen's g: of the pairs in which only one captured, the share in which the"
            " compared one did, less one half.",
            "Order: the share of seeds in which the compared one captures later, or never, less the"
            " share in which it does earlier, with Bonett and Price's interval; p is the exact sign"
            " test's. A run without capture is later than any with one.",
            "Differences of mean times, up to the lower of both limits, have Student's"
            " interval for two pairs more than there are: one in which one captures at once and the"
            " other never, and its opposite. So has the rate averaged over settings. It allows for"
            " failures that the seeds do not show; without it, means of seeds that all captured"
            " would be told apart by ticks. p is by changing signs of differences, in all ways: it"
            " supposes that the two runs of a seed could be exchanged. d_z is the mean over the"
            " standard deviation of the differences.",
            "The log-rank test takes the cells for independent; its p are corrected among"
            " themselves, and nothing rests on them.",
            correction(summary),
        ]
    if any(cell.delay.s_mean for cell in summary.cells):
        told.append(
            "A packet is delivered at the first tick at or after its arrival, and at the next tick"
            " at the earliest: the delay that was delivered is longer than the one asked for. It is"
            " the mean over packets, of the first copy of each."
        )
    if summary.tolerated:
        told.append(
            "How much is tolerated is where the rate first falls below"
            f" {100.0 * summary.plan.tolerated_rate:g} %, interpolated between levels, with a"
            " bootstrap interval over seeds that is widened to where Wilson's bounds cross if all"
            " runs ended alike beside the crossing."
        )
    return [page.heading("Methods"), page.bullets(told)]


def _again(plan: Plan, table: StudyTable, command: str, compared: bool) -> list[str]:
    row = table.read(["code", "versions"], slice(0, 1)).slice(0, 1).to_pylist()[0]
    versions = json.loads(row["versions"])
    rows = [
        ("Study", plan.name),
        ("Fingerprint of the configuration", plan.fingerprint),
        ("Digest of the code", row["code"]),
        ("Versions", ", ".join(f"{name} {version}" for name, version in versions.items())),
        ("Every run", f"{TABLE}, one row each with its seed and digest"),
        ("Every cell", CELLS),
        *([("Every comparison", COMPARISONS)] if compared else []),
    ]
    told = "This command repeats all runs; where they are done already it only reads them."
    return [
        page.heading("How to repeat it"),
        page.preformatted(command),
        page.paragraph(told),
        page.table(
            "What was run, and where its numbers are", ("What", "Which"), rows, kind="words"
        ),
    ]
