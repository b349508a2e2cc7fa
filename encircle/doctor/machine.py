"""What of this machine a run needs: versions, memory, files, disk, ports, a clock that is kept.

Each check looks once, changes nothing that it does not undo, and gives findings: what was found,
whether that is well, and what to do if not. Limits that a container sets are read where the kernel
shows them (cgroups, resource limits), because a process is told of them in no other way.
"""

import ctypes
import errno
import os
import re
import resource
import shutil
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, metadata, requires, version
from pathlib import Path
from typing import Literal, NamedTuple

from encircle.protocol import VERSION

MIB = 1024 * 1024
NODE_BYTES = 128 * MIB
"""A robot takes about 100 MiB, a world 85 MiB; more in a big team."""
DISK_BYTES_MIN = 64 * MIB
FILES_MIN = 256
CORES_MIN = 0.5
NO_LIMIT_BYTES = 2**60
UNSYNCHRONISED_STATUS, UNSYNCHRONISED_STATE = 0x40, 5
_STATUS_OFFSET, _TIMEX_BYTES = 40, 512
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*\(?([^;)]*)\)?\s*(;.*)?")
_BOUND = re.compile(r"(>=|<=|==|<|>)\s*([0-9][0-9.]*)")

Level = Literal["ok", "note", "wrong"]


class CheckResult(NamedTuple):
    """One thing that was looked at. ``advice``: what to do about it; empty if there is no need."""

    check: str
    level: Level
    said: str
    advice: str = ""


def machine(runs: Path, runs_named: bool) -> list[CheckResult]:
    """Everything about this machine; ``runs_named``: the directory was asked for by name."""
    return [
        *packages(),
        memory(),
        *cores_and_files(),
        temporary_directory(),
        runs_directory(runs, runs_named),
        *kept_clock(),
    ]


def packages(of: str = "encircle") -> list[CheckResult]:
    """Python and what is installed, against what the program needs."""
    try:
        wanted, about = requires(of) or [], metadata(of)
    except PackageNotFoundError:
        advice = "install it into this environment: make setup, or pip install ."
        return [CheckResult("versions", "wrong", f"{of} is not installed as a package", advice)]
    found: list[CheckResult] = []
    python = ".".join(map(str, sys.version_info[:3]))
    if not within_bounds(python, about["Requires-Python"] or ""):
        said = f"Python is {python}, needed is {about['Requires-Python']}"
        found.append(
            CheckResult("versions", "wrong", said, "make an environment with a newer Python")
        )
    have = [f"Python {python}", f"{of} {version(of)}", f"wire version {VERSION}"]
    lacking: dict[str, list[str]] = {}
    for name, bounds, extra in map(_requirement, wanted):
        try:
            there = version(name)
        except PackageNotFoundError:
            lacking.setdefault(extra, []).append(name)
            continue
        if not within_bounds(there, bounds):
            said = f"{name} is {there}, needed is {bounds}"
            advice = f"pip install '{name}{bounds}'"
            found.append(CheckResult("versions", "wrong" if not extra else "note", said, advice))
        elif not extra:
            have.append(f"{name} {there}")
    for extra, names in lacking.items():
        said = f"not installed: {', '.join(names)}"
        if extra:
            level: Level = "note"
            said += f"; only {extra} need it" if extra == "studies" else f"; only for {extra}"
        else:
            level = "wrong"
        advice = f"pip install '{of}[{extra}]'" if extra else f"pip install {' '.join(names)}"
        found.append(CheckResult("versions", level, said, advice))
    return [CheckResult("versions", "ok", ", ".join(have)), *found]


def within_bounds(there: str, bounds: str) -> bool:
    """Whether a version fulfils bounds such as ``>=1.10,<2``; only its leading numbers count."""
    return all(_holds(_numbers(there), sign, _numbers(v)) for sign, v in _BOUND.findall(bounds))


def _holds(there: list[int], sign: str, bound: list[int]) -> bool:
    size = max(len(there), len(bound))
    a, b = (numbers + [0] * (size - len(numbers)) for numbers in (there, bound))
    return {">=": a >= b, "<=": a <= b, "==": a == b, "<": a < b, ">": a > b}[sign]


def _numbers(text: str) -> list[int]:
    leading = re.match(r"\d+(\.\d+)*", text)
    return [int(part) for part in leading[0].split(".")] if leading else []


