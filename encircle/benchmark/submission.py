"""``encircle benchmark POLICY --name NAME``: run a policy on all tasks, and write its page.

The directory is that of a study with one policy, so that it is gone on with, looked at and bundled
like any study. The published table is not run again: its runs have the same public seeds.
"""

import json
import math
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.page import Origin, Submission, write_page
from encircle.benchmark.published import published
from encircle.benchmark.score import Score, Scores, scores, share_interval
from encircle.benchmark.seeds import SEEDS, checked_name, held_out_seeds, public_seeds
from encircle.benchmark.sentences import (
    held_out_sentence,
    not_rerun_sentence,
    own_sentences,
    percent,
    table_sentences,
    try_sentence,
    verify_command,
)
from encircle.benchmark.tables import OWN_PARAMETERS, BenchmarkRuns, read_runs, runs_of
from encircle.benchmark.tasks import POLICIES, STUDY, VERSION, submission_plan
from encircle.bundles.contents import opened
from encircle.bundles.findings import Verification
from encircle.bundles.packing import pack
from encircle.protocol.process.interrupts import check, signals_held
from encircle.protocol.process.log import printable, say_error
from encircle.studies.command.executing import run_shown
from encircle.studies.plan import StudyError
from encircle.studies.study import Study
from encircle.studies.study_directory import OWNER_FILE
from encircle.whole_directory import emptied_on_failure
from encircle.whole_files import OutputError
from encircle.world.recording.run_directory import create

BUNDLE_FILE = f"{STUDY}-{VERSION}.zip"
CHECKED = "checked"
"""The directory in the command on a bundle's page, wherever the page was written."""


@dataclass(frozen=True, slots=True)
class Request:
    """What the command line asks for. ``policy_parameters``: ``NAME=VALUE`` each."""

    policy: str
    name: str
    out: Path | None = None
    seeds: int = SEEDS
    workers: int | None = None
    policy_parameters: Sequence[str] = ()

    @property
    def directory(self) -> Path:
        """Where table and page go."""
        return self.out or Path("runs") / f"{STUDY}-{_slug(self.name)}"

    @property
    def command(self) -> str:
        """The command that repeats the numbers, wherever it is run and on however many cores."""
        words = ["encircle", "benchmark", self.policy, "--name", self.name]
        words += [part for given in self.policy_parameters for part in ("--set", given)]
        words += [] if self.seeds == SEEDS else ["--seeds", str(self.seeds)]
        return shlex.join(words)


def run_submission(request: Request) -> dict[str, Any]:
    """Run what is missing, write the page and pack a bundle; returns what ``--json`` prints.

    Raises ``StudyError`` for what was asked wrongly, ``StudyFailed`` if the runs stopped.
    """
    name = _submitted_name(request.name, "--name")
    request = replace(request, name=name)
    plan = submission_plan(request.policy, name, request.seeds, request.policy_parameters)
    study = Study(plan, request.directory)
    _refuse_other_name(study.directory, name)
    ran = run_shown(study, workers=request.workers)
    say_error(f"{name}: writing page and bundle")
    runs = read_runs(study.directory)
    bundle = study.directory / BUNDLE_FILE
    with _written_into(study.directory):
        written = write_submission_page(runs, (request.command,), study.directory)
        # Page and bundle are made anew at each call, of all runs that there are.
        bundle.unlink(missing_ok=True)
    packed = pack(study.directory, bundle)
    return {**written, "ran": ran, "bundle": str(bundle), "sha256": packed.sha256}


@signals_held()
def score_bundle(path: Path, directory: Path) -> dict[str, Any]:
    """Write the page of a submission's bundle into a directory; returns what ``--json`` prints.

    The score is computed from the bundle's rows. Whether these are true is what
    ``encircle verify`` tells. Raises ``StudyError`` if they are not a submission's or differ from
    what the rest of the bundle says, ``BundleError`` if it is no bundle, ``RunDirectoryError`` if
    the directory cannot be used or is not empty.
    """
    found = Verification()
    with opened(path, found) as contents:
        if contents is None or found.count:
            raise StudyError(_differs(path, found))
        _check_title(contents.plan.title, path)
        runs = runs_of(contents.plan, contents.rows, contents.manifest["code"], str(path))
        brings_policies = bool(contents.manifest["policies"])
    check()
    split_seeds(runs)
    commands = (
        shlex.join(["encircle", "benchmark", path.name, "--out", CHECKED]),
        verify_command(path.name, brings_policies),
    )
    unchecked = (not_rerun_sentence(path.name, brings_policies),)
    with _written_into(directory), emptied_on_failure(create(directory)):
        written = write_submission_page(runs, commands, directory, unchecked)
    return {**written, "unchecked": [not_rerun_sentence(str(path), brings_policies)]}


def write_submission_page(
    runs: BenchmarkRuns, commands: Sequence[str], directory: Path, unchecked: Sequence[str] = ()
) -> dict[str, Any]:
    """Write the page of a submission's runs; returns what is to be told of it.

    ``commands``: that repeat its numbers. ``unchecked``: what its page says of runs of others.
    """
    name, policy, table = runs.plan.title, runs.plan.strategies[0], published()
    public, held_out = split_seeds(runs)
    outcomes = public.beside(table.outcomes)
    origin = Origin(runs.code, table.code, tuple(commands))
    parameters = [line.removeprefix(OWN_PARAMETERS) for line in runs.plan.changes]
    named = ", ".join([policy, *parameters])
    submission = Submission(name, named, held_out, runs.failed, tuple(unchecked))
    page = write_page(outcomes, origin, directory, submission)
    ranked = scores(outcomes)
    (score,) = [score for score in ranked.of if score.policy == name]
    of_held_out = share_interval(held_out.captured[0].mean(axis=0))
    seeds = len(outcomes.seeds)
    return {
        "benchmark": VERSION,
        "name": name,
        "policy": policy,
        "seeds": seeds,
        "runs": runs.plan.runs,
        "failed": runs.failed,
        "score": _as_dict(score),
        "held_out": _without_nan(zip(("score", "low", "high"), of_held_out, strict=True)),
        "out": str(directory),
        "page": str(page),
        "findings": [
            *own_sentences(ranked, name),
            held_out_sentence(name, score.over_seeds, of_held_out),
            *([] if seeds == SEEDS else [try_sentence(seeds)]),
        ],
    }


