"""The published table: what came of every run of the shipped policies on the public seeds.

It lies in the package as a compressed CSV file, a line for each policy and task: the digest of the
line's run digests, and for each seed in order the tick of the capture, or 0. The lines above it
name version, tasks, code and seeds. The same runs give the same bytes.
"""

import csv
import gzip
import hashlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from encircle.benchmark.outcomes import Outcomes
from encircle.benchmark.tasks import VERSION, tasks_digest

PUBLISHED = Path(__file__).parent / f"benchmark-{VERSION}.csv.gz"
_HEAD = ("version", "tasks", "code", "first seed", "seeds")


class Published(NamedTuple):
    """The published table.

    ``digests``: of each policy and task, that of its runs' digests in the order of the seeds.
    ``code``: digest of the code that ran.
    """

    outcomes: Outcomes
    digests: dict[tuple[str, str], str]
    code: str


def published(path: Path = PUBLISHED) -> Published:
    """The table in a file; ``ValueError`` if it is not of this version's tasks."""
    with gzip.open(path, "rt", encoding="utf-8", newline="") as file:
        lines = list(csv.reader(file))
    head = {name: lines[k][1] for k, name in enumerate(_HEAD)}
    if (head["version"], head["tasks"]) != (str(VERSION), tasks_digest()):
        raise ValueError(
            f"{path} is of version {head['version']} and tasks {head['tasks']}, not of"
            f" {VERSION} and {tasks_digest()}"
        )
    first, number = int(head["first seed"]), int(head["seeds"])
    rows = lines[len(_HEAD) + 1 :]
    limits = {task: int(limit) for _, task, limit, *_ in rows}
    names = tuple(dict.fromkeys(policy for policy, *_ in rows))
    ticks = np.array([[int(tick) for tick in row[4].split()] for row in rows], np.int64)
    outcomes = Outcomes(
        names,
        tuple(limits),
        tuple(range(first, first + number)),
        ticks.reshape(len(names), len(limits), number),
        np.array(list(limits.values()), np.int64),
    )
    return Published(outcomes, {(row[0], row[1]): row[3] for row in rows}, head["code"])


def write_published(table: Published, path: Path) -> None:
    """Write a table; its seeds must follow each other."""
    outcomes = table.outcomes
    first = outcomes.seeds[0]
    assert outcomes.seeds == tuple(range(first, first + len(outcomes.seeds))), outcomes.seeds
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    values = (VERSION, tasks_digest(), table.code, first, len(outcomes.seeds))
    writer.writerows(zip(_HEAD, values, strict=True))
    writer.writerow(("policy", "task", "limit in ticks", "digest", "capture tick by seed"))
    for p, policy in enumerate(outcomes.policies):
        for t, task in enumerate(outcomes.tasks):
            ticks = " ".join(map(str, outcomes.capture_ticks[p, t].tolist()))
            digest = table.digests[policy, task]
            writer.writerow((policy, task, int(outcomes.limit_ticks[t]), digest, ticks))
    # Without a time and a name in its head the same table gives the same file.
    path.write_bytes(gzip.compress(text.getvalue().encode(), 9, mtime=0))


def digest_of_runs(digests: Sequence[str]) -> str:
    """One digest of the digests of runs, in order."""
    return hashlib.blake2b("\n".join(digests).encode(), digest_size=8).hexdigest()
