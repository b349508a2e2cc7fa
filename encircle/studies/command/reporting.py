"""A finished study is summed up; report, replays and the record of both are written."""

from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

from encircle.extras import MissingExtra
from encircle.progress import Progress
from encircle.protocol.process.interrupts import Interrupted, exit_message
from encircle.protocol.process.log import say_error
from encircle.studies.charts.charts import FIGURES
from encircle.studies.command.replay_choices import ALL, NONE, check_pages
from encircle.studies.command.report_record import (
    Outcome,
    ReportRequest,
    made_of,
    remove_altered_pages,
    remove_record,
    write_record,
)
from encircle.studies.csv_files import CELLS_FILE, COMPARISONS_FILE
from encircle.studies.plan import Plan
from encircle.studies.replays import FEW_S_MAX, write_replays
from encircle.studies.report.failures import first_failure_text
from encircle.studies.report.report import write_report
from encircle.studies.report.sentences import summary_sentences
from encircle.studies.study import Study
from encircle.studies.study_directory import REPORT_FILE
from encircle.studies.study_table import StudyTable
from encircle.studies.summary import Summary, summarise
from encircle.studies.telling_runs import Replay, telling_runs
from encircle.studies.workers import StudyFailed


def write_all(study: Study, report: ReportRequest) -> Outcome:
    """Write the report of a study all of whose runs are done, and what is beside it."""
    plan = study.plan
    say_error(f"{plan.name}: writing the report")
    with exit_message(_done(plan), "the study stopped: "), closing(study.open()) as table:
        made, directory = made_of(report), table.directory
        remove_altered_pages(directory)
        remove_record(directory)
        summary = summarise(plan, table) if table.complete_seeds else None
        replays, notes = _replays(plan, table, summary, report.replays)
        write_report(plan, table, directory, report.command, summary=summary, replays=replays)
        outcome = Outcome(
            tuple(summary_sentences(summary) if summary else ()),
            tuple(replay.page for replay in replays if replay.page),
            tuple(notes),
            failed=int(table.failed.sum()),
            failure=first_failure_text(plan, table),
        )
        if not outcome.failed:
            write_record(directory, made, outcome, _written(directory, outcome.pages))
    return outcome


def _written(directory: Path, pages: Iterable[str]) -> list[str]:
    """All files that were written, relative to the directory."""
    single = [REPORT_FILE, CELLS_FILE, COMPARISONS_FILE]
    figures = sorted((directory / FIGURES).iterdir())
    return [
        *(name for name in single if (directory / name).exists()),
        *(f"{FIGURES}/{path.name}" for path in figures if path.is_file()),
        *pages,
    ]


def _done(plan: Plan) -> str:
    return f"; all {plan.runs} runs are done, the same command writes the report"


def _replays(
    plan: Plan, table: StudyTable, summary: Summary | None, which: str
) -> tuple[list[Replay], list[str]]:
    """The replays of the telling runs; and lines on what is not shown, which have been told."""
    if which == NONE:
        return [], []
    try:
        check_pages()
    except MissingExtra as missing:
        return [], _told([f"encircle: {missing}; the report has no links to replays"])
    runs = telling_runs(plan, table, summary, which == ALL)
    wall_s_max = None if which == ALL else FEW_S_MAX
    try:
        with Progress(plan.name, "replays") as progress:
            replays = write_replays(plan, runs, table.directory, wall_s_max, progress)
    except Interrupted as error:
        raise StudyFailed(f"{error}{_done(plan)}") from None
    problems = (r for r in replays if r.problem)
    return replays, _told([f"encircle: {r.run.name}: {r.problem}" for r in problems])


def _told(lines: list[str]) -> list[str]:
    for line in lines:
        say_error(line)
    return lines
