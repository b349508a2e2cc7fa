"""One hunt from start to end, over either link: what ``encircle run`` and the Python API do."""

import json
import secrets
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from encircle.protocol.endings import failure_reason
from encircle.protocol.process.interrupts import check, signals_held
from encircle.protocol.process.log import bounded_log
from encircle.protocol.process.tracebacks import failure_line
from encircle.runner.links import LINKS
from encircle.world.coordinator.result import GO_ON, WHEN_LOST, Result
from encircle.world.loading.interventions import InterventionRefused, table_of
from encircle.world.loading.load import load
from encircle.world.loading.remarks import ScenarioRemark, remarks_on
from encircle.world.process.pace import Pace
from encircle.world.recording.recorder import RecordingStopped
from encircle.world.recording.run_directory import (
    create,
    new_directory,
    start_recording,
    write_summary,
)
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from encircle.runner.interventions import Interventions
    from encircle.runner.launch import Timeouts
    from encircle.runner.onlooking import HuntOnlooker
    from encircle.runner.trails import Trails
    from encircle.world.coordinator.journal import Record
    from encircle.world.coordinator.world_core import WorldCore
    from encircle.world.recording.recorder import Recorder
    from encircle.world.recording.resuming import Resumed

PROGRESS_PERIOD_S = 0.1
HELD_PERIOD_S = 0.05
"""How often a hunt in memory that is held back looks whether it is to end."""


@dataclass(frozen=True, slots=True)
class Hunt:
    """A finished hunt. ``out``: its directory, None if it was not recorded.

    ``positions``: (T, N + 1, 2) where robots and target were at each tick, in m, of a hunt in
    memory from its start; else None.
    """

    scenario: Scenario
    seed: int
    link: str
    run: str
    result: Result
    processes: int
    wall_s: float
    out: Path | None
    timing: Mapping[str, Any]
    positions: "NDArray[np.float64] | None" = field(default=None, repr=False, compare=False)

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

    def _repr_html_(self) -> str:
        # Notebooks ask for it. By name, as the room is above this one, and nobody else needs it.
        view = import_module("encircle.notebook.hunt_view")
        html: str = view.hunt_html(self)
        return html


def run(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    seed: int | None = None,
    link: str = "zenoh",
    overrides: Sequence[str] = (),
    out: str | Path | None = None,
    progress: Callable[[dict[str, Any]], None] | None = None,
    start_order: Sequence[str] | None = None,
    when_lost: str = GO_ON,
    timeouts: "Timeouts | None" = None,
    interventions: "Interventions | None" = None,
    pace: float | None = None,
    onlooker: "HuntOnlooker | None" = None,
    robots_per_process: int = 1,
) -> Hunt:
    """Run one hunt and wait for its end.

    ``scenario``: a shipped name, a TOML file, a mapping or a loaded scenario. ``link``: ``zenoh``
    for one process per robot and one for the world, ``memory`` for the same code in this process.
    ``out``: a directory for recording and summary, which must be new or empty; none by default.
    ``progress`` is called now and then with ``{"tick", "distances_m"}``; in a notebook a bar is
    shown without it. ``when_lost``: whether the run is to ``go-on`` without a robot whose process
    is lost, or to ``end``. ``timeouts``: how long processes are waited for,
    ``encircle.runner.launch.TIMEOUTS`` if left out. ``interventions``: a queue of events that are
    given to the run while it goes on, from any thread; ``progress`` is told what became of each:
    ``{"intervention": {"given", "event"}}`` with the tick, or ``{"refused_intervention"}`` with
    why. ``pace``: how many times faster than real time ticks may go by, as fast as they can if
    None. ``onlooker``: who is shown the hunt as it goes on. ``robots_per_process``: over Zenoh, so
    many robots share a process; in memory it means nothing.

    Raises ``ScenarioError`` for a scenario that cannot be run, ``RunDirectoryError`` for an
    unusable directory and ``RunFailed`` if the run does not come to its end; in memory
    ``Interrupted``, a ``KeyboardInterrupt``, after Ctrl-C. Warns with ``ScenarioRemark`` of what
    may not be meant, such as a team that can never capture.
    """
    _check("link", link, LINKS)
    _check("when_lost", when_lost, WHEN_LOST)
    _check_robots_per_process(robots_per_process)
    changes = [*overrides, *([f"seed={seed}"] if seed is not None else [])]
    if isinstance(scenario, Scenario):
        scenario = scenario.model_dump(mode="json", exclude_unset=True)
    loaded = load(scenario, changes)
    check_link(loaded, link)
    check_pace(loaded, pace)
    for remark in remarks_on(loaded):
        warnings.warn(remark, ScenarioRemark, stacklevel=2)
    name = f"run-{secrets.token_hex(6)}"
    is_new = out is not None and not Path(out).exists()
    directory = create(Path(out)) if out is not None else None
    trails = None
    begun = time.perf_counter()
    try:
        with signals_held(), _shown(onlooker, loaded, name), _told(progress, loaded) as tell:
            if link == "memory":
                # Imported late: robots' code is not needed by who starts processes.
                from encircle.runner.trails import Trails

                trails = Trails()
                result, timing, processes = _in_memory(
                    loaded, name, directory, tell, None, interventions, pace, onlooker, trails
                )
            else:
                order = start_order or ["world", *loaded.ids]
                given = (when_lost, timeouts, interventions, pace, onlooker, robots_per_process)
                result, timing = _as_processes(loaded, name, directory, tell, order, *given)
                processes = 1 + _robot_processes(loaded, robots_per_process)
    finally:
        if directory is not None and is_new:
            # Of a run that has not begun nothing is left.
            with suppress(OSError):
                directory.rmdir()
    wall_s = time.perf_counter() - begun
    positions = None if trails is None else trails.positions()
    about = (name, result, processes, wall_s, directory, timing, positions)
    return Hunt(loaded, loaded.seed, link, *about)


