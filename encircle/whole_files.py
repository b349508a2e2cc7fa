"""A file or a directory that is there whole or not at all, in place of nothing that was there."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from encircle.world.recording.run_directory import RunDirectoryError


class OutputError(RunDirectoryError):
    """What is to be made cannot be made; the message says what, and why."""


def check_new(path: Path) -> None:
    """``OutputError`` if there is something at a path, or no directory to put it in."""
    try:
        is_there, has_place = path.exists() or path.is_symlink(), path.parent.is_dir()
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}") from None
    if is_there:
        raise OutputError(f"{path} is there already: choose another --out, nothing was changed")
    if not has_place:
        raise OutputError(f"{path} cannot be written: {path.parent} is no directory")


@contextmanager
def made_whole(path: Path) -> Iterator[Path]:
    """A path beside this one to make a file or directory at, which gets its name in the end.

    The ending of its name is the same. If the context is left by an exception, what was made is
    removed. ``OutputError`` if it cannot be written, or there is something at ``path``.
    """
    check_new(path)
    unfinished = path.with_name(f".unfinished-{os.getpid()}-{path.name}")
    try:
        yield unfinished
        check_new(path)
        unfinished.rename(path)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):
            # Such as for a name that is too long: then nothing was made either.
            _remove(unfinished)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
