"""The directory of a run: its recording and its summary. Nothing that exists is overwritten."""

import contextlib
import errno
import fcntl
import json
import os
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from encircle.protocol import VERSION
from encircle.protocol.process.directories import unusable
from encircle.world.coordinator.result import Result
from encircle.world.recording.recorder import Recorder, RecordingStopped
from encircle.world.scenario.model import Scenario, digest_header

RECORDING = "recording.mcap"
SUMMARY = "summary.json"
RUNS_MAX = 100_000
ATTEMPTS_MAX = 1000
PACKAGES = ("encircle", "eclipse-zenoh", "msgpack", "numpy", "scipy", "filterpy", "mcap")


class RunDirectoryError(Exception):
    """The directory cannot be used; the message says which and why."""


def versions() -> dict[str, str]:
    """Versions of everything that has a part in a run's numbers."""
    return {
        "python": platform.python_version(),
        "protocol": str(VERSION),
        **{name: _version(name) for name in PACKAGES},
    }


@cache
def _version(package: str) -> str:
    # What this process has imported stays as it is, whatever is installed meanwhile.
    return version(package)


def new_directory(under: Path, scenario_name: str, seed: int) -> Path:
    """A path in ``under`` for the run of a scenario at which there is nothing yet."""
    stem = f"{Path(scenario_name).stem}-seed{seed}"
    for number in range(1, RUNS_MAX):
        path = under / f"{stem}-{number}"
        if not path.exists():
            return path
    raise RunDirectoryError(f"{under / stem}-*: too many runs, name one with --out")


def create(path: Path) -> Path:
    """Make the directory of a run; ``RunDirectoryError`` if it cannot be made or is not empty."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        if any(path.iterdir()):
            raise RunDirectoryError(
                f"{path} is not empty: choose another --out, nothing was changed"
            )
        if not os.access(path, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise RunDirectoryError(unusable(path, error)) from None
    return path


def set_aside(path: Path) -> None:
    """Keep what an attempt has left under other names, so that there is room for the next one."""
    for number in range(1, ATTEMPTS_MAX):
        kept = {path / name: path / _broken(name, number) for name in (RECORDING, SUMMARY)}
        if any(backup.exists() for backup in kept.values()):
            continue
        try:
            for name, backup in kept.items():
                if name.exists():
                    name.rename(backup)
        except OSError as error:
            raise RunDirectoryError(unusable(path, error)) from None
        return
    raise RunDirectoryError(f"{path}: {ATTEMPTS_MAX - 1} attempts are kept there already")


def attempts(path: Path) -> list[Path]:
    """The recordings of a run's directory: the last one, then those set aside."""
    kept = [path / RECORDING, *(path / _broken(RECORDING, k) for k in range(1, ATTEMPTS_MAX))]
    return [backup for backup in kept if backup.exists()]


def _broken(name: str, number: int) -> str:
    stem, _, ending = name.rpartition(".")
    return f"{stem}-broken-{number}.{ending}"


def start_recording(
    path: Path,
    scenario: Scenario,
    run: str,
    so_far: Iterable[tuple[int, str, bytes]] | None = None,
) -> Recorder:
    """Open the recording of a run in its directory; ``RunDirectoryError`` if it cannot be.

    ``so_far``: of a run that is gone on with, what is recorded again, (tick, key, payload); what
    there was is set aside. The directory is the recorder's alone until it is closed.
    """
    metadata = {
        "run": run,
        "seed": str(scenario.seed),
        "scenario": scenario.model_dump_json(),
        "digest_header": digest_header(scenario, scenario.seed),
        "versions": json.dumps(versions()),
    }
    with contextlib.ExitStack() as claim:
        claim.callback(os.close, _claimed(path))
        if so_far is not None:
            set_aside(path)
        try:
            recorder = Recorder(path / RECORDING, scenario.tick_s, metadata)
            for message in so_far or ():
                recorder.record(*message)
        except OSError as error:
            raise RunDirectoryError(f"{path / RECORDING}: {error.strerror}") from None
        except RecordingStopped as error:
            raise RunDirectoryError(str(error)) from None
        recorder.held = claim.pop_all()
    return recorder


def discard(recorder: Recorder, path: Path) -> None:
    """Leave the directory as if nothing had been recorded, of a run that has not begun."""
    with contextlib.suppress(OSError):
        (path / RECORDING).unlink()
    with contextlib.suppress(RecordingStopped):
        recorder.close()


def _claimed(path: Path) -> int:
    """The directory, opened and locked; the lock goes when it is closed or the process ends."""
    try:
        claim = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise RunDirectoryError(unusable(path, error)) from None
    try:
        fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(claim)
        raise RunDirectoryError(
            f"{path}: a run is being recorded there now; nothing was changed"
        ) from None
    except OSError:
        # A file system without locks: then it is left to the user.
        pass
    return claim


def write_summary(
    path: Path, scenario: Scenario, result: Result, run: str, extra: Mapping[str, Any]
) -> None:
    """Write what came of a run beside its recording; ``RecordingStopped`` if that fails."""
    summary = {
        "run": run,
        "seed": scenario.seed,
        **asdict(result),
        **extra,
        "versions": versions(),
        "scenario": scenario.model_dump(mode="json"),
    }
    part = path / f"{SUMMARY}.part"
    try:
        part.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
        # Whole or not at all.
        part.replace(path / SUMMARY)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise RecordingStopped(f"cannot write {path / SUMMARY}: {error.strerror}") from None
