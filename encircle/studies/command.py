"""``encircle study``: run what is missing of a study, then sum it up and write its report."""

import json
import shlex
import warnings
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from encircle.extras import MissingExtra
from encircle.progress import Progress, Tell
from encircle.protocol.process.interrupts import Interrupted, exit_message, signals_held
from encircle.protocol.process.log import say, say_error
from encircle.studies.plan import Plan
from encircle.studies.plan_files import load_plan
from encircle.studies.replay_choices import ALL, FEW, NONE
from encircle.studies.replays import FEW_S_MAX, check_pages, write_replays
from encircle.studies.report.failures import first_failure_text
from encircle.studies.report.report import write_report
from encircle.studies.report.sentences import summary_sentences
from encircle.studies.study import Study
from encircle.studies.study_table import StudyTable
from encircle.studies.summary import Summary, summarise
from encircle.studies.telling_runs import Replay, telling_runs
from encircle.studies.workers import StudyFailed
from encircle.world.loading.remarks import ScenarioRemark


@dataclass(frozen=True, slots=True)
class Request:
    """What the command line asks for."""

    source: str
    out: Path | None
    seeds: int | str | None
    link: str
    workers: int | None
    cluster: str | None
    changes: Sequence[str]
    replays: str = FEW

    @property
    def command(self) -> str:
        """The command that repeats the numbers, wherever it is run and on however many cores."""
        words = ["encircle", "study", self.source]
        words += [] if self.seeds is None else ["--seeds", str(self.seeds)]
        words += [part for change in self.changes for part in ("--set", change)]
        return shlex.join(words)


def run_study(request: Request) -> dict[str, Any]:
    """Run, sum up and report; returns what ``--json`` prints. Raises as ``Study.run``."""
    if request.replays == ALL:
        check_pages()
    plan = load_plan(request.source, request.changes, request.seeds)
    study = Study(plan, request.out)
    for remark in plan.remarks():
        say_error(f"encircle: {remark}")
    with signals_held(), Progress(plan.name) as progress:
        ran = _run(study, request, progress)
    say_error(f"{plan.name}: writing the report")
    done = f"; all {plan.runs} runs are done, the same command writes the report"
    with exit_message(done, "the study stopped: "), closing(study.open()) as table:
        summary = summarise(plan, table) if table.complete_seeds else None
        replays = _replays(plan, table, summary, request.replays)
        report = write_report(
            plan, table, study.directory, request.command, summary=summary, replays=replays
        )
        failed = int(table.failed.sum())
        failure = first_failure_text(plan, table)
    return {
        "study": plan.name,
        "cells": len(plan.cells),
        "seeds": len(plan.seed_list),
        "runs": plan.runs,
        "ran": ran,
        "failed": failed,
        "failure": failure,
        "fingerprint": plan.fingerprint,
        "out": str(study.directory),
        "report": str(report),
        "replays": [str(study.directory / replay.page) for replay in replays if replay.page],
        "findings": summary_sentences(summary) if summary else [],
    }


def _replays(plan: Plan, table: StudyTable, summary: Summary | None, which: str) -> list[Replay]:
    """The replays of the telling runs; what keeps one from being shown is told."""
    if which == NONE:
        return []
    try:
        check_pages()
    except MissingExtra as missing:
        say_error(f"encircle: {missing}; the report has no links to replays")
        return []
    runs = telling_runs(plan, table, summary, which == ALL)
    wall_s_max = None if which == ALL else FEW_S_MAX
    try:
        with Progress(plan.name, "replays") as progress:
            replays = write_replays(plan, runs, table.directory, wall_s_max, progress)
    except Interrupted as error:
        raise StudyFailed(
            f"{error}; all {plan.runs} runs are done, the same command writes the report"
        ) from None
    for replay in replays:
        if replay.problem:
            say_error(f"encircle: {replay.run.name}: {replay.problem}")
    return replays


def _run(study: Study, request: Request, progress: Tell) -> int:
    runs = 0

    def tell(done: int, of: int) -> None:
        nonlocal runs
        runs = done
        progress(done, of)

    try:
        with warnings.catch_warnings():
            # They have been told in lines of their own.
            warnings.simplefilter("ignore", ScenarioRemark)
            return study.run(
                link=request.link, workers=request.workers, cluster=request.cluster, progress=tell
            )
    except Interrupted as error:
        raise StudyFailed(
            f"{error}; {runs} of {study.plan.runs} runs are done, the same command goes on from"
            " here"
        ) from None


def show(answer: dict[str, Any], as_json: bool) -> None:
    """Print what came of it."""
    if as_json:
        say(json.dumps(answer))
        return
    say(f"{answer['runs']} runs in {answer['cells']} cells, {answer['ran']} of them now")
    for sentence in answer["findings"]:
        say(f"- {sentence}")
    if "page" in answer:
        say(f"page    {answer['page']}")
    say(f"report  {answer['report']}")
    say(f"table   {Path(answer['out']) / 'table.parquet'}")
