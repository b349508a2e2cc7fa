"""Checks of this machine: versions, memory, open files, disk, processor, clock synchronisation.

Each check looks once, changes nothing that it does not undo, and returns results: what it saw,
whether that is well, and advice if it is not. A container's limits are read from the kernel's files
(cgroups, resource limits), because a process cannot learn them in another way.
"""

import ctypes
import errno
import os
import re
import resource
import shutil
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from pathlib import Path

from encircle import laboratory
from encircle.check_results import CheckResult, Level
from encircle.protocol import VERSION

MIB = 1024 * 1024
NODE_BYTES = 128 * MIB
"""A robot needs about 100 MiB, a world 85 MiB; more in a big team."""
DISK_BYTES_MIN = 64 * MIB
FILES_MIN = 256
CORES_MIN = 0.5
NO_LIMIT_BYTES = 2**60
UNSYNCHRONISED_STATUS, UNSYNCHRONISED_STATE = 0x40, 5
_STATUS_OFFSET, _TIMEX_BYTES = 40, 512
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*\(?([^;)]*)\)?\s*(;.*)?")
_BOUND = re.compile(r"(>=|<=|==|<|>)\s*([0-9][0-9.]*)")


def check_machine(runs: Path, runs_named: bool) -> list[CheckResult]:
    """All checks of this machine; ``runs_named``: whether the user gave the directory of runs."""
    return [
        *check_packages(),
        check_memory(),
        *check_cores_and_files(),
        check_temporary_directory(),
        check_runs_directory(runs, runs_named),
        *check_clock_service(),
    ]


LABORATORY = "laboratory"


def _use(name: str) -> str:
    """What a package of no extra is for, empty if for everything."""
    return LABORATORY if name in laboratory.PACKAGES else ""


def _missing(package: str, use: str, names: Sequence[str]) -> CheckResult:
    """The result for packages that are not there; ``use``: an extra, the laboratory or empty."""
    message, advice = f"not installed: {', '.join(names)}", f"pip install {' '.join(names)}"
    if not use:
        return CheckResult("versions", "wrong", message, advice)
    if use == LABORATORY:
        return CheckResult("versions", "note", f"{message}; no node needs it", advice)
    needs = f"only {use} need it" if use == "studies" else f"only for {use}"
    return CheckResult("versions", "note", f"{message}; {needs}", f"pip install '{package}[{use}]'")


def check_packages(package: str = "encircle") -> list[CheckResult]:
    """Whether Python and the installed packages have the versions that the program requires."""
    try:
        requirements, package_metadata = requires(package) or [], metadata(package)
    except PackageNotFoundError:
        advice = "install it into this environment: make setup, or pip install ."
        return [
            CheckResult("versions", "wrong", f"{package} is not installed as a package", advice)
        ]
    results: list[CheckResult] = []
    python = ".".join(map(str, sys.version_info[:3]))
    if not within_bounds(python, package_metadata["Requires-Python"] or ""):
        message = f"Python is {python}, needed is {package_metadata['Requires-Python']}"
        results.append(
            CheckResult("versions", "wrong", message, "make an environment with a newer Python")
        )
    present_versions = [
        f"Python {python}",
        f"{package} {version(package)}",
        f"wire version {VERSION}",
    ]
    missing: dict[str, list[str]] = {}
    for name, bounds, extra in map(_requirement, requirements):
        try:
            present = version(name)
        except PackageNotFoundError:
            missing.setdefault(extra or _use(name), []).append(name)
            continue
        if not within_bounds(present, bounds):
            message = f"{name} is {present}, needed is {bounds}"
            advice = f"pip install '{name}{bounds}'"
            results.append(
                CheckResult("versions", "wrong" if not extra else "note", message, advice)
            )
        elif not extra:
            present_versions.append(f"{name} {present}")
    results += [_missing(package, use, names) for use, names in missing.items()]
    return [CheckResult("versions", "ok", ", ".join(present_versions)), *results]


def within_bounds(present: str, bounds: str) -> bool:
    """Whether a version is within bounds such as ``>=1.10,<2``; only leading numbers count."""
    return all(_fulfils(_numbers(present), sign, _numbers(v)) for sign, v in _BOUND.findall(bounds))


def _fulfils(present: list[int], sign: str, bound: list[int]) -> bool:
    size = max(len(present), len(bound))
    a, b = (numbers + [0] * (size - len(numbers)) for numbers in (present, bound))
    return {">=": a >= b, "<=": a <= b, "==": a == b, "<": a < b, ">": a > b}[sign]


def _numbers(text: str) -> list[int]:
    leading = re.match(r"\d+(\.\d+)*", text)
    return [int(part) for part in leading[0].split(".")] if leading else []


def _requirement(line: str) -> tuple[str, str, str]:
    """Name, bounds and extra of a requirement; the extra is empty for the program itself."""
    match = _REQUIREMENT.match(line)
    assert match is not None, line
    extra = re.search(r"extra\s*==\s*['\"]([^'\"]+)", match[3] or "")
    return match[1], match[2].strip(), extra[1] if extra else ""


