"""Rows of a bundle run once more, and its recordings looked at, in processes of their own.

Code from a bundle runs in these processes alone, and only if that was asked for: then they look for
its files first. This process compares what comes back.
"""

import json
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from encircle.bundles.bundle_file import POLICIES_FOLDER, BundleError
from encircle.bundles.bundle_plan import policy_member
from encircle.bundles.contents import Contents
from encircle.bundles.findings import Verification
from encircle.bundles.recordings import RecordingFindings, RecordingJob, look_at, recording_member
from encircle.bundles.sampling import altered_max, sampled
from encircle.bundles.table_text import UNREPEATABLE, Row, columns_of, equal
from encircle.protocol.plugin_files import FOLDERS, is_in_file
from encircle.protocol.plugins import error_line
from encircle.protocol.process.interrupts import signals_held
from encircle.protocol.process.tracebacks import TRACEBACK_IN
from encircle.runner import process_pool as pool
from encircle.studies.running import run_task
from encircle.studies.tasks import FAILED, TRACEBACK, Task
from encircle.world.scenario.errors import ScenarioError

TASK_RUNS = 4
NOT_REPEATED = (UNREPEATABLE, "code", "versions")
Tell = Callable[[int, int], None]


class NotRun(NamedTuple):
    """A piece of work that could not be done, as of a policy that cannot be imported."""

    cell: int
    rows: int
    recordings: int
    reason: str


Job = Task | RecordingJob
Answer = tuple[str, list[Row]] | RecordingFindings | NotRun


def do(policies: str, job: Job) -> Answer:
    """One piece of work of a process: rows to run, or a recording to look at.

    ``policies``: the folder of the bundle's policies; empty if they must not be run.
    """
    folders = os.environ.get(FOLDERS, "").split(os.pathsep)
    if policies and policies not in folders:
        os.environ[FOLDERS] = os.pathsep.join(filter(None, [policies, *folders]))
    try:
        return look_at(job) if isinstance(job, RecordingJob) else run_task(job)
    except BaseException as error:
        # What is run is a stranger's, and may raise what it likes; signals raise nothing here.
        reason = error.args[0] if isinstance(error, ScenarioError) else error_line(error)
        rows = 0 if isinstance(job, RecordingJob) else len(job.seeds)
        return NotRun(job.cell, rows, int(not rows), " ".join(str(reason).split()))


def check_by_running(
    contents: Contents,
    found: Verification,
    rows: int | None,
    seed: int,
    runs_files: bool,
    workers: int,
    tell: Tell,
) -> None:
    """Run a sample of rows and compare, and look at the recordings.

    ``rows``: how many, None for all. ``runs_files``: whether policies in the bundle may be run.
    """
    plan = contents.plan
    able, away = _cells_that_run(contents, runs_files)
    count = len(able) * len(plan.seed_list)
    chosen = sampled(able, plan.seed_list, count if rows is None else rows, seed) if able else []
    there = {(row["cell"], row["seed"]): row for row in contents.rows}
    chosen = [run for run in chosen if run in there]
    recordings = _recording_jobs(contents, able)
    jobs: list[Job] = [*_tasks(contents, chosen, away), *recordings]
    again: dict[tuple[int, int], Row] = {}
    looked: list[RecordingFindings] = []
    codes = set()
    not_run: list[NotRun] = []
    tell(0, len(chosen) + len(recordings))
    for answer in _answers(jobs, workers, contents.folder if runs_files else None):
        if isinstance(answer, RecordingFindings):
            looked.append(answer)
        elif isinstance(answer, NotRun):
            not_run.append(answer)
        else:
            codes.add(answer[0])
            again |= {(row["cell"], row["seed"]): row for row in answer[1]}
        tell(len(again) + len(looked), len(chosen) + len(recordings))
    # What comes back from code of the bundle may be anything.
    ran = [run for run in chosen if run in again]
    different = sum(_compare_row(contents, found, there[run], again[run]) for run in ran)
    _say_not_run(found, not_run)
    _say_lacking(contents, found, able, runs_files)
    _say_rows(contents, found, ran, different, set(able) - {one.cell for one in not_run}, seed)
    _say_code(contents, found, codes if not away else set(), different)
    _say_recordings(contents, found, looked, sum(one.recordings for one in not_run))