def split_seeds(runs: BenchmarkRuns) -> tuple[Outcomes, Outcomes]:
    """A submission's runs on the public seeds and on its held-out seeds, under its name.

    Raises ``StudyError`` if its seeds are not the first of both kinds, as many of each: who could
    leave seeds out could choose them.
    """
    name, number = runs.plan.title, len(runs.outcomes.seeds) // 2
    expected: tuple[int, ...] = ()
    if 0 < number <= SEEDS:
        expected = (*public_seeds(number), *held_out_seeds(VERSION, name, number))
    if set(runs.outcomes.seeds) != set(expected) or len(runs.outcomes.policies) != 1:
        raise StudyError(
            f"the runs are not those of one policy with the public seeds and those that are held"
            f" out for {name!r}"
        )
    named = replace(runs.outcomes, policies=(name,))
    return named.with_seeds(expected[:number]), named.with_seeds(expected[number:])


def write_table_page(directory: Path) -> dict[str, Any]:
    """Write the page of all policies in a directory of ``encircle study benchmark``.

    Returns what ``--json`` prints. Raises ``StudyError`` as ``read_runs`` does.
    """
    runs = read_runs(directory)
    outcomes = runs.outcomes
    public = [seed for seed in public_seeds() if seed in set(outcomes.seeds)]
    if not public:
        raise StudyError(f"{directory} has no runs on the public seeds of benchmark {VERSION}")
    outcomes = outcomes.with_seeds(public)
    seeds = "" if len(public) == SEEDS else f" --seeds {public[0]}-{public[-1]}"
    commands = (f"encircle study {STUDY}{seeds}",)
    page = write_page(outcomes, Origin(runs.code, runs.code, commands), directory)
    ranked = scores(outcomes)
    return {
        "benchmark": VERSION,
        "scores": [_as_dict(score) for score in ranked.of],
        "page": str(page),
        "findings": table_sentences(ranked, len(public)),
    }


def published_lines() -> list[str]:
    """The published table, a line for each policy, for the terminal."""
    outcomes = published().outcomes
    width = max(map(len, outcomes.policies))
    ranked: Scores = scores(outcomes)
    return [
        f"benchmark {VERSION}: {len(outcomes.tasks)} tasks, {len(outcomes.seeds)} seeds;"
        " score (%) with its interval over seeds and tasks",
        *(
            f"{score.rank:3}  {score.policy:{width}}  {percent(score.over_all)}"
            for score in ranked.of
        ),
    ]


def _submitted_name(text: str, where: str) -> str:
    """The name of a submission, with single spaces; ``where``: what gives it, for messages."""
    try:
        name = checked_name(text)
    except ValueError as error:
        raise StudyError(f"{where}: {error}") from None
    if name in POLICIES:
        raise StudyError(f"{where}: {name!r} is the name of a shipped policy; choose another")
    return name


def _check_title(title: str, path: Path) -> None:
    """Refuse a bundle whose title the command would not have given it."""
    if _submitted_name(title, f"{path}: title") != title:
        raise StudyError(
            f"{path}: title: name {title!r}: must have single spaces between its words, and none"
            " around them"
        )


def _differs(path: Path, found: Verification) -> str:
    """Why a bundle that does not agree with itself is not scored."""
    many = "one thing differs" if found.count == 1 else f"{found.count} things differ, first"
    return (
        f"{path} is not what it says: {many}, {printable(found.differences[0].line)}; see"
        f" {shlex.join(['encircle', 'verify', str(path)])}; nothing was written"
    )


@contextmanager
def _written_into(directory: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"{directory} cannot be written: {error.strerror or error}") from None


def _refuse_other_name(directory: Path, name: str) -> None:
    """Refuse a directory of a submission of another name, which has other held-out seeds."""
    try:
        tree = json.loads((directory / OWNER_FILE).read_text(encoding="utf-8"))
        other = str(tree["plan"]["title"])
    except (OSError, ValueError, KeyError, TypeError):
        return  # new, or not a submission's: the table says so
    if other != name:
        raise StudyError(
            f"{directory} holds the runs of {other!r}, this is {name!r}: choose another --out;"
            " nothing was changed"
        )


def _slug(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "policy"


def _without_nan(numbers: Iterable[tuple[str, float]]) -> dict[str, float | None]:
    """Numbers by name for JSON, which has no NaN: null where there is none."""
    return {name: None if math.isnan(number) else number for name, number in numbers}


def _as_dict(score: Score) -> dict[str, Any]:
    bounds = {
        "score": score.over_all.value,
        "low": score.over_all.low,
        "high": score.over_all.high,
        "seeds_low": score.over_seeds.low,
        "seeds_high": score.over_seeds.high,
        "time": score.time.value,
    }
    return {
        "policy": score.policy,
        **_without_nan(bounds.items()),
        "rank": score.rank,
        "best": score.best,
        "worst": score.worst,
    }