def _requirement(line: str) -> tuple[str, str, str]:
    """Name, bounds and the extra that a requirement belongs to, which is empty for the program."""
    match = _REQUIREMENT.match(line)
    assert match is not None, line
    extra = re.search(r"extra\s*==\s*['\"]([^'\"]+)", match[3] or "")
    return match[1], match[2].strip(), extra[1] if extra else ""


def memory(
    groups: Path = Path("/sys/fs/cgroup"), meminfo: Path = Path("/proc/meminfo")
) -> CheckResult:
    """Whether there is enough for one more party, by the container's limit or the machine's."""
    free, whose = _available_bytes(meminfo), "of this machine"
    for limit, used in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        most, taken = _number_in(groups / limit), _number_in(groups / used)
        if most is not None and taken is not None and most < NO_LIMIT_BYTES:
            left = max(0, most - taken)
            if free is None or left < free:
                free, whose = left, f"of the {most // MIB} MiB that this container may use"
    if free is None:
        return CheckResult("memory", "note", "nothing says how much there is")
    said = f"{free // MIB} MiB {whose} are free"
    if free < NODE_BYTES:
        advice = "raise the limit (mem_limit, docker run --memory) or end what else runs here"
        return CheckResult("memory", "wrong", f"{said}, a robot needs {NODE_BYTES // MIB}", advice)
    return CheckResult("memory", "ok", said)


def _available_bytes(meminfo: Path) -> int | None:
    try:
        found = re.search(r"^MemAvailable:\s+(\d+) kB", meminfo.read_text(), re.MULTILINE)
    except OSError:
        return None
    return int(found[1]) * 1024 if found else None


def _number_in(path: Path) -> int | None:
    try:
        text = path.read_text().strip()
    except OSError:
        return None
    return int(text) if text.isdigit() else None


def cores_and_files(groups: Path = Path("/sys/fs/cgroup")) -> list[CheckResult]:
    """How much of the processor there is, and how many files may be open."""
    cores = float(len(os.sched_getaffinity(0)))
    try:
        quota, period = (groups / "cpu.max").read_text().split()
        cores = min(cores, int(quota) / int(period))
    except (OSError, ValueError):
        pass  # no limit, or none that is shown here
    found = [CheckResult("cores", "ok", f"{cores:g}")]
    if cores < CORES_MIN:
        advice = "allow it more (cpus, docker run --cpus), or allow the run more time to answer"
        found = [CheckResult("cores", "note", f"only {cores:g}: rounds will take long", advice)]
    files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if 0 <= files < FILES_MIN:
        said = f"only {files} files may be open, {FILES_MIN} are needed"
        advice = "raise the limit: ulimit -n, or ulimits in the compose file"
        found.append(CheckResult("files", "wrong", said, advice))
    return found


def temporary_directory() -> CheckResult:
    """Whether there is one that can be written to: ``encircle run`` keeps the scenario there."""
    try:
        # It never has a name, so nothing is left however this ends.
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


def runs_directory(path: Path, named: bool) -> CheckResult:
    """Whether runs can be recorded there: permission and room. It is not made if it is not there.

    ``named``: if it was not, a directory that cannot be used is only worth a note: a robot records
    nothing.
    """
    place = path.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    level: Level = "wrong" if named else "note"
    try:
        if not place.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        with tempfile.TemporaryFile(dir=place):
            free = shutil.disk_usage(place).free
    except OSError as error:
        advice = (
            "matters to a world alone: give its user the directory (ENCIRCLE_UID, ENCIRCLE_GID in"
            " containers), or another one by --runs"
        )
        return CheckResult("recordings", level, f"{path} cannot be used: {error.strerror}", advice)
    if free < DISK_BYTES_MIN:
        said = f"{path}: only {free // MIB} MiB are free"
        return CheckResult("recordings", level, said, "make room, or record elsewhere by --runs")
    return CheckResult("recordings", "ok", f"{path} can be written, {free // MIB} MiB are free")


def kept_clock() -> list[CheckResult]:
    """Whether the kernel knows that something keeps this machine's clock right."""
    synchronised = is_synchronised()
    if synchronised is None:
        return []
    if synchronised:
        return [CheckResult("clock", "ok", "this machine's clock is kept by a time service")]
    said = "nothing keeps this machine's clock right, as far as its kernel knows"
    advice = (
        'matters to radio = "direct" on several hosts, and to certificates: run a time service,'
        " chrony for instance, on each host (a container has its host's clock)"
    )
    return [CheckResult("clock", "note", said, advice)]


def is_synchronised() -> bool | None:
    """What ``adjtimex`` says, asked only and not told anything; None if it says nothing."""
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
