"""Plug-ins that are named by their file, ``my_robots.py:auction``, without being installed.

The file is looked for in the folders of ``ENCIRCLE_POLICIES`` and then in the working directory, in
each process for itself. A name comes with setups, scenarios and recordings, from strangers too: it
reaches no file elsewhere. The file may import modules that lie beside it, after all that are
installed.
"""

import hashlib
import importlib.util
import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

FOLDERS = "ENCIRCLE_POLICIES"
SHOWN_DIGITS = 12
_folders: set[str] = set()
_modules: dict[tuple[Path, str], ModuleType] = {}


class FileProblem(Exception):
    """A function that cannot be had from its file; the message says why."""


def is_in_file(name: str) -> bool:
    """Whether a plug-in's name says its file: ``path/file.py:function``."""
    file, colon, function = name.rpartition(":")
    return bool(colon) and file.endswith(".py") and bool(function)


def function_in_file(name: str, digest: str = "") -> Any:
    """What ``path/file.py:function`` names; ``FileProblem`` if there is no such file or name.

    ``digest``: the SHA-256 that the file must have, any if empty; another one is not imported.
    Whatever the file itself raises when it is imported is raised. A file that has changed since is
    imported anew.
    """
    function = name.rpartition(":")[2]
    path = path_of(name)
    source = _bytes_of(path)
    check_digest(_digest(source), digest)
    module = _modules.get(key := (path, _digest(source)))
    if module is None:
        module = _modules[key] = _imported(path, source)
    try:
        return getattr(module, function)
    except AttributeError:
        public = [n for n, v in vars(module).items() if callable(v) and not n.startswith("_")]
        own = [n for n in public if getattr(vars(module)[n], "__module__", "") == module.__name__]
        raise FileProblem(
            f"{path} has no {function!r}; it has {', '.join(own) or 'no function'}"
        ) from None


def source_digest(function: Callable[..., Any]) -> str:
    """SHA-256, in hex, of the file that a function is in; empty if it is in none."""
    while hasattr(function, "func"):
        function = function.func
    function = inspect.unwrap(function)
    try:
        file = inspect.getsourcefile(function if inspect.isroutine(function) else type(function))
    except TypeError:
        file = None
    return "" if file is None or not Path(file).is_file() else _digest(Path(file).read_bytes())


def file_digest(name: str) -> str:
    """SHA-256, in hex, of the file of ``path/file.py:function``; ``FileProblem`` if there is none.

    It is that of the file that is named, wherever this has the function from.
    """
    return _digest(_bytes_of(path_of(name)))


def path_of(name: str) -> Path:
    """The file of ``path/file.py:function``; ``FileProblem`` if there is none."""
    file = name.rpartition(":")[0]
    if Path(file).is_absolute() or ".." in Path(file).parts:
        raise FileProblem(
            f"{file}: must lie below the working directory or a folder of {FOLDERS}, and be named"
            " from there"
        )
    folders = [*filter(None, os.environ.get(FOLDERS, "").split(os.pathsep)), str(Path.cwd())]
    for folder in folders:
        path = Path(folder) / file
        if path.is_file():
            return path.resolve()
    raise FileProblem(f"there is no file {file} in {' or '.join(folders)} ({FOLDERS} adds folders)")


def check_digest(here: str, wanted: str) -> None:
    """``FileProblem`` if a source has another SHA-256 than is wanted; all may have it if empty."""
    if wanted and here != wanted:
        raise FileProblem(
            f"its source here has SHA-256 {here[:SHOWN_DIGITS] or 'none'}, the world's"
            f" {wanted[:SHOWN_DIGITS]}: put the world's file on this host and restart this process"
        )


def let_import_beside(path: Path) -> None:
    """Let modules that lie beside a file be imported, after all others of their names.

    ``FileProblem`` if a module of such a name was imported from beside another policy's file: it
    would stand for this one's.
    """
    for beside in path.parent.glob("*.py"):
        loaded = Path(getattr(sys.modules.get(beside.stem), "__file__", None) or beside)
        if loaded.parent != path.parent and str(loaded.parent) in _folders:
            raise FileProblem(
                f"{beside} cannot be imported: this process has imported {loaded}; name one of"
                " them otherwise"
            )
    own = str(path.parent)
    if own not in sys.path or own in _folders:
        # Before those of other policies, and after all else.
        _folders.add(own)
        sys.path[:] = [folder for folder in sys.path if folder != own]
        first = next((k for k, folder in enumerate(sys.path) if folder in _folders), len(sys.path))
        sys.path.insert(first, own)


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileProblem(f"{path} cannot be read: {error.strerror}") from None


def _imported(path: Path, source: bytes) -> ModuleType:
    # Under a name of its own: a person's types.py must not stand for Python's.
    name = f"encircle_file_{path.stem}_{_digest(source)[:SHOWN_DIGITS]}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None, "its name ends in .py"
    module = importlib.util.module_from_spec(spec)
    let_import_beside(path)
    sys.modules[name] = module
    try:
        # Not by the loader, which would take what was compiled from an earlier text.
        exec(compile(source, str(path), "exec"), module.__dict__)  # noqa: S102  # it was asked for
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _digest(source: bytes) -> str:
    return hashlib.sha256(source).hexdigest()