def resume(
    directory: str | Path,
    *,
    link: str = "zenoh",
    progress: Callable[[dict[str, Any]], None] | None = None,
    when_lost: str = GO_ON,
    timeouts: "Timeouts | None" = None,
    interventions: "Interventions | None" = None,
    pace: float | None = None,
    onlooker: "HuntOnlooker | None" = None,
    robots_per_process: int = 1,
) -> Hunt:
    """Go on with a run that broke off, where its recording in ``directory`` ends, to its end.

    The recording becomes whole; what it was is kept beside it. ``link``, ``progress``,
    ``when_lost``, ``timeouts``, ``interventions``, ``pace``, ``onlooker`` and
    ``robots_per_process``: as for ``run``, and link and processes may be others.
    Interventions that are recorded are played again by themselves. Raises
    ``RunDirectoryError`` if there is nothing to go on with, or if what is recorded is not what this
    program comes to; then nothing has been changed. ``RunFailed`` as for ``run``.
    """
    from encircle.world.recording.resuming import read_last, rebuild

    _check("link", link, LINKS)
    _check("when_lost", when_lost, WHEN_LOST)
    _check_robots_per_process(robots_per_process)
    run_directory = Path(directory)
    begun = time.perf_counter()
    with signals_held():
        resumed = rebuild(read_last(run_directory), bounded_log())
        scenario, name = resumed.core.rounds.written, resumed.core.run
        check_pace(scenario, pace)
        shown = _shown(onlooker, scenario, name, resumed.messages)
        with shown, _told(progress, scenario) as tell:
            if link == "memory" or resumed.core.ended is not None:
                result, timing, processes = _in_memory(
                    scenario, name, run_directory, tell, resumed, interventions, pace, onlooker
                )
            else:
                from encircle.runner.launch import run_processes

                arguments = ["--resume", str(run_directory), "--when-lost", when_lost]
                arguments += _pace_option(pace)
                order = ["world", *scenario.ids]
                given = (run_directory, timeouts, interventions, onlooker, robots_per_process)
                result, timing = run_processes(arguments, scenario.ids, name, tell, order, *given)
                processes = 1 + _robot_processes(scenario, robots_per_process)
    wall_s = time.perf_counter() - begun
    return Hunt(
        scenario, scenario.seed, link, name, result, processes, wall_s, run_directory, timing
    )


def _check(name: str, value: str, known: Sequence[str]) -> None:
    if value not in known:
        raise ValueError(f"{name} {value!r}: must be one of {', '.join(known)}")


def _check_robots_per_process(value: int) -> None:
    if type(value) is not int or value < 1:
        raise ValueError(f"robots_per_process {value!r}: must be a whole number of at least 1")