def check_memory(
    groups: Path = Path("/sys/fs/cgroup"), meminfo: Path = Path("/proc/meminfo")
) -> CheckResult:
    """Whether memory is left for one more node, by the machine's or the container's limit."""
    free_bytes, owner = _available_bytes(meminfo), "of this machine"
    for limit_file, usage_file in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        limit_bytes, used_bytes = _number_in(groups / limit_file), _number_in(groups / usage_file)
        if limit_bytes is not None and used_bytes is not None and limit_bytes < NO_LIMIT_BYTES:
            left_bytes = max(0, limit_bytes - used_bytes)
            if free_bytes is None or left_bytes < free_bytes:
                free_bytes, owner = (
                    left_bytes,
                    f"of the {limit_bytes // MIB} MiB that this container may use",
                )
    if free_bytes is None:
        return CheckResult("memory", "note", "nothing says how much there is")
    message = f"{free_bytes // MIB} MiB {owner} are free"
    if free_bytes < NODE_BYTES:
        advice = "raise the limit (mem_limit, docker run --memory) or end what else runs here"
        return CheckResult(
            "memory", "wrong", f"{message}, a robot needs {NODE_BYTES // MIB}", advice
        )
    return CheckResult("memory", "ok", message)


def _available_bytes(meminfo: Path) -> int | None:
    try:
        line = re.search(r"^MemAvailable:\s+(\d+) kB", meminfo.read_text(), re.MULTILINE)
    except OSError:
        return None
    return int(line[1]) * 1024 if line else None


def _number_in(path: Path) -> int | None:
    try:
        text = path.read_text().strip()
    except OSError:
        return None
    return int(text) if text.isdigit() else None


def check_cores_and_files(groups: Path = Path("/sys/fs/cgroup")) -> list[CheckResult]:
    """How many processors this process may use, and how many files it may open."""
    cores = float(len(os.sched_getaffinity(0)))
    try:
        quota, period = (groups / "cpu.max").read_text().split()
        cores = min(cores, int(quota) / int(period))
    except (OSError, ValueError):
        pass  # no limit, or none that is shown here
    results = [CheckResult("cores", "ok", f"{cores:g}")]
    if cores < CORES_MIN:
        advice = "allow it more (cpus, docker run --cpus), or allow the run more time to answer"
        results = [CheckResult("cores", "note", f"only {cores:g}: rounds will take long", advice)]
    files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if 0 <= files < FILES_MIN:
        message = f"only {files} files may be open, {FILES_MIN} are needed"
        advice = "raise the limit: ulimit -n, or ulimits in the compose file"
        results.append(CheckResult("files", "wrong", message, advice))
    return results


def check_temporary_directory() -> CheckResult:
    """Whether temporary files can be written; ``encircle run`` stores the scenario in one."""
    try:
        # The file has no name, so nothing is left behind even if the process is killed.
        with tempfile.TemporaryFile() as file:
            file.write(bytes(4096))
            file.flush()
            where = tempfile.gettempdir()
    except OSError as error:
        advice = "mount one that is writable (tmpfs: /tmp in a compose file), or set TMPDIR"
        return CheckResult(
            "temporary files", "wrong", f"cannot be written: {error.strerror}", advice
        )
    return CheckResult("temporary files", "ok", f"{where} can be written")


def check_runs_directory(path: Path, named: bool) -> CheckResult:
    """Whether runs can be recorded in a directory: permission and free space. It is not created.

    ``named``: whether the user gave the directory. If not, a directory that cannot be used is
    only a note, because a robot records nothing.
    """
    existing = path.absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    level: Level = "wrong" if named else "note"
    try:
        if not existing.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        with tempfile.TemporaryFile(dir=existing):
            free = shutil.disk_usage(existing).free
    except OSError as error:
        advice = (
            "matters to a world alone: give its user the directory (ENCIRCLE_UID, ENCIRCLE_GID in"
            " containers), or another one by --runs"
        )
        return CheckResult("recordings", level, f"{path} cannot be used: {error.strerror}", advice)
    if free < DISK_BYTES_MIN:
        message = f"{path}: only {free // MIB} MiB are free"
        return CheckResult("recordings", level, message, "make room, or record elsewhere by --runs")
    return CheckResult("recordings", "ok", f"{path} can be written, {free // MIB} MiB are free")


def check_clock_service() -> list[CheckResult]:
    """Whether a time service keeps this machine's clock right, as far as the kernel knows."""
    synchronised = is_synchronised()
    if synchronised is None:
        return []
    if synchronised:
        return [CheckResult("clock", "ok", "this machine's clock is kept by a time service")]
    message = "nothing keeps this machine's clock right, as far as its kernel knows"
    advice = (
        'matters to radio = "direct" on several hosts, and to certificates: run a time service,'
        " chrony for instance, on each host (a container has its host's clock)"
    )
    return [CheckResult("clock", "note", message, advice)]


def is_synchronised() -> bool | None:
    """Whether ``adjtimex`` reports a synchronised clock; None if it reports nothing."""
    if sys.platform != "linux" or sys.maxsize < 2**32:
        return None
    buffer = ctypes.create_string_buffer(_TIMEX_BYTES)  # modes = 0: change nothing
    try:
        state = ctypes.CDLL(None).adjtimex(buffer)
    except (OSError, AttributeError):
        return None
    if state < 0:
        return None
    status = int.from_bytes(buffer.raw[_STATUS_OFFSET : _STATUS_OFFSET + 4], sys.byteorder)
    return not (state == UNSYNCHRONISED_STATE or status & UNSYNCHRONISED_STATUS)
