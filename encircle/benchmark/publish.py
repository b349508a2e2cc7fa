"""Publish the benchmark's table: from a study's directory into the package and its page.

    encircle study benchmark                                    all runs of all policies
    python -m encircle.benchmark.publish runs/study-benchmark   into the package, then --write
    python -m encircle.benchmark.publish                        is docs/benchmark.md current?
    python -m encircle.benchmark.publish --write                make it so, with its figures

Rows and figures of docs/benchmark.md are made of the published table alone.
"""

import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from encircle.benchmark.charts import write_figures
from encircle.benchmark.published import (
    PUBLISHED,
    Published,
    digest_of_runs,
    published,
    write_published,
)
from encircle.benchmark.score import scores
from encircle.benchmark.seeds import public_seeds
from encircle.benchmark.sentences import held_ranks, open_ranks, percent, table_sentences
from encircle.benchmark.tables import read_runs
from encircle.benchmark.tasks import POLICIES, VERSION, tasks_digest
from encircle.protocol.process.log import say, say_error
from encircle.protocol.programs.generated_pages import check_or_write, with_parts
from encircle.studies.charts.charts import FIGURES
from encircle.studies.plan import StudyError

PAGE, PICTURES = Path("docs/benchmark.md"), Path("docs/benchmark")
_COMMAND = "python -m encircle.benchmark.publish"
_BEGIN = f"<!-- {{}}, from the published table: {_COMMAND} -->\n"
_END = "<!-- end of what is from the table -->\n"
_HEAD = (
    "| rank | policy | score, % | over seeds, % | time, % | ranks left open | in resamples |\n"
    "|---|---|---|---|---|---|---|\n"
)


def from_study(directory: Path, path: Path = PUBLISHED) -> Published:
    """Write the table in a study's directory to a file; returns it.

    Raises ``StudyError`` if a shipped policy is missing, or if runs failed.
    """
    runs = read_runs(directory)
    missing = sorted(set(POLICIES) - set(runs.outcomes.policies))
    if missing or runs.failed:
        raise StudyError(
            f"{directory} cannot be published: {runs.failed} runs failed, policies without runs:"
            f" {', '.join(missing) or 'none'}"
        )
    seeds = [seed for seed in public_seeds() if seed in set(runs.outcomes.seeds)]
    index = [runs.outcomes.seeds.index(seed) for seed in seeds]
    digests = {
        (policy, task): digest_of_runs(runs.digests[p, t, index].tolist())
        for p, policy in enumerate(runs.outcomes.policies)
        for t, task in enumerate(runs.outcomes.tasks)
    }
    table = Published(runs.outcomes.with_seeds(seeds), digests, runs.code)
    write_published(table, path)
    return table


def sections() -> dict[str, str]:
    """What stands between the comments of the page, by what the first of them names."""
    table = published()
    ranked = scores(table.outcomes)
    rows = [
        f"| {score.rank} | `{score.policy}` | {percent(score.over_all)} |"
        f" {percent(score.over_seeds)} | {percent(score.time)} | {open_ranks(score)} |"
        f" {held_ranks(score)} |\n"
        for score in ranked.of
    ]
    seeds = table.outcomes.seeds
    lines = [
        f"Benchmark {VERSION}, tasks `{tasks_digest()}`, {len(table.outcomes.tasks)} tasks, seeds"
        f" {seeds[0]} to {seeds[-1]}, code `{table.code}`.",
        *table_sentences(ranked, len(seeds)),
    ]
    return {
        "scores": _HEAD + "".join(rows),
        "findings": "".join(f"- {line}\n" for line in lines),
    }


def current(page: str) -> str:
    """The page with its parts as the table has them; ``ValueError`` for one without."""
    return with_parts(page, {_BEGIN.format(name): text for name, text in sections().items()}, _END)


def write_pictures(folder: Path = PICTURES) -> None:
    """Write the figures of the published table as PNG."""
    outcomes = published().outcomes
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as aside:
        for chart in write_figures(outcomes, scores(outcomes), Path(aside)):
            shutil.copyfile(Path(aside) / FIGURES / chart.path.name, folder / chart.path.name)


def main(arguments: Sequence[str]) -> int:
    """Publish a study's table, or check or write the page; returns the exit status."""
    if len(arguments) == 1 and not arguments[0].startswith("-"):
        try:
            table = from_study(Path(arguments[0]))
        except StudyError as error:
            say_error(f"{error}")
            return 1
        size = PUBLISHED.stat().st_size
        say(f"{PUBLISHED}: {len(table.outcomes.seeds)} seeds, {size} bytes")
        arguments = ["--write"]
    if list(arguments) == ["--write"]:
        write_pictures()
    return check_or_write(PAGE, current, _COMMAND, arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