def _cells_that_run(contents: Contents, runs_files: bool) -> tuple[list[int], set[tuple[str, str]]]:
    """The cells whose runs can be run here, and what the others lack, by group and name."""
    able, away = [], set()
    for cell in range(len(contents.plan.cells)):
        needed = {
            (group, name)
            for group, name in contents.plan.needed(cell)
            if not (runs_files and is_in_file(name) and policy_member(name) in contents.members)
        }
        away |= needed
        if not needed:
            able.append(cell)
    return able, away


def _tasks(
    contents: Contents, chosen: Sequence[tuple[int, int]], away: set[tuple[str, str]]
) -> Iterator[Task]:
    plan = contents.plan
    plugins = tuple(used for used in plan.plugins if used not in away)
    for cell, runs in groupby(chosen, key=lambda run: run[0]):
        seeds = [seed for _, seed in runs]
        scenario = plan.scenario_of(cell).model_dump_json(exclude_unset=True)
        for at in range(0, len(seeds), TASK_RUNS):
            few = tuple(seeds[at : at + TASK_RUNS])
            yield Task(cell, plan.levels(cell), scenario, few, plan.measure_names, plugins)


def _recording_jobs(contents: Contents, able: Sequence[int]) -> list[RecordingJob]:
    return [
        RecordingJob(
            row["cell"],
            row["seed"],
            contents.plan.scenario_of(row["cell"]).model_dump_json(exclude_unset=True),
            contents.members[member],
        )
        for row in contents.rows
        if row["cell"] in able
        and (member := recording_member(row["cell"], row["seed"])) in contents.members
    ]


def _answers(jobs: Sequence[Job], workers: int, folder: Path | None) -> Iterator[Answer]:
    if not jobs:
        return
    policies = "" if folder is None else str(folder / POLICIES_FOLDER)
    processes = pool.in_processes(partial(do, policies), jobs, min(workers, len(jobs)))
    with signals_held(), closing(processes) as answers:
        try:
            yield from answers
        except BrokenProcessPool as error:
            raise BundleError(f"a process for rows of the bundle is gone: {error}") from None


def _compare_row(contents: Contents, found: Verification, given: Row, again: Row) -> bool:
    """Enter what differs between a row and the same run; whether anything does."""
    name = contents.row_name(given["cell"], given["seed"])
    before = found.count
    for column in columns_of(contents.plan):
        if column in NOT_REPEATED or column == TRACEBACK:
            continue
        mine, theirs = again[column], given[column]
        if column == FAILED:
            # Where the traceback was saved is another place on each machine.
            mine, theirs = (text.partition(TRACEBACK_IN)[0] for text in (mine, theirs))
        if not equal(mine, theirs):
            found.differs(name, column, theirs, mine)
    return found.count > before


def _say_not_run(found: Verification, not_run: Sequence[NotRun]) -> None:
    for reason in sorted({one.reason for one in not_run}):
        ones = [one for one in not_run if one.reason == reason]
        rows, recordings = sum(one.rows for one in ones), sum(one.recordings for one in ones)
        found.unchecked.append(
            f"{rows} rows and {recordings} recordings could not be run: {reason}"
        )


def _say_rows(
    contents: Contents,
    found: Verification,
    ran: Sequence[tuple[int, int]],
    different: int,
    able: Collection[int],
    seed: int,
) -> None:
    """What came of the rows. ``ran``: those that were run; ``able``: cells whose runs can be."""
    plan = contents.plan
    seeds, run, could = len(plan.seed_list), len(ran), len(able) * len(plan.seed_list)
    numbers = {"of": len(contents.rows), "rerun": run, "different": different, "seed": seed}
    found.numbers["rows"] = numbers
    if run and not different:
        found.agreed.append(
            f"{run} of {len(contents.rows)} rows were rerun: their digests and all"
            f" {len(plan.measure_names)} measures are equal"
        )
    sampled_here = sum(cell in able for cell, _ in ran)
    if sampled_here < could and not different:
        most = altered_max(len(able), seeds, sampled_here) if sampled_here else could
        numbers["altered_max"] = most
        found.unchecked.append(
            f"{could - sampled_here} of {could} rows were not rerun (--seed {seed} draws the same;"
            f" --all runs all): altered rows may have escaped, at most {most}"
            f" ({100.0 * most / could:.3g} %) with 95 % confidence"
        )
    found.unchecked.append(f"{UNREPEATABLE}, how long a run took, is another each time")


