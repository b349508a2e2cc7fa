"""The report of a study: one page that is read without the program, beside figures and CSV files.

Every number on the page is from ``encircle.studies.summary``. The same table and command give the
same bytes: the page has no date unless one is passed in.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from encircle.scene.counts import counted
from encircle.statistics.comparisons import ALPHA
from encircle.statistics.intervals import CONFIDENCE, RESAMPLES
from encircle.studies.charts.charts import FIGURES, Chart, write_charts
from encircle.studies.csv_files import CELLS_FILE, COMPARISONS_FILE, write_cells, write_comparisons
from encircle.studies.plan import Plan
from encircle.studies.report import page
from encircle.studies.report.failures import failure_sections
from encircle.studies.report.findings_tables import finding_sections
from encircle.studies.report.replay_links import replay_sections
from encircle.studies.report.result_tables import measure_tables, result_tables
from encircle.studies.report.setup_text import axis_rows, setup_rows
from encircle.studies.study_directory import OWNER_FILE, REPORT_FILE, TABLE_FILE
from encircle.studies.study_table import StudyTable
from encircle.studies.summary import Summary, summarise
from encircle.studies.telling_runs import Replay

VALUES_MAX = 40


def write_report(
    plan: Plan,
    table: StudyTable,
    directory: Path,
    command: str,
    *,
    summary: Summary | None = None,
    replays: Sequence[Replay] = (),
    date: str = "",
) -> Path:
    """Write ``report.html``, the CSV files and the figures; returns the path of the page.

    ``table`` must be complete, where a failed run counts as present. The page lists failed
    runs; if every seed has one, it says little else. ``command``: the command line that repeats
    the study, shown on the page. ``summary``: the summary of the table, computed if it is not
    given. ``replays``: of its telling runs, to which the page links.
    """
    missing = int((~table.done & ~table.failed).sum())
    assert missing == 0, f"{missing} runs are missing"
    content = [*_opening(plan, date), *failure_sections(plan, table)]
    if table.complete_seeds:
        summary = summary or summarise(plan, table)
        write_cells(summary, directory / CELLS_FILE)
        if summary.comparisons:
            write_comparisons(summary, directory / COMPARISONS_FILE)
        charts = write_charts(summary, directory)
        content += [
            *_findings(summary),
            *replay_sections(plan, replays),
            *_setup(plan, summary.plan),
            *_figures(charts),
            *result_tables(summary),
            *measure_tables(summary),
            *_methods(summary),
            *_repeating(plan, table, command, bool(summary.comparisons)),
        ]
    else:
        content += [
            *replay_sections(plan, replays),
            *_setup(plan, plan),
            *_repeating(plan, table, command, False),
        ]
    path = directory / REPORT_FILE
    path.write_text(page.document(plan.title or plan.name, content), encoding="utf-8")
    return path


def _opening(plan: Plan, date: str) -> list[str]:
    cells, seeds = len(plan.cells), len(plan.seed_list)
    subtitle = (
        f"Study {plan.name}: {counted(cells, 'cell')}, {counted(seeds, 'seed')} each,"
        f" {counted(plan.runs, 'run')}." + (f" {date}" if date else "")
    )
    parts = [page.heading(plan.title or plan.name, 1), page.paragraph(subtitle, "soft")]
    if plan.question:
        parts += [page.heading("Question"), page.paragraph(plan.question)]
    return parts


def _findings(summary: Summary) -> list[str]:
    parts = [page.heading("Findings"), *finding_sections(summary)]
    note = "In brackets: 95 % intervals, each for itself."
    if summary.comparisons:
        note += f" {correction_text(summary)}"
    return [*parts, page.paragraph(note, "soft")]


def correction_text(summary: Summary) -> str:
    """How many tests there are and how their p are corrected, as a sentence."""
    single, over, tests = len(summary.comparisons), len(summary.overall), summary.tests
    averaged = f" and {over} averaged over settings" if over else ""
    return (
        f"{counted(single, 'comparison')}{averaged}, each of capture rate, order and mean time, are"
        f" {tests} tests: their p are corrected for that by Holm's procedure, the uncorrected p"
        " stands beside, and a difference is decided only if both its corrected p is at most"
        f" {ALPHA:g} and its interval leaves out zero."
    )


def _setup(plan: Plan, shown_plan: Plan) -> list[str]:
    tree = plan.scenario_of(0).model_dump(mode="json", exclude={"seed"})
    which = "The scenario, all axes at their first level" if plan.all_axes else "The scenario"
    parts = [page.heading("Set-up")]
    if plan.all_axes:
        axes = ("Axis", "Key", "Levels")
        parts.append(page.table("What is varied", axes, axis_rows(plan, shown_plan), kind="words"))
    parts.append(page.table(which, ("What", "How it is"), setup_rows(plan), kind="words"))
    shown = _shortened(tree)
    cut = f"; {OWNER_FILE} has the lists that are cut short" if shown != tree else ""
    text = json.dumps(shown, indent=2, ensure_ascii=False)
    heading = f"{which}, in full, defaults included{cut}"
    return [*parts, page.collapsible(heading, [page.preformatted(text)])]


def _shortened(tree: Any) -> Any:
    """A tree whose long lists are cut."""
    if isinstance(tree, dict):
        return {key: _shortened(value) for key, value in tree.items()}
    if isinstance(tree, list):
        first_items = [_shortened(value) for value in tree[:VALUES_MAX]]
        return first_items if len(tree) <= VALUES_MAX else [*first_items, f"... {len(tree)} in all"]
    return tree


def _figures(charts: Sequence[Chart]) -> list[str]:
    shown = [
        page.figure(number, chart.path, chart.alt, chart.caption, chart.wide)
        for number, chart in enumerate(charts, start=1)
    ]
    note = f"Each is in the directory {FIGURES} beside this page, as PNG and as PDF."
    return [page.heading("Figures"), page.paragraph(note, "soft"), page.figures(shown)]


def _methods(summary: Summary) -> list[str]:
    sentences = [
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
        sentences += [
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
            correction_text(summary),
        ]
    if any(cell.delay.s_mean for cell in summary.cells):
        sentences.append(
            "A packet is delivered at the first tick at or after its arrival, and at the next tick"
            " at the earliest: the delay that was delivered is longer than the one asked for. It is"
            " the mean over packets, of the first copy of each."
        )
    if summary.tolerances:
        sentences.append(
            "How much is tolerated is where the rate first falls below"
            f" {100.0 * summary.plan.tolerated_rate:g} %, interpolated between levels, with a"
            " bootstrap interval over seeds that is widened to where Wilson's bounds cross if all"
            " runs ended alike beside the crossing."
        )
    return [page.heading("Methods"), page.bullets(sentences)]


def _repeating(plan: Plan, table: StudyTable, command: str, compared: bool) -> list[str]:
    row = table.read(["code", "versions"], slice(0, 1)).slice(0, 1).to_pylist()[0]
    versions = json.loads(row["versions"])
    rows = [
        ("Study", plan.name),
        ("Fingerprint of the configuration", plan.fingerprint),
        ("Digest of the code", row["code"]),
        ("Versions", ", ".join(f"{name} {version}" for name, version in versions.items())),
        ("Every run", f"{TABLE_FILE}, one row each with its seed and digest"),
        ("Every cell", CELLS_FILE),
        *([("Every comparison", COMPARISONS_FILE)] if compared else []),
    ]
    note = "This command repeats all runs; where they are done already it only reads them."
    return [
        page.heading("How to repeat it"),
        page.preformatted(command),
        page.paragraph(note),
        page.table(
            "What was run, and where its numbers are", ("What", "Which"), rows, kind="words"
        ),
    ]
