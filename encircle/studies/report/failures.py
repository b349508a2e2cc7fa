"""Failed runs of a study: what the report and the command line say about them."""

from encircle.scene.counts import counted
from encircle.studies.plan import Plan
from encircle.studies.report import page
from encircle.studies.report.result_tables import NO_VALUE
from encircle.studies.report.sentences import levels_text
from encircle.studies.study_directory import TABLE_FILE
from encircle.studies.study_table import StudyTable
from encircle.studies.tasks import FAILED

FAILURES_MAX = 100


def failure_sections(plan: Plan, table: StudyTable) -> list[str]:
    """Parts of the page: which runs failed, and what that means for the numbers.

    Empty if none did.
    """
    count = int(table.failed.sum())
    if not count:
        return []
    rows = [
        (levels_text(plan, failure) or NO_VALUE, str(failure["seed"]), failure[FAILED])
        for failure in table.failures(FAILURES_MAX)
    ]
    cut = (
        f"; the first {FAILURES_MAX} of {count}, all in {TABLE_FILE}"
        if count > FAILURES_MAX
        else ""
    )
    return [
        page.heading("Failed runs"),
        page.paragraph(failures_text(table)),
        page.table(f"Runs that failed{cut}", ("At", "Seed", "How"), rows, kind="words"),
    ]


def failures_text(table: StudyTable) -> str:
    """How many runs failed, and which seeds are left out because of that, as a line."""
    count, left, seeds = int(table.failed.sum()), len(table.complete_seeds), table.failed.shape[1]
    text = f"{count} of {table.failed.size} runs failed"
    if not left:
        return f"{text}, at least one with every seed: there is nothing to compare."
    return (
        f"{text}. The {counted(seeds - left, 'seed')} with which a run failed"
        f" {'are' if seeds - left > 1 else 'is'} left out of every cell, so that all have the same"
        f" {left}; if failures have to do with how hard a hunt is, what is left is no fair sample."
    )


def first_failure_text(plan: Plan, table: StudyTable) -> str:
    """How many runs failed, and the first of them; empty if none did."""
    first = table.failures(1)
    if not first:
        return ""
    at = levels_text(plan, first[0])
    where = f"{f'{at}, ' if at else ''}seed {first[0]['seed']}"
    return f"{failures_text(table)} The first, at {where}: {first[0][FAILED]}"
