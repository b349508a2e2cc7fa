"""What is in a bundle: read, and checked against itself. Nothing of it is run."""

import json
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from encircle.bundles.bundle_file import (
    MANIFEST,
    PLAN,
    POLICIES_FOLDER,
    TABLE,
    TRACES_FOLDER,
    BundleError,
    Members,
    read_members,
    sha256,
)
from encircle.bundles.bundle_plan import BundlePlan, read_plan, trace_member
from encircle.bundles.findings import Verification
from encircle.bundles.manifest import GIVEN, manifest, read_manifest
from encircle.bundles.recordings import recording_member
from encircle.bundles.sampling import sampled
from encircle.bundles.table_text import Row, read_table
from encircle.protocol.process.log import printable
from encircle.studies.tasks import FAILED

DIGEST = re.compile(r"[0-9a-f]{32}")


class Contents(NamedTuple):
    """A bundle that could be read. ``folder``: where its traces and policies lie meanwhile.

    ``whole``: whether its rows are exactly those of the plan.
    """

    members: Members
    manifest: dict[str, Any]
    plan: BundlePlan
    rows: list[Row]
    folder: Path
    whole: bool

    def row_name(self, cell: int, seed: int) -> str:
        """A row as it is named to people."""
        if not 0 <= cell < len(self.plan.cells):
            return f"row of cell {cell}, seed {seed}"
        levels = "".join(f", {k} = {v}" for k, v in self.plan.levels(cell).items())
        return f"row of cell {cell}{printable(levels)}, seed {seed}"


@contextmanager
def opened(path: Path, found: Verification) -> Iterator[Contents | None]:
    """A bundle, with what was found when it was held against itself; None if it has no table.

    ``BundleError`` if it cannot be read at all.
    """
    members = read_members(path)
    tree = read_manifest(members[MANIFEST])
    found.numbers["sha256"] = sha256(members[MANIFEST])
    _check_hashes(members, tree, found)
    with TemporaryDirectory(prefix="encircle-bundle-") as name:
        folder = Path(name)
        try:
            plan = read_plan(members[PLAN], _traces_in(members, tree, folder))
            rows = read_table(plan, members[TABLE])
        except BundleError as error:
            found.differs("bundle", "", " ".join(str(error).split()), "what can be read")
            found.unchecked.append("rows, recordings and report: plan or table cannot be read")
            yield None
            return
        _write_policies(members, folder)
        contents = Contents(members, tree, plan, rows, folder, whole=False)
        whole = check_rows(contents, found)
        _check_manifest(contents, found)
        _check_sample(contents, found)
        yield contents._replace(whole=whole)


def _check_hashes(members: Members, tree: dict[str, Any], found: Verification) -> None:
    listed = tree.get("members")
    listed = listed if isinstance(listed, dict) else {}
    for name in sorted({*members, *map(str, listed)} - {MANIFEST}):
        if name not in members:
            found.differs(MANIFEST, "members", f"has {name}", "it is not in the bundle")
        elif name not in listed:
            found.differs(name, "", "a member", f"{MANIFEST} has none of that name")
        elif listed[name] != (actual := _entry(members[name])):
            found.differs(name, "hash", json.dumps(listed[name]), json.dumps(actual))
    if not found.count:
        found.agreed.append(f"{len(listed)} members have the hashes of the manifest")


def _entry(content: bytes) -> dict[str, Any]:
    return {"bytes": len(content), "sha256": sha256(content)}


