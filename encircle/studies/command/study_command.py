"""``encircle study``: run what is missing of a study, then sum it up and write its report.

Where nothing is missing and the report is of this table and this code, nothing is done, and nothing
is imported that is there to run hunts or to draw.
"""

import json
from pathlib import Path
from typing import Any

from encircle.extras import needing
from encircle.protocol.process.log import say, say_error
from encircle.studies.command.replay_choices import ALL, check_pages
from encircle.studies.command.report_record import Outcome, ReportRequest, program, unchanged
from encircle.studies.command.request import Request
from encircle.studies.plan_files import load_plan
from encircle.studies.study_directory import REPORT_FILE, TABLE_FILE, directory_of


def run_study(request: Request) -> dict[str, Any]:
    """Run, sum up and report; returns what ``--json`` prints. Raises as ``Study.run``."""
    program()  # its digest, before those of its modules are imported that draw
    plan = load_plan(request.source, request.changes, request.seeds)
    for remark in plan.remarks():
        say_error(f"encircle: {remark}")
    directory = directory_of(plan.name, request.out)
    report = ReportRequest(plan, directory, request.command, request.replays)
    outcome = unchanged(report)
    if outcome is None:
        outcome = _made(request, report)
    else:
        say_error(f"{plan.name}: nothing is missing, and the report is of these runs")
        for note in outcome.notes:
            say_error(note)
    return {
        "study": plan.name,
        "cells": len(plan.cells),
        "seeds": len(plan.seed_list),
        "runs": plan.runs,
        "ran": outcome.ran,
        "failed": outcome.failed,
        "failure": outcome.failure,
        "fingerprint": plan.fingerprint,
        "out": str(directory),
        "report": str(directory / REPORT_FILE),
        "replays": [str(directory / page) for page in outcome.pages],
        "findings": list(outcome.findings),
    }


def _made(request: Request, report: ReportRequest) -> Outcome:
    """What came of running what is missing, and of writing the report."""
    if request.replays == ALL:
        check_pages()
    # Imported late: what is finished does without the one, and runs begin without the other.
    with needing("a study", "studies"):
        from encircle.studies.command.executing import run_missing
    study, ran = run_missing(request, report)
    from encircle.studies.command.reporting import write_all

    return write_all(study, report)._replace(ran=ran)


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
    say(f"table   {Path(answer['out']) / TABLE_FILE}")
