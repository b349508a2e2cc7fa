"""``encircle run``: a hunt with a display, a figure at its end, and a way on if it breaks off."""

import json
import threading
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import Console

from encircle.cli.display import Display
from encircle.cli.reading import prints_elsewhere
from encircle.network.transport_tables import LINKS_SHOWN_MAX, print_transport_report
from encircle.protocol.process.interrupts import Interrupted, exit_message, signals_held, signals_to
from encircle.protocol.process.log import say, say_error
from encircle.runner.hunts import Hunt, check_link, check_pace, default_directory, resume, run
from encircle.runner.launch import Timeouts
from encircle.runner.testimony import RunFailed
from encircle.world.loading.files import shipped
from encircle.world.loading.load import load
from encircle.world.loading.remarks import ScenarioRemark, remarks_on
from encircle.world.recording.run_directory import RECORDING, SUMMARY
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

if TYPE_CHECKING:
    from encircle.viewer.hunt_show import HuntShow
    from encircle.viewer.showing import ShowOptions

PACE_SHOWN = 1.0


class HuntRequest(NamedTuple):
    """What was asked for. ``resume``: a run's directory, instead of scenario, changes and out.

    ``pace``: times real time, None for the default; ``show``: how the hunt is shown, if it is.
    """

    scenario: str
    changes: Sequence[str]
    out: Path | None
    resume: Path | None
    link: str
    when_lost: str
    timeouts: Timeouts
    pace: float | None = None
    show: "ShowOptions | None" = None
    robots_per_process: int = 1


def _pace(request: HuntRequest, scenario: Scenario) -> float | None:
    """A hunt that is shown goes by at the speed of real time, if nothing else is asked for."""
    is_default = request.pace is None and request.show is not None and scenario.clock != "wall"
    return PACE_SHOWN if is_default else request.pace


def _hunt(
    request: HuntRequest,
    scenario: Scenario,
    directory: Path,
    display: Display,
    onlooker: "HuntShow | None",
) -> Hunt:
    def progress(report: dict[str, Any]) -> None:
        display.update(report)
        if onlooker is not None:
            onlooker.on_report(report)

    how: dict[str, Any] = {
        "pace": _pace(request, scenario),
        "onlooker": onlooker,
        "interventions": None if onlooker is None else onlooker.interventions,
        "link": request.link,
        "progress": progress,
        "when_lost": request.when_lost,
        "timeouts": request.timeouts,
        "robots_per_process": request.robots_per_process,
    }
    if request.resume is not None:
        return resume(directory, **how)
    with warnings.catch_warnings():
        # They have been told in lines of their own.
        warnings.simplefilter("ignore", ScenarioRemark)
        return run(scenario, out=directory, **how)


def _is_resumable(error: RunFailed | Interrupted, directory: Path) -> bool:
    if isinstance(error, RunFailed):
        return error.resumable
    # In memory it was interrupted before its end, or after.
    return (directory / RECORDING).exists() and not (directory / SUMMARY).exists()


def _load(request: HuntRequest) -> Scenario:
    try:
        return load(request.scenario, request.changes)
    except ScenarioError:
        # Imported late: who asks for a scenario need not wait for studies.
        from encircle.studies.plan_files import shipped_studies

        if request.scenario in shipped_studies() and request.scenario not in shipped():
            raise ScenarioError(
                f"scenario {request.scenario!r} is a study: encircle study {request.scenario}"
            ) from None
        raise


def _picture(directory: Path) -> bytes:
    # Imported after the hunt: the robots need not wait for the plotting library.
    from encircle.figures.run_figures import picture_of_run

    return picture_of_run(directory)


def show_transport(directory: Path) -> None:
    """What the network did in a run by the clock, from its summary."""
    summary = json.loads((directory / SUMMARY).read_text(encoding="utf-8"))
    if "transport" in summary:
        print_transport_report(summary["transport"], Console(), LINKS_SHOWN_MAX)


def hunt_and_draw(
    request: HuntRequest, as_json: bool, draw: Callable[[Path], bytes] = lambda _directory: b""
) -> None:
    """Run or resume a hunt, draw it, and show what came of it; raises as ``encircle.run``.

    Raises ``ServerFailed``, too, if its page cannot be served. ``draw`` makes the picture of a run,
    or nothing if it has to be made here.
    """
    if request.show is None:
        _hunt_and_draw(request, as_json, draw, None)
        return
    # Imported late: only who asks for a page needs its server.
    from encircle.runner.interventions import Interventions
    from encircle.viewer.hunt_show import HuntShow

    onlooker = HuntShow(request.show, request.link == "memory", Interventions())
    try:
        _hunt_and_draw(request, as_json, draw, onlooker)
        _stay(onlooker)
    finally:
        onlooker.stop()


def _stay(onlooker: "HuntShow") -> None:
    """Serve the page of a hunt that is over; Ctrl-C is how that ends."""
    stop = threading.Event()

    def interrupt(name: str) -> None:
        say_error(f"encircle: stopped by {name}")
        stop.set()

    with signals_to(interrupt):
        onlooker.stay(stop.is_set)


def _hunt_and_draw(
    request: HuntRequest,
    as_json: bool,
    draw: Callable[[Path], bytes],
    onlooker: "HuntShow | None",
) -> None:
    with prints_elsewhere():
        if request.resume is None:
            scenario = _load(request)
            directory = request.out or default_directory(request.scenario, scenario.seed)
        else:
            # Imported late: it rebuilds a world, which only a run in memory needs as well.
            from encircle.world.recording.resuming import read_last

            scenario, directory = read_last(request.resume).scenario, request.resume
    check_link(scenario, request.link)
    check_pace(scenario, request.pace)
    for remark in remarks_on(scenario):
        say_error(f"encircle: {remark}")
    try:
        with (
            prints_elsewhere(),
            signals_held(),
            Display(scenario, request.link) as display,
        ):
            hunt = _hunt(request, scenario, directory, display, onlooker)
    except (RunFailed, Interrupted) as error:
        if not _is_resumable(error, directory) or scenario.clock == "wall":
            raise RunFailed(str(error)) from None
        raise RunFailed(f"{error}; to go on: encircle run --resume {directory}") from None
    figure = directory / "trajectory.png"
    try:
        with exit_message(f"; the run is over and recorded in {directory}, but not drawn"):
            figure.write_bytes(draw(directory) or _picture(directory))
    except OSError as error:
        raise RunFailed(f"cannot draw {figure}: {error.strerror}") from None
    if as_json:
        name = request.scenario or scenario.title or str(directory)
        say(json.dumps({**hunt.as_dict(name), "figure": str(figure)}))
    else:
        display.show_result(hunt, directory, figure)
        if scenario.clock == "wall":
            show_transport(directory)
