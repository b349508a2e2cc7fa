"""The benchmark's page: one HTML file to publish, beside its figures and CSV files.

A submission's page shows its policy among the published ones, compared within the same public
seeds, and its score on the held-out seeds. The same runs give the same bytes.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from encircle.benchmark.charts import write_figures
from encircle.benchmark.csv_files import write_scores, write_tasks
from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.score import Score, Scores, scores, share_interval
from encircle.benchmark.seeds import SEEDS
from encircle.benchmark.sentences import (
    difference_from,
    held_out_sentence,
    held_ranks,
    open_ranks,
    own_sentences,
    p_text,
    percent,
    points,
    table_sentences,
    try_sentence,
    verdict_text,
)
from encircle.benchmark.tasks import VERSION, task_named, tasks_digest
from encircle.statistics.intervals import CONFIDENCE, RESAMPLES, Interval
from encircle.studies.charts.charts import FIGURES, Chart
from encircle.studies.report import page

PAGE_FILE, SCORES_FILE, TASKS_FILE = "benchmark.html", "scores.csv", "tasks.csv"


class Submission(NamedTuple):
    """A policy that is compared with the published ones.

    ``name``: as it was submitted. ``policy``: what it was named by, with its own parameters.
    ``held_out``: its runs on the held-out seeds. ``failed``: how many of its runs failed.
    ``unchecked``: what is not known of runs that another has made.
    """

    name: str
    policy: str
    held_out: Outcomes
    failed: int = 0
    unchecked: tuple[str, ...] = ()


class Origin(NamedTuple):
    """Where the numbers on a page come from: digests of code, and the commands to repeat them."""

    code: str
    published_code: str
    commands: tuple[str, ...]


def write_page(
    outcomes: Outcomes, origin: Origin, directory: Path, submission: Submission | None = None
) -> Path:
    """Write page, figures and CSV files into a directory; returns the path of the page.

    ``outcomes``: all policies on the common public seeds, the submission's included.
    """
    directory.mkdir(parents=True, exist_ok=True)
    ranked = scores(outcomes)
    own = () if submission is None else (submission.name,)
    charts = write_figures(outcomes, ranked, directory, own)
    write_scores(ranked, directory / SCORES_FILE)
    write_tasks(outcomes, directory / TASKS_FILE)
    title = f"Encircle benchmark {VERSION}" + (f": {submission.name}" if submission else "")
    content = [
        page.heading(title, 1),
        page.paragraph(_subtitle(outcomes, submission), "soft"),
        *_findings(outcomes, ranked, submission),
        *_table(ranked),
        *_figures(charts),
        *(_held_out(outcomes, submission) if submission else ()),
        *_differences(ranked, submission),
        *_tasks(outcomes),
        *_methods(),
        *_repeating(origin, submission),
    ]
    path = directory / PAGE_FILE
    path.write_text(page.document(title, content), encoding="utf-8")
    return path


def _subtitle(outcomes: Outcomes, submission: Submission | None) -> str:
    text = (
        f"{len(outcomes.tasks)} tasks, {len(outcomes.policies)} policies,"
        f" {len(outcomes.seeds)} of {SEEDS} public seeds"
    )
    if submission is not None:
        text += f", {len(submission.held_out.seeds)} of {SEEDS} held-out seeds"
    return f"{text}. Tasks {tasks_digest()}."


def _findings(outcomes: Outcomes, ranked: Scores, submission: Submission | None) -> Iterator[str]:
    yield page.heading("Findings")
    if submission is None:
        yield page.bullets(table_sentences(ranked, len(outcomes.seeds)))
        return
    (score,) = [score for score in ranked.of if score.policy == submission.name]
    lines = [
        *own_sentences(ranked, submission.name),
        held_out_sentence(submission.name, score.over_seeds, _score_of(submission.held_out)),
    ]
    if submission.failed:
        runs = len(outcomes.tasks) * (len(outcomes.seeds) + len(submission.held_out.seeds))
        lines.append(
            f"{submission.failed} of its {runs} runs failed, and count as hunts without capture."
        )
    if (seeds := min(len(outcomes.seeds), len(submission.held_out.seeds))) < SEEDS:
        lines.append(try_sentence(seeds))
    yield page.bullets([*lines, *submission.unchecked])


def _score_of(held_out: Outcomes) -> Interval:
    return share_interval(held_out.captured[0].mean(axis=0))


def _table(ranked: Scores) -> Iterator[str]:
    yield page.heading("Scores")
    head = (
        "Policy",
        "Score (%), over seeds and tasks",
        "Over seeds (%)",
        "Time (%)",
        "Ranks left open",
        "Ranks in resamples",
    )
    yield page.table("All policies, the highest score first", head, map(_score_row, ranked.of))
    brackets = (
        f"In brackets: {100.0 * CONFIDENCE:g} % intervals, each for itself."
        if ranked.of[0].is_bounded
        else "A single seed gives no intervals and no ranks in resamples."
    )
    yield page.paragraph(
        "Score: mean over tasks of the share of hunts with capture. Time: mean time to capture as a"
        " share of the task's limit, less is better; a hunt without capture counts as 100 %."
        f" {brackets}",
        "soft",
    )


def _score_row(score: Score) -> tuple[str, ...]:
    return (
        score.policy,
        percent(score.over_all),
        percent(score.over_seeds),
        percent(score.time),
        open_ranks(score),
        held_ranks(score),
    )


def _figures(charts: tuple[Chart, ...]) -> Iterator[str]:
    yield page.heading("Figures")
    yield page.paragraph(f"As PNG and PDF in the directory {FIGURES} beside this page.", "soft")
    yield page.figures(
        page.figure(number, chart.path, chart.alt, chart.caption, chart.wide)
        for number, chart in enumerate(charts, start=1)
    )


def _held_out(outcomes: Outcomes, submission: Submission) -> Iterator[str]:
    yield page.heading("Public and held-out seeds")
    mine = outcomes.policies.index(submission.name)
    public, held_out = outcomes.capture_shares[mine], submission.held_out.capture_shares[0]
    rows = [
        (task, f"{100.0 * a:.0f}", f"{100.0 * b:.0f}")
        for task, a, b in zip(outcomes.tasks, public, held_out, strict=True)
    ]
    rows.append(("mean", f"{100.0 * np.mean(public):.1f}", f"{100.0 * np.mean(held_out):.1f}"))
    yield page.collapsible(
        "Captures by task",
        [page.table("Hunts with capture (%)", ("Task", "Public", "Held-out"), rows)],
    )
    yield page.paragraph(
        f"The held-out seeds are hashes of the version and of the name “{submission.name}”."
        " Whoever doubts this page can run the policy under another name, for which nobody can have"
        " prepared it."
    )


def _differences(ranked: Scores, submission: Submission | None) -> Iterator[str]:
    yield page.heading("Differences")
    if submission is None:
        couples = [(pair.a, pair.b, pair.difference) for pair in ranked.pairs]
        couples = [(b, a, difference) for a, b, difference in couples]
    else:
        others = [score.policy for score in ranked.of if score.policy != submission.name]
        couples = [
            (submission.name, other, difference_from(ranked, other, submission.name))
            for other in others
        ]
    rows = [
        (
            one,
            other,
            points(difference.mean),
            p_text(difference.p),
            p_text(difference.p_corrected),
            verdict_text(difference),
        )
        for one, other, difference in couples
    ]
    head = ("Policy", "Against", "Score, points", "p", "Corrected p", "Decision")
    yield page.collapsible(
        f"{len(rows)} differences within seeds, on these tasks",
        [page.table("Score less the other's", head, rows, name_columns=2)],
    )


def _tasks(outcomes: Outcomes) -> Iterator[str]:
    yield page.heading("Tasks")
    rows = []
    for name, limit in zip(outcomes.tasks, outcomes.limit_ticks.tolist(), strict=True):
        task = task_named(name)
        rows.append((name, task.scene, str(task.robots), task.channel, str(limit)))
    head = ("Task", "Scene", "Robots", "Channel", "Limit (ticks)")
    yield page.collapsible("All tasks", [page.table("Tasks", head, rows)])


def _methods() -> Iterator[str]:
    yield page.heading("How it is computed")
    yield page.bullets(
        [
            "Every task has the same weight, and so has every seed. A run that failed is a hunt"
            " without capture.",
            "Intervals over seeds are Student's, of the means of the seeds, with two more seeds:"
            " one in which everything is captured, one in which nothing is.",
            f"Intervals over seeds and tasks are percentiles of {RESAMPLES} resamples in which"
            " both are drawn with replacement, for all policies together; they are rather too wide"
            " than too narrow, and never lie inside the interval over seeds.",
            "A single seed has no intervals of either kind.",
            "Differences are taken within seeds. Their p is that of the exact sign-flip test,"
            " corrected for all pairs of policies by Holm's procedure. A difference is decided if"
            " the corrected p is at most 0.05 and its interval leaves out zero. These say nothing"
            " of other tasks.",
            "The ranks left open are those that no decided difference rules out.",
            "The held-out score and the public score are of different seeds; their difference has"
            " the interval of two independent estimates.",
        ]
    )


def _repeating(origin: Origin, submission: Submission | None) -> Iterator[str]:
    yield page.heading("To repeat it")
    yield page.preformatted("\n".join(origin.commands))
    named = ", as the bundle names it" if submission and submission.unchecked else ""
    texts = [f"Code of these runs{named}: {origin.code}."]
    if submission is not None:
        texts.append(f"Policy{named}: {submission.policy}.")
        same = "the same" if origin.code == origin.published_code else origin.published_code
        texts.append(
            f"Code of the published table: {same}. The digest covers the policy's own file too, so"
            " that it differs for every policy that is not shipped."
        )
    texts.append(f"{SCORES_FILE} and {TASKS_FILE} beside this page hold its numbers.")
    yield page.bullets(texts)
