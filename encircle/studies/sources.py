"""Which code has a part in a study's numbers: its sources, digested wherever they lie.

This program's own packages, and the plug-ins that the study uses: not all that are installed, for
one that is not named in a study is not even loaded, and work on it is no reason to refuse the
study. A version says nothing of a source that is edited in place, so sources are read: the module
of the plug-in, all of its package, and, by the import statements in them, the modules beside them.
What comes from other installed packages goes by their versions. What a plug-in finds at run time by
other means than an import statement (a file beside a module, a computed name) is not seen, unless
it lies in the plug-in's own package.

Paths count only from the folder on, in which the import finds the module: the same sources give the
same digest on every machine.
"""

import ast
import hashlib
import json
import os
import platform
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import packages_distributions, version
from importlib.util import find_spec
from pathlib import Path

from encircle.protocol.plugin_files import FileProblem, is_in_file, let_import_beside, path_of
from encircle.protocol.plugins import OWN, installed

OURS: Mapping[str, tuple[str, ...]] = {
    "encircle.agents": ("",),
    "encircle.measures": ("",),
    "encircle.protocol": ("",),
    "encircle.runlog": ("",),
    "encircle.runner": ("__init__", "memory"),
    "encircle.studies": ("running", "tasks"),
    "encircle.world": ("",),
}
"""Packages, and the beginnings of their files' names, on which numbers depend."""
PACKAGES = (OWN, "numpy", "scipy", "filterpy", "msgpack")
IGNORED_DIRECTORIES = ("__pycache__",)
COMPILED = (".pyc", ".pyo")

Names = Sequence[tuple[str, str]]
"""Plug-ins by entry-point group and name."""
Files = dict[str, Path]


@dataclass
class _PluginSources:
    """What plug-ins are made of: files by name, and distributions of which the version counts."""

    files: Files = field(default_factory=dict)
    distributions: set[str] = field(default_factory=set)
    absent: set[str] = field(default_factory=set)


def code(plugins: Names = ()) -> str:
    """Digest of everything that has a part in a run's numbers: sources and versions."""
    sources = _plugin_sources(plugins)
    digest = hashlib.blake2b(digest_size=8)
    _add(digest, "versions", json.dumps(_versions(sources.distributions)).encode())
    _add(digest, "absent", json.dumps(sorted(sources.absent)).encode())
    for files in (_own_files(), sources.files):
        for name in sorted(files):
            _add(digest, name, files[name].read_bytes())
    return digest.hexdigest()


def program_digest() -> str:
    """Digest of this program's files, those that only draw included.

    In a working copy it is without the folders that are links: they are in ``code``.
    """
    digest = hashlib.blake2b(digest_size=16)
    for name, path in sorted((_files_of(OWN) or {}).items()):
        _add(digest, name, path.read_bytes())
    return digest.hexdigest()


def versions(plugins: Names = ()) -> dict[str, str]:
    """Versions of what computes a run's numbers, plug-ins included."""
    return _versions(_plugin_sources(plugins).distributions)


def plugin_files(plugins: Names) -> Files:
    """The source files of plug-ins, and of what they import, by the names under which they count.

    What comes from other installed packages is left out: it goes by its version.
    """
    return dict(_plugin_sources(plugins).files)


def _versions(distributions: Iterable[str]) -> dict[str, str]:
    others = sorted(set(distributions) - set(PACKAGES))
    packages = {name: version(name) for name in (*PACKAGES, *others)}
    return {"python": platform.python_version(), **packages}


def _add(digest: hashlib.blake2b, name: str, content: bytes) -> None:
    """Add a named content, so that nothing can move from one to the next unnoticed."""
    for part in (name.encode(), content):
        digest.update(len(part).to_bytes(8, "big"))
        digest.update(part)


def _own_files() -> Files:
    return {
        name: path
        for package, beginnings in OURS.items()
        for name, path in (_files_of(package) or {}).items()
        if name.endswith(".py") and name.partition("/")[2].startswith(beginnings)
    }


def _plugin_sources(plugins: Names) -> _PluginSources:
    """The sources of plug-ins, and of what they import, as far as it is no other distribution's."""
    sources = _PluginSources()
    owners = packages_distributions() if plugins else {}
    for group, name in plugins:
        try:
            waiting, own = _beginning(group, name, sources)
        except FileProblem:
            sources.absent.add(name)
            continue
        seen = {OWN} | sys.stdlib_module_names
        while waiting:  # ends: every module is looked at once
            module = waiting.pop()
            if module in seen:
                continue
            seen.add(module)
            files, theirs = _files_of(module), set(owners.get(module, ()))
            if files is None:
                sources.absent.add(module)
            elif theirs and not theirs & own and _is_installed(files):
                sources.distributions |= theirs
            else:
                sources.files |= files
                waiting += [name for path in files.values() for name in _imports(path)]
    return sources


def _beginning(group: str, name: str, sources: _PluginSources) -> tuple[list[str], set[str]]:
    """The modules that a plug-in's sources begin with, and the distributions that are its own.

    Adds its file or distribution to ``sources``. ``FileProblem`` if there is no such plug-in.
    """
    if is_in_file(name):
        path = path_of(name)
        let_import_beside(path)
        sources.files[path.name] = path
        return sorted(_imports(path)), set()
    plugin = installed(group).get(name)
    if plugin is None:
        raise FileProblem(name)
    own = {plugin.entry.dist.name} if plugin.entry.dist is not None else set()
    sources.distributions |= own
    return [plugin.entry.module.partition(".")[0]], own


def _files_of(module: str) -> Files | None:
    """The files of a module or package; None if there is no such module."""
    try:
        spec = find_spec(module)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    if spec.submodule_search_locations is not None:
        folders = map(Path, spec.submodule_search_locations)
        below = (file for folder in folders for file in _files_below(folder))
        return {f"{module}/{name}": path for name, path in below}
    path = Path(spec.origin or "")
    return {path.name: path} if path.is_file() else {}


def _files_below(folder: Path) -> Iterator[tuple[str, Path]]:
    """All files below a folder, by their path relative to it, without caches and hidden files."""
    for directory, folders, names in os.walk(folder):
        folders[:] = [f for f in folders if f not in IGNORED_DIRECTORIES and not f.startswith(".")]
        for name in names:
            path = Path(directory) / name
            if path.suffix not in COMPILED and not name.startswith(".") and path.is_file():
                yield path.relative_to(folder).as_posix(), path


def _is_installed(files: Files) -> bool:
    """Whether files lie where an installer puts them, and not in somebody's working folder."""
    site_packages = [Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib")]
    return any(site in path.resolve().parents for path in files.values() for site in site_packages)


def _imports(path: Path) -> set[str]:
    """The top-level names that a module imports, wherever in it."""
    if path.suffix != ".py":
        return set()
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):
        return set()
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.partition(".")[0])
    return names