def _robot_processes(scenario: Scenario, robots_per_process: int) -> int:
    return -(-len(scenario.ids) // robots_per_process)


def check_link(scenario: Scenario, link: str) -> None:
    """``ScenarioError`` if the scenario cannot be run over the link."""
    if link == "memory" and scenario.clock == "wall":
        raise ScenarioError("clock = 'wall': in memory no time passes; use --link zenoh")


def check_pace(scenario: Scenario, pace: float | None) -> None:
    """``ScenarioError`` if the scenario has a pace of its own."""
    if pace is not None and scenario.clock == "wall":
        raise ScenarioError(f"clock = 'wall' has a pace of its own; leave --pace {pace:g} out")


def _pace_option(pace: float | None) -> list[str]:
    return [] if pace is None else ["--pace", f"{pace!r}"]


@contextmanager
def _shown(
    onlooker: "HuntOnlooker | None",
    scenario: Scenario,
    run: str,
    so_far: Iterable[tuple[int, str, bytes]] = (),
) -> Iterator[None]:
    """While this lasts, the hunt is shown to an onlooker, if there is one."""
    if onlooker is None:
        yield
        return
    onlooker.begin(scenario, run, so_far)
    try:
        yield
    finally:
        onlooker.end()


def _in_memory(
    scenario: Scenario,
    name: str,
    directory: Path | None,
    tell: Callable[[dict[str, Any]], None],
    resumed: "Resumed | None" = None,
    interventions: "Interventions | None" = None,
    pace: float | None = None,
    onlooker: "HuntOnlooker | None" = None,
    trails: "Trails | None" = None,
) -> tuple[Result, dict[str, Any], int]:
    from encircle.runner.memory import RunEndedByPlugin, run_in_memory
    from encircle.runner.testimony import RunFailed
    from encircle.world.arena.engine import build

    arena = build(scenario, scenario.seed)
    so_far = resumed.messages if resumed else None
    check(" before the run began")
    recorder = start_recording(directory, scenario, name, so_far) if directory else None
    record = _recorded_and_shown(recorder, onlooker)
    held = None if pace is None else Pace(pace, scenario.tick_s)
    reported_s, reported = time.perf_counter(), 0

    def progress(world: "WorldCore") -> None:
        nonlocal reported_s, reported
        check(f" at tick {world.state.tick}")
        departures = world.rounds.departures
        for departure in departures[reported:]:
            tell({"departure": list(departure.row)})
        reported = len(departures)
        if time.perf_counter() - reported_s >= PROGRESS_PERIOD_S:
            reported_s = time.perf_counter()
            tell({"tick": world.state.tick, "distances_m": list(world.rounds.result().distances_m)})
        while held is not None and (left_s := held.left_s(world.state.tick)) > 0.0:
            time.sleep(min(left_s, HELD_PERIOD_S))
            check(f" at tick {world.state.tick}")
        if interventions is not None:
            # Last, so that what is given while the tick is held back is of the next one.
            _intervene(world, interventions, tell)

    begun, failure = time.perf_counter(), ""
    try:
        with closing(recorder) if recorder else nullcontext():
            try:
                result = run_in_memory(
                    arena, name, bounded_log(), record, progress, trails, resumed
                )
            except RunEndedByPlugin as error:
                failure = failure_line(error.failed, directory)
                result = replace(error.result, ended=failure_reason(failure))
        timing = {"rounds_s": time.perf_counter() - begun}
        tell({"result": asdict(result)})
        if directory is not None:
            write_summary(directory, scenario, result, name, timing)
    except RecordingStopped as error:
        raise RunFailed(str(error), resumable=True) from None
    if failure:
        raise RunFailed(failure)
    return result, timing, 1


@contextmanager
def _told(
    progress: Callable[[dict[str, Any]], None] | None, scenario: Scenario
) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Who is told how far the hunt is: whom it was said to tell, or a bar in a notebook."""
    if progress is not None or "IPython" not in sys.modules:
        yield progress or (lambda _report: None)
        return
    # Imported late: it draws, and only a notebook needs it here.
    from encircle.progress import notebook_progress

    with notebook_progress(scenario.title or "hunt", "ticks") as bar:
        yield lambda report: bar(report["tick"], scenario.ticks_max) if "tick" in report else None


def _recorded_and_shown(
    recorder: "Recorder | None", onlooker: "HuntOnlooker | None"
) -> "Record | None":
    """What takes in each message of a hunt in memory."""
    if recorder is None or onlooker is None:
        return recorder.record if recorder else onlooker.hear if onlooker else None
    record, hear = recorder.record, onlooker.hear

    def both(tick: int, key: str, payload: bytes) -> None:
        record(tick, key, payload)
        hear(tick, key, payload)

    return both


def _intervene(
    world: "WorldCore", interventions: "Interventions", tell: Callable[[dict[str, Any]], None]
) -> None:
    """Give the run what has been waiting for it."""
    for line in interventions.take():
        try:
            event = world.intervene(json.loads(line))
        except InterventionRefused as refused:
            tell({"refused_intervention": str(refused)})
        else:
            tell({"intervention": {"given": world.state.tick, "event": table_of(event)}})


def _as_processes(
    scenario: Scenario,
    name: str,
    directory: Path | None,
    tell: Callable[[dict[str, Any]], None],
    order: Sequence[str],
    when_lost: str,
    timeouts: "Timeouts | None",
    interventions: "Interventions | None",
    pace: float | None,
    onlooker: "HuntOnlooker | None",
    robots_per_process: int,
) -> tuple[Result, dict[str, Any]]:
    from encircle.runner.launch import run_processes

    with tempfile.TemporaryDirectory(prefix="encircle-") as scratch:
        # The world reads the scenario as resolved here, so that both mean the same one.
        path = Path(scratch) / "scenario.json"
        path.write_text(scenario.model_dump_json(exclude_unset=True), encoding="utf-8")
        arguments = [str(path), *(["--out", str(directory)] if directory else [])]
        arguments += ["--when-lost", when_lost, *_pace_option(pace)]
        given = (directory, timeouts, interventions, onlooker, robots_per_process)
        return run_processes(arguments, scenario.ids, name, tell, order, *given)


def default_directory(scenario_name: str, seed: int) -> Path:
    """A new directory under ``runs/`` for a hunt that was not told where to record."""
    return new_directory(Path("runs"), scenario_name, seed)
