"""The report of a study as members of a bundle: page, CSV files, figures, and numbers as data.

It is made from plan and table alone, so that whoever verifies makes it again and compares.
"""

import json
import shlex
import tempfile
from pathlib import Path

from encircle.bundles.bundle_file import FIGURES_FOLDER, NUMBERS, REPORT_FOLDER
from encircle.studies.charts.charts import FIGURES
from encircle.studies.csv_files import CELLS_FILE, COMPARISONS_FILE
from encircle.studies.plan import Plan
from encircle.studies.report.numbers import report_numbers
from encircle.studies.report.report import write_report
from encircle.studies.study_directory import REPORT_FILE
from encircle.studies.study_table import StudyTable
from encircle.studies.summary import summarise


def report_members(plan: Plan, table: StudyTable) -> dict[str, bytes]:
    """The members of the report of a complete table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        summary = summarise(plan, table) if table.complete_seeds else None
        write_report(plan, table, folder, command_of(plan), summary=summary)
        files = [folder / REPORT_FILE, folder / CELLS_FILE, folder / COMPARISONS_FILE]
        members = {
            f"{REPORT_FOLDER}{path.name}": path.read_bytes() for path in files if path.exists()
        }
        for path in sorted((folder / FIGURES).glob("*.png")):
            members[f"{FIGURES_FOLDER}{path.name}"] = path.read_bytes()
    numbers = report_numbers(summary) if summary else {}
    members[NUMBERS] = (json.dumps(numbers, indent=1, allow_nan=False) + "\n").encode()
    return members


def command_of(plan: Plan) -> str:
    """The command that repeats a study, from its plan: what was typed is not known any more."""
    words = ["encircle", "study", plan.name]
    words += [] if (seeds := _seeds_text(plan)) is None else ["--seeds", seeds]
    words += [part for change in plan.changes for part in ("--set", change)]
    return shlex.join(words)


def _seeds_text(plan: Plan) -> str | None:
    """Seeds as ``--seeds`` takes them; None for a list with gaps, which only a file can have."""
    seeds = plan.seed_list
    if seeds == tuple(range(1, len(seeds) + 1)):
        return str(len(seeds))
    if seeds == tuple(range(seeds[0], seeds[0] + len(seeds))):
        return f"{seeds[0]}-{seeds[-1]}"
    return None
