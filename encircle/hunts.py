"""One hunt from start to end, over either link: what ``encircle run`` and the Python API do."""

import json
import secrets
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from protocol.log import bounded_log
from world.result import Result
from world.run_directory import RECORDING, create, new_directory, start_recording, write_summary
from world.scenario import Scenario, load

if TYPE_CHECKING:
    from world.core import WorldCore

LINKS = ("zenoh", "memory")
PROGRESS_PERIOD_S = 0.1


@dataclass(frozen=True, slots=True)
class Hunt:
    """A finished hunt. ``out``: its directory, None if it was not recorded."""

    scenario: Scenario
    seed: int
    link: str
    run: str
    result: Result
    processes: int
    wall_s: float
    out: Path | None
    timing: Mapping[str, Any]

    @property
    def captured(self) -> bool:
        """Whether the target was captured."""
        return self.result.captured

    @property
    def capture_tick(self) -> int | None:
        """The tick of the capture, None without one."""
        return self.result.capture_tick

    @property
    def digest(self) -> str:
        """The digest of everything that happened: equal digests, equal runs."""
        return self.result.digest

    def as_dict(self, name: str) -> dict[str, Any]:
        """What ``--json`` prints; ``name`` is the scenario as it was asked for."""
        return {
            "scenario": name,
            "seed": self.seed,
            "link": self.link,
            "robots": len(self.scenario.ids),
            "processes": self.processes,
            "wall_s": self.wall_s,
            "out": str(self.out) if self.out else None,
            "run": self.run,
            **asdict(self.result),
            **self.timing,
        }


def run(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    seed: int | None = None,
    link: str = "zenoh",
    overrides: Sequence[str] = (),
    out: str | Path | None = None,
    progress: Callable[[dict[str, Any]], None] | None = None,
    start_order: Sequence[str] | None = None,
) -> Hunt:
    """Run one hunt and wait for its end.

    ``scenario``: a shipped name, a TOML file, a mapping or a loaded scenario. ``link``: ``zenoh``
    for one process per robot and one for the world, ``memory`` for the same code in this process.
    ``out``: a directory for recording and summary, which must be new or empty; none by default.
    ``progress`` is called now and then with ``{"tick", "distances_m"}``.

    Raises ``ScenarioError`` for a scenario that cannot be run, ``RunDirectoryError`` for an
    unusable directory and ``RunFailed`` if the run does not come to its end.
    """
    if link not in LINKS:
        raise ValueError(f"link {link!r}: must be one of {', '.join(LINKS)}")
    changes = [*overrides, *([f"seed={seed}"] if seed is not None else [])]
    if isinstance(scenario, Scenario):
        scenario = scenario.model_dump(mode="json", exclude_unset=True)
    loaded = load(scenario, changes)
    name = f"run-{secrets.token_hex(6)}"
    directory = create(Path(out)) if out is not None else None
    tell = progress or (lambda _report: None)
    begun = time.perf_counter()
    if link == "memory":
        result, timing, processes = _in_memory(loaded, name, directory, tell)
    else:
        result, timing, processes = _as_processes(loaded, name, directory, tell, start_order)
    wall_s = time.perf_counter() - begun
    return Hunt(loaded, loaded.seed, link, name, result, processes, wall_s, directory, timing)


def _in_memory(
    scenario: Scenario, name: str, directory: Path | None, tell: Callable[[dict[str, Any]], None]
) -> tuple[Result, dict[str, Any], int]:
    from encircle.memory import run_in_memory
    from world.engine import build

    arena = build(scenario, scenario.seed)
    recorder = start_recording(directory, scenario, name) if directory else None
    record = recorder.record if recorder else None
    said = time.perf_counter()

    def progress(world: "WorldCore") -> None:
        nonlocal said
        if time.perf_counter() - said >= PROGRESS_PERIOD_S:
            said = time.perf_counter()
            tell({"tick": world.state.tick, "distances_m": list(world.result().distances_m)})

    begun = time.perf_counter()
    try:
        result = run_in_memory(arena, name, bounded_log(), record, progress)
    finally:
        if recorder is not None:
            recorder.close()
    timing = {"rounds_s": time.perf_counter() - begun}
    tell({"result": asdict(result)})
    if directory is not None:
        write_summary(directory, scenario, result, name, timing)
    return result, timing, 1


def _as_processes(
    scenario: Scenario,
    name: str,
    directory: Path | None,
    tell: Callable[[dict[str, Any]], None],
    start_order: Sequence[str] | None,
) -> tuple[Result, dict[str, Any], int]:
    from encircle.launch import run_processes

    with tempfile.TemporaryDirectory(prefix="encircle-") as scratch:
        # The world reads the scenario as resolved here, so that both mean the same one.
        path = Path(scratch) / "scenario.json"
        path.write_text(scenario.model_dump_json(exclude_unset=True), encoding="utf-8")
        arguments = [str(path), *(["--out", str(directory)] if directory else [])]
        result, timing = run_processes(arguments, scenario.ids, name, tell, start_order)
    return result, timing, len(scenario.ids) + 1


def recording_of(path: str | Path) -> Path:
    """The recording file of a run directory, or the file itself."""
    place = Path(path)
    return place / RECORDING if place.is_dir() else place


def default_directory(scenario_name: str, seed: int) -> Path:
    """A new directory under ``runs/`` for a hunt that was not told where to record."""
    return new_directory(Path("runs"), scenario_name, seed)


def read_metadata(metadata: Mapping[str, str]) -> tuple[Scenario, int, str]:
    """Scenario, seed and run name out of a recording's metadata."""
    tree = json.loads(metadata["scenario"])
    return load(tree), int(metadata["seed"]), metadata["run"]
