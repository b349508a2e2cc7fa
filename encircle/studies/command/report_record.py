"""What a study's report was made of, so that it is made again only if that has changed.

A report is made of the plan, the table, the command that it shows, and the code that draws. The
record holds a digest of all of these, and the digest of every file that was made: if one of them is
altered or missing, all are made again. Of a study in which runs failed there is no record, since
the same command tries these runs again.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from encircle.studies.plan import Plan
from encircle.studies.sources import code, program_digest
from encircle.studies.study_directory import (
    LOCK_FILE,
    PARTS_DIRECTORY,
    TABLE_FILE,
    lock_file,
    owner_of,
    write_file,
)

RECORD_FILE = "report.json"
DRAWING_PACKAGES = ("matplotlib", "pyarrow", "pandas", "bokeh")
TOLD = ("findings", "pages", "notes")
"""What the record has of an outcome; the rest goes without saying."""


class Outcome(NamedTuple):
    """What came of a study.

    ``findings``: sentences; ``pages``: of its replays, relative to its directory; ``notes``: lines
    on what is not shown; ``ran``: how many runs were missing; ``failed``: how many of all failed,
    and ``failure``: the first of them.
    """

    findings: tuple[str, ...]
    pages: tuple[str, ...]
    notes: tuple[str, ...]
    ran: int = 0
    failed: int = 0
    failure: str = ""


class ReportRequest(NamedTuple):
    """A report of a plan's table: the command that it shows, and which replays it links."""

    plan: Plan
    directory: Path
    command: str
    replays: str


def unchanged(request: ReportRequest) -> Outcome | None:
    """What was found, if all that was made stands as it was, of what it would be made of now.

    ``StudyError`` if another process is at work in the directory.
    """
    directory = request.directory
    record = _read(directory)
    if record is None or owner_of(directory) != _owner(request.plan):
        return None
    try:
        lock = lock_file(directory / LOCK_FILE)
    except OSError:  # whoever works in the directory says so
        return None
    with lock:
        is_whole = not any((directory / PARTS_DIRECTORY).glob("*")) and all(
            _digest_of(directory / name) == had for name, had in record["files"].items()
        )
        if not is_whole or record["of"] != made_of(request):
            return None
    findings, pages, notes = (tuple(record[name]) for name in TOLD)
    return Outcome(findings, pages, notes)


def write_record(directory: Path, of: str, outcome: Outcome, names: Iterable[str]) -> None:
    """Record of what the report in a directory was made (``made_of``), and its files' names."""
    files = {name: _digest_of(directory / name) for name in names}
    tree = {"of": of, "files": files, **{name: getattr(outcome, name) for name in TOLD}}
    text = json.dumps({"digest": _digest_of_tree(tree), **tree}, indent=2, ensure_ascii=False)
    write_file(directory / RECORD_FILE, text.encode() + b"\n")


def remove_altered_pages(directory: Path) -> None:
    """Remove pages of replays that are not what was written, so that they are written again."""
    record = _read(directory)
    if record is None:
        return
    for page in record["pages"]:
        if _digest_of(directory / page) != record["files"][page]:
            (directory / page).unlink(missing_ok=True)


def remove_record(directory: Path) -> None:
    """Remove the record, before anything is made that it would not be of."""
    (directory / RECORD_FILE).unlink(missing_ok=True)


def made_of(request: ReportRequest) -> str:
    """A digest of all that a report is made of: plan, table, command, and the code that draws.

    The code is that of this process's first call: what it has imported stays as it was.
    """
    plan = request.plan
    return _digest_of_tree(
        {
            "plan": plan.model_dump(mode="json"),
            "owner": _owner(plan),
            "command": request.command,
            "replays": request.replays,
            "table": _digest_of(request.directory / TABLE_FILE),
            "program": program(),
            "packages": {name: _version(name) for name in DRAWING_PACKAGES},
        }
    )


@cache
def program() -> str:
    """A digest of all of this program's files, at the first call."""
    return program_digest()


def _owner(plan: Plan) -> dict[str, str]:
    return {"study": plan.name, "fingerprint": plan.fingerprint, "code": code(plan.plugins)}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _read(directory: Path) -> Mapping[str, Any] | None:
    """The record; None if there is none, or if it is not as it was written."""
    try:
        tree = json.loads((directory / RECORD_FILE).read_bytes())
        digest = tree.pop("digest")
        return tree if digest == _digest_of_tree(tree) else None
    except (OSError, ValueError, AttributeError, KeyError):
        return None


def _digest_of_tree(tree: Mapping[str, Any]) -> str:
    text = json.dumps(tree, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def _digest_of(path: Path) -> str:
    """The digest of a file; empty if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
    except OSError:
        return ""
