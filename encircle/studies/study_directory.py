"""Whose a study's directory is, its lock, and files in it that are there whole or not at all.

All that can be told without reading the table.
"""

import fcntl
import json
import os
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from encircle.protocol.process.directories import unusable
from encircle.studies.plan import StudyError

TABLE_FILE, PARTS_DIRECTORY, OWNER_FILE, LOCK_FILE = "table.parquet", "parts", "study.json", "lock"
REPORT_FILE = "report.html"


def directory_of(name: str, out: str | Path | None) -> Path:
    """The directory of a study: the one that is asked for, or ``runs/study-NAME``."""
    return Path(out or Path("runs") / f"study-{name}")


def owner_of(directory: Path) -> dict[str, Any] | None:
    """The study, configuration and code that a directory belongs to; None if it is new or empty."""
    try:
        if not directory.exists() or not any(directory.iterdir()):
            return None
        tree = json.loads((directory / OWNER_FILE).read_text(encoding="utf-8"))
        return {key: value for key, value in tree.items() if key != "plan"}
    except FileNotFoundError:
        raise StudyError(
            f"{directory} is not empty and not a study's: choose another --out; nothing was changed"
        ) from None
    except (ValueError, AttributeError):
        raise StudyError(f"{directory / OWNER_FILE} is damaged; nothing was changed") from None
    except OSError as error:
        raise StudyError(unusable(directory, error)) from None


def lock_file(path: Path) -> TextIO:
    """The lock file, locked until it is closed or the process ends."""
    file = open(path, "a", encoding="utf-8")  # noqa: SIM115  # held, not used
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise StudyError(f"{path.parent} is in use by another process") from None
    return file


def write_file(path: Path, content: bytes) -> None:
    """Write a file that gets its name only when it is complete and on disk."""
    aside = path.with_suffix(".tmp")
    with open(aside, "wb") as file:
        file.write(content)
        flush(file)
    aside.replace(path)


def flush(file: BinaryIO) -> None:
    """Have what was written to a file on disk."""
    file.flush()
    os.fsync(file.fileno())