def _say_lacking(
    contents: Contents, found: Verification, able: Sequence[int], runs_files: bool
) -> None:
    """Which rows need code that was not run. ``able``: the cells whose runs may be run here."""
    plan = contents.plan
    cells = [cell for cell in range(len(plan.cells)) if cell not in able]
    if cells:
        lacking = sorted({name for cell in cells for _, name in plan.needed(cell)})
        in_files = not runs_files and any(map(is_in_file, lacking))
        hint = "; --run-policies runs those in the bundle, read them first" if in_files else ""
        found.unchecked.append(
            f"{len(cells) * len(plan.seed_list)} of {plan.runs} rows: they need"
            f" {', '.join(lacking)}, which is code that was not run, or is not here{hint}"
        )


def _say_code(contents: Contents, found: Verification, codes: set[str], different: int) -> None:
    """Whether the code and versions here are those of the bundle, as far as that is known."""
    row = contents.rows[0] if contents.rows else None
    if row is None:
        return
    note = "; the rows that differ may do so for this reason" if different else ""
    if codes and codes != {row["code"]}:
        here = ", ".join(sorted(codes))
        found.unchecked.append(f"the code: here it is {here}, the bundle's is {row['code']}{note}")
    elif codes:
        found.agreed.append(f"the code here is that of the bundle, {row['code']}")
    else:
        found.unchecked.append("the code: its digest here is not known, as not all of it was run")


def _say_recordings(
    contents: Contents,
    found: Verification,
    looked: Sequence[RecordingFindings],
    not_run: int,
) -> None:
    """What came of the recordings; ``not_run``: how many were tried in vain, and are told of."""
    digests = {(row["cell"], row["seed"]): row["digest"] for row in contents.rows}
    other_versions = 0
    before = found.count
    for one in sorted(looked, key=lambda one: one[:2]):
        member = recording_member(one.cell, one.seed)
        for what, given, recomputed in one.differences:
            found.differs(member, what, given, recomputed)
        if one.digest != digests[one.cell, one.seed]:
            found.differs(member, "digest of its run", digests[one.cell, one.seed], one.digest)
        other_versions += not one.same_bytes and not one.differences
    there = sum(name.endswith(".mcap") for name in contents.members)
    found.numbers["recordings"] = {"of": there, "replayed": len(looked)}
    if looked and found.count == before:
        decisions = sum(one.decisions for one in looked)
        found.agreed.append(
            f"{len(looked)} recordings are those of their runs, made again; fresh brains decide the"
            f" same on them ({decisions} messages)"
        )
    if other_versions:
        found.unchecked.append(
            f"{other_versions} recordings were made by other versions: their messages are the same,"
            " the rest of the files was not compared"
        )
    if left := there - len(looked) - not_run:
        why = "their runs cannot be run here" if contents.rows else "there is no row of their runs"
        found.unchecked.append(f"{left} recordings: {why}")


def versions_text(contents: Contents) -> str:
    """The versions that computed the rows, of which some are others here; empty if none is."""
    from encircle.studies.sources import versions

    try:
        theirs = json.loads(contents.rows[0]["versions"])
        own = versions()
        others = [f"{k} {theirs[k]} (here {own[k]})" for k in own if theirs.get(k) != own[k]]
        others += [f"{k} {v} (not known here)" for k, v in theirs.items() if k not in own]
    except (ValueError, IndexError, AttributeError, KeyError):
        return "versions that cannot be read"
    return ", ".join(others)
