"""``encircle benchmark POLICY --name NAME``: run a policy on all tasks, and write its page.

The directory is that of a study with one policy, so that it is gone on with, looked at and bundled
like any study. The published table is not run again: its runs have the same public seeds.
"""

import re
import shlex
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.page import Origin, Submission, write_page
from encircle.benchmark.published import published
from encircle.benchmark.score import Score, Scores, scores, share_interval
from encircle.benchmark.seeds import SEEDS, checked_name, held_out_seeds, public_seeds
from encircle.benchmark.sentences import held_out_sentence, own_sentences, percent, table_sentences
from encircle.benchmark.tables import BenchmarkRuns, read_runs
from encircle.benchmark.tasks import POLICIES, STUDY, VERSION, submission_plan
from encircle.progress import Progress
from encircle.protocol.process.interrupts import Interrupted, signals_held
from encircle.protocol.process.log import say_error
from encircle.studies.plan import StudyError
from encircle.studies.study import Study
from encircle.studies.workers import StudyFailed
from encircle.world.loading.remarks import ScenarioRemark


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
    """Run what is missing, and write the page; returns what ``--json`` prints.

    Raises ``StudyError`` for what was asked wrongly, ``StudyFailed`` if the runs stopped.
    """
    name = _submitted_name(request.name)
    request = replace(request, name=name)
    plan = submission_plan(request.policy, name, request.seeds, request.policy_parameters)
    study = Study(plan, request.directory)
    ran = _run(study, request.workers)
    say_error(f"{plan.name}: writing the page")
    runs = read_runs(study.directory)
    table = published()
    public, held_out = split_seeds(runs, name)
    all_policies = public.beside(table.outcomes)
    commands = (request.command,)
    page = write_page(
        all_policies,
        Origin(runs.code, table.code, commands),
        study.directory,
        Submission(name, request.policy, held_out, runs.failed),
    )
    ranked = scores(all_policies)
    (score,) = [score for score in ranked.of if score.policy == name]
    of_held_out = share_interval(held_out.captured[0].mean(axis=0))
    return {
        "benchmark": VERSION,
        "name": name,
        "policy": request.policy,
        "seeds": len(all_policies.seeds),
        "runs": plan.runs,
        "ran": ran,
        "failed": runs.failed,
        "score": _as_dict(score),
        "held_out": dict(zip(("score", "low", "high"), of_held_out, strict=True)),
        "out": str(study.directory),
        "page": str(page),
        "findings": [
            *own_sentences(ranked, name),
            held_out_sentence(name, score.over_seeds, of_held_out),
        ],
    }


def split_seeds(runs: BenchmarkRuns, name: str) -> tuple[Outcomes, Outcomes]:
    """A submission's runs on the public seeds and on its held-out seeds, under its name."""
    (_,) = runs.outcomes.policies
    named = replace(runs.outcomes, policies=(name,))
    done = set(named.seeds)
    both = public_seeds(), held_out_seeds(VERSION, name)
    parts = [named.with_seeds([seed for seed in seeds if seed in done]) for seeds in both]
    if not all(part.seeds for part in parts):
        raise StudyError(f"the runs have no public seeds, or none that are held out for {name!r}")
    return parts[0], parts[1]


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


def _submitted_name(text: str) -> str:
    try:
        name = checked_name(text)
    except ValueError as error:
        raise StudyError(f"--name: {error}") from None
    if name in POLICIES:
        raise StudyError(f"--name: {name!r} is the name of a shipped policy; choose another")
    return name


def _slug(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "policy"


def _run(study: Study, workers: int | None) -> int:
    done = 0
    with signals_held(), Progress(study.plan.name) as progress:

        def tell(now: int, of: int) -> None:
            nonlocal done
            done = now
            progress(now, of)

        try:
            with warnings.catch_warnings():
                # The tasks are given, and nobody can act on remarks on them.
                warnings.simplefilter("ignore", ScenarioRemark)
                return study.run(workers=workers, progress=tell)
        except Interrupted as error:
            raise StudyFailed(
                f"{error}; {done} of {study.plan.runs} runs are done, the same command goes on from"
                " here"
            ) from None


def _as_dict(score: Score) -> dict[str, Any]:
    return {
        "policy": score.policy,
        "score": score.over_all.value,
        "low": score.over_all.low,
        "high": score.over_all.high,
        "seeds_low": score.over_seeds.low,
        "seeds_high": score.over_seeds.high,
        "time": score.time.value,
        "rank": score.rank,
        "best": score.best,
        "worst": score.worst,
    }
