"""Bundles of a small study, and alterations of them: bare ones, and those that are covered up.

Whoever alters a bundle can make hashes, manifest and report fit again. ``covered_up`` does, with
what made them; only a run made again can then tell.
"""

import csv
import hashlib
import io
import json
from contextlib import closing
from pathlib import Path

import encircle
from encircle.bundles import bundle_file, packing, report_checks, reruns
from encircle.bundles.bundle_file import MANIFEST, PLAN, REPORT_FOLDER, TABLE
from encircle.bundles.bundle_plan import read_plan
from encircle.bundles.manifest import GIVEN, manifest, manifest_bytes
from encircle.bundles.table_text import read_table, table_text
from encircle.bundles.verifying import verify
from encircle.studies.study_table import StudyTable

TREE = {
    "name": "small",
    "title": "A <small> study",
    "scenario": "sim1",
    "seeds": 4,
    "set": {"channel.loss.model": "bernoulli", "team.jitter_m": 0.5, "ticks_max": 50},
    "axes": [
        {
            "name": "loss",
            "key": "channel.loss.rate",
            "unit": "%",
            "scale": 100,
            "values": [0.0, 0.9],
        }
    ],
    "compare": "loss",
    "measures": ["captured", "age_ticks_mean", "path_m_mean"],
}


def run_here(work, tasks, _workers):
    """In place of ``process_pool.in_processes``: work done in this process."""
    for task in tasks:
        yield work(task)


def study_of(folder, tree=TREE):
    """A study that has been run, in a directory below a folder."""
    study = encircle.study(tree, folder / "study")
    study.run(workers=1)
    return study


def packed(study, out, recordings=0):
    """The bundle of a study."""
    packing.pack(study.directory, out, recordings)
    return out


def members_of(path):
    """A bundle's members, to be altered."""
    return bundle_file.read_members(path)


def written(members, path):
    """A bundle of members."""
    path.unlink(missing_ok=True)
    bundle_file.write_members(path, members)
    return path


def with_hashes(members):
    """The members with a manifest that has their hashes, and is as it was otherwise."""
    tree = json.loads(members[MANIFEST])
    hashes = {
        name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for name, content in members.items()
        if name != MANIFEST
    }
    members[MANIFEST] = manifest_bytes({**tree, "members": hashes})
    return members


def covered_up(members, folder):
    """The members with report, hashes and manifest made anew from plan and table."""
    plan = read_any(members)
    rows = read_table(plan, members[TABLE])
    for name in [name for name in members if name.startswith(REPORT_FOLDER)]:
        del members[name]
    with closing(StudyTable(folder, plan, {"code": rows[0]["code"]})) as table:
        table.append(rows)
        members |= report_checks.report_members(plan, table)
    given = {key: json.loads(members[MANIFEST])[key] for key in GIVEN}
    versions = json.loads(rows[0]["versions"])
    members[MANIFEST] = manifest_bytes(manifest(plan, rows[0]["code"], versions, members, given))
    return members


def read_any(members):
    """The plan of members."""
    return read_plan(members[PLAN], {})


def with_rows(members, change):
    """The members after ``change`` of the list of rows, or of a row if it returns nothing."""
    plan = read_any(members)
    rows = read_table(plan, members[TABLE])
    change(rows)
    members[TABLE] = table_text(plan, rows).encode()
    return members


def csv_rows(content):
    """A CSV file as lists."""
    return list(csv.reader(io.StringIO(content.decode(), newline="")))


def verified(path, monkeypatch, rows=0, **options):
    """What a verification in this process finds; runs nothing again by itself."""
    monkeypatch.setattr(reruns.pool, "in_processes", run_here)
    return verify(Path(path), rows, 1, **options)