def check_rows(contents: Contents, found: Verification) -> bool:
    """Whether the rows are those of the plan: every run once, its levels, code and versions."""
    plan, before = contents.plan, found.count
    seeds = set(plan.seed_list)
    counts: Counter[tuple[int, int]] = Counter()
    for row in contents.rows:
        cell, seed = row["cell"], row["seed"]
        name = contents.row_name(cell, seed)
        if not (0 <= cell < len(plan.cells) and seed in seeds):
            found.differs(name, "", "a row", "the plan has no such cell or seed")
            continue
        counts[cell, seed] += 1
        if counts[cell, seed] > 1:
            found.differs(name, "", f"{counts[cell, seed]} times", "once")
        levels = plan.levels(cell)
        for column, level in levels.items():
            if row[column] != level:
                found.differs(name, column, row[column], level)
        for column in ("code", "versions"):
            if row[column] != contents.rows[0][column]:
                found.differs(name, column, row[column], contents.rows[0][column])
        if not (DIGEST.fullmatch(row["digest"]) or (row[FAILED] and not row["digest"])):
            found.differs(name, "digest", row["digest"], "32 hexadecimal digits")
    for cell in range(len(plan.cells)):
        for seed in plan.seed_list:
            if not counts[cell, seed]:
                found.differs(contents.row_name(cell, seed), "", "missing", "a row")
    if found.count == before:
        found.agreed.append(
            f"{len(contents.rows)} rows are the {plan.runs} runs of the plan: {len(plan.cells)}"
            f" cells with {len(plan.seed_list)} seeds, each once"
        )
    return found.count == before


def _check_manifest(contents: Contents, found: Verification) -> None:
    """What the manifest says follows from plan, table and members."""
    given, before = contents.manifest, found.count
    row: Row = contents.rows[0] if contents.rows else {"code": "", "versions": "{}"}
    try:
        versions = json.loads(row["versions"])
    except (ValueError, RecursionError):
        versions = row["versions"]
    made = manifest(
        contents.plan,
        row["code"],
        versions if isinstance(versions, dict) else {},
        contents.members,
        {key: given[key] for key in GIVEN},
    )
    used = set(given["traces"].values())
    made["traces"] = {
        name: trace_member(name, contents.members[member])
        for name, member in given["traces"].items()
    }
    for name in sorted(contents.members):
        if name.startswith(TRACES_FOLDER) and name not in used:
            found.differs(name, "", "a trace", "no scenario of the plan reads it")
    made["policies"] = sorted(n for n in contents.members if n.startswith(POLICIES_FOLDER))
    for key in sorted({*made, *given} - {"members"}):
        theirs, own = (json.dumps(tree.get(key), sort_keys=True) for tree in (given, made))
        # As texts: 2.0 is no number of cells.
        if theirs != own or (key in given) != (key in made):
            found.differs(MANIFEST, key, theirs, own)
    if found.count == before:
        found.agreed.append("what the manifest says of plan, table and code follows from them")


def _check_sample(contents: Contents, found: Verification) -> None:
    """The recordings are those that the sample's seed draws, which is the packer's choice."""
    plan, sample = contents.plan, contents.manifest["sample"]
    seed, count = sample.get("seed"), sample.get("recordings")
    sound = all(type(number) is int and 0 <= number < 2**63 for number in (seed, count))
    if not sound or set(sample) != {"seed", "recordings"}:
        found.differs(MANIFEST, "sample", json.dumps(sample), "a seed, and a number of recordings")
        return
    failed = {(row["cell"], row["seed"]) for row in contents.rows if row[FAILED]}
    drawn = {
        recording_member(*run)
        for run in sampled(range(len(plan.cells)), plan.seed_list, count, seed)
        if run not in failed
    }
    there = {name for name in contents.members if name.endswith(".mcap")}
    for name in sorted(drawn - there):
        found.differs(name, "", "missing", f"the sample of seed {seed} has it")
    for name in sorted(there - drawn):
        found.differs(name, "", "a recording", f"the sample of seed {seed} does not have it")


def _traces_in(members: Members, tree: dict[str, Any], folder: Path) -> dict[str, Path]:
    """The bundle's traces, written into a folder under names that a bundle can have."""
    traces = {}
    for name, member in tree["traces"].items():
        if not isinstance(member, str) or member not in members:
            raise BundleError(f"{MANIFEST}: traces: {member!r} is not in the bundle")
        if not member.startswith(TRACES_FOLDER):
            raise BundleError(f"{MANIFEST}: traces: {member!r} is no trace")
        traces[name] = _written(members, member, folder)
    return traces


def _write_policies(members: Members, folder: Path) -> None:
    for member in members:
        if member.startswith(POLICIES_FOLDER):
            _written(members, member, folder)


def _written(members: Members, member: str, folder: Path) -> Path:
    path = folder / member
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(members[member])
    except OSError as error:
        # As of a file where another member has a folder.
        raise BundleError(
            f"{member} cannot be unpacked beside the rest: {error.strerror}"
        ) from None
    return path
