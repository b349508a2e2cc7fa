"""``encircle bundle``: a study's directory as one file that others can verify."""

import json
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
from pydantic import ValidationError

from encircle.bundles.bundle_file import (
    MANIFEST,
    PLAN,
    POLICIES_FOLDER,
    TABLE,
    BundleError,
    sha256,
    write_members,
)
from encircle.bundles.bundle_plan import plan_text, policy_member, trace_member, trace_names
from encircle.bundles.manifest import manifest, manifest_bytes
from encircle.bundles.recordings import recorded, recording_member
from encircle.bundles.report_members import report_members
from encircle.bundles.sampling import sampled
from encircle.bundles.table_text import ROWS_MAX, table_text
from encircle.protocol.plugin_files import is_in_file, path_of
from encircle.protocol.process.interrupts import check, signals_held
from encircle.studies.plan import Plan, StudyError
from encircle.studies.plan_files import load_plan
from encircle.studies.sources import plugin_files
from encircle.studies.study import Study
from encircle.studies.study_directory import OWNER_FILE, PARTS_DIRECTORY, TABLE_FILE
from encircle.studies.tasks import FAILED
from encircle.whole_files import made_whole

RECORDINGS = 2
ENDING = ".zip"
SOURCE = ".py"


class Packed(NamedTuple):
    """A bundle that was made. ``left_out``: what a policy imports and that is not packed.

    ``policies``: how many sources of policies it holds.
    ``sha256``: of its manifest, which has the hashes of all other members: who knows it knows them.
    """

    path: Path
    plan: Plan
    sha256: str
    recordings: int
    bytes: int
    policies: int
    left_out: tuple[str, ...]


@signals_held()
def pack(
    directory: Path,
    out: Path,
    recordings: int = RECORDINGS,
    seed: int = 0,
    tell: Callable[[int, int], None] = lambda _done, _of: None,
) -> Packed:
    """Pack the study in a directory into a new file.

    ``recordings``: how many runs are recorded, drawn by ``seed`` evenly over the cells. Raises
    ``StudyError`` if the directory is no study's, if runs are missing, or if the sources here are
    not those of the study; ``BundleError`` if a part cannot be packed; ``OutputError`` if ``out``
    cannot be made.
    """
    plan = plan_in(directory)
    with closing(Study(plan, directory).open()) as table:
        missing = int((~table.done & ~table.failed).sum())
        if missing:
            raise StudyError(
                f"{directory}: {missing} of {plan.runs} runs are missing: run encircle study first"
            )
        rows = table.read().to_pylist()
        members = {PLAN: plan_text(plan).encode(), TABLE: table_text(plan, rows).encode()}
        members |= report_members(plan, table)
        code = table.owner["code"]
    check()
    traces = {name: _trace(name) for name in sorted(trace_names(plan))}
    members |= dict(traces.values())
    policies, left_out = _policies(plan)
    members |= policies
    chosen = sampled(range(len(plan.cells)), plan.seed_list, recordings, seed)
    by_run = {(row["cell"], row["seed"]): row for row in rows}
    for done, (cell, own) in enumerate(chosen):
        check()
        tell(done, len(chosen))
        if not by_run[cell, own][FAILED]:
            members[recording_member(cell, own)] = _recording(plan, by_run[cell, own])
    tell(len(chosen), len(chosen))
    given = {
        "drawn_with": {"matplotlib": matplotlib.__version__, "numpy": np.__version__},
        "sample": {"seed": seed, "recordings": recordings},
        "policies": sorted(policies),
        "traces": {name: member for name, (member, _) in traces.items()},
    }
    head = manifest_bytes(manifest(plan, code, json.loads(rows[0]["versions"]), members, given))
    members[MANIFEST] = head
    with made_whole(out) as unfinished:
        write_members(unfinished, members)
    count = sum(name.endswith(".mcap") for name in members)
    return Packed(out, plan, sha256(head), count, out.stat().st_size, len(policies), left_out)


def directory_of(study: str) -> Path:
    """The directory of a study: the one named, or the one where a study of that name is by itself.

    ``study``: a directory, a shipped name or a TOML file.
    """
    if (Path(study) / OWNER_FILE).is_file() or Path(study).is_dir():
        return Path(study)
    return Study(load_plan(study)).directory


def plan_in(directory: Path) -> Plan:
    """The plan of the study in a directory, with the seeds that its table has."""
    try:
        tree = json.loads((directory / OWNER_FILE).read_text(encoding="utf-8"))
        plan = Plan.model_validate(tree["plan"])
    except FileNotFoundError:
        raise StudyError(
            f"{directory} has no {OWNER_FILE}: name the directory of a study that has been run"
        ) from None
    except OSError as error:
        raise StudyError(f"{directory} cannot be used: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, ValidationError):
        raise StudyError(f"{directory / OWNER_FILE} is damaged") from None
    seeds = _seeds(directory)
    if not seeds:
        raise StudyError(f"{directory}: no run is there yet: run encircle study first")
    first = seeds == list(range(1, len(seeds) + 1))
    plan = Plan.model_validate(
        {**tree["plan"], "seeds": len(seeds) if first else seeds, "axes": tree["plan"]["axes"]}
    )
    if plan.runs > ROWS_MAX:
        raise StudyError(f"{directory}: {plan.runs} runs, a bundle can have {ROWS_MAX}")
    return plan


def _seeds(directory: Path) -> list[int]:
    """All seeds in a table, which may have been given in several calls."""
    files = [directory / TABLE_FILE, *sorted((directory / PARTS_DIRECTORY).glob("*.parquet"))]
    seeds: set[int] = set()
    for path in files:
        if path.exists():
            seeds |= set(pc.unique(pq.read_table(path, columns=["seed"])["seed"]).to_pylist())
    return sorted(seeds)


def _trace(name: str) -> tuple[str, bytes]:
    try:
        content = Path(name).read_bytes()
    except OSError as error:
        raise BundleError(f"trace {name} cannot be read: {error.strerror}") from None
    return trace_member(name, content), content


def _policies(plan: Plan) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """The files of policies, behaviours and measures, with what lies beside them and is imported.

    Second: what they import from elsewhere, or that is no source, which cannot be packed.
    """
    named = [name for _, name in plan.plugins if is_in_file(name)]
    members, left_out = {}, []
    folders = {}
    for name in named:
        path = path_of(name)
        members[policy_member(name)] = path.read_bytes()
        folders[path.parent] = policy_member(name).rpartition("/")[0]
    packed = {path_of(name) for name in named}
    for source, path in sorted(plugin_files(plan.plugins).items()):
        resolved = path.resolve()
        if resolved in packed:
            continue
        folder = next((f for f in folders if resolved.is_relative_to(f)), None)
        if folder is None or resolved.suffix != SOURCE:
            left_out.append(source)
            continue
        within = resolved.relative_to(folder).as_posix()
        members[f"{folders[folder]}/{within}"] = resolved.read_bytes()
    assert all(member.startswith(POLICIES_FOLDER) for member in members)
    return members, tuple(left_out)


def _recording(plan: Plan, row: dict[str, Any]) -> bytes:
    run = recorded(plan.scenario_of(row["cell"]), row["seed"])
    if run.digest != row["digest"]:
        raise BundleError(
            f"cell {row['cell']}, seed {row['seed']}: run again it came to digest {run.digest}, its"
            f" row has {row['digest']}; nothing was written"
        )
    return run.content


def shown_problems(lines: Sequence[str]) -> str:
    """Lines of a text, as one."""
    return "; ".join(lines)
