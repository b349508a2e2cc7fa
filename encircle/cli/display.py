"""What a person sees of a running hunt: a progress line on standard error, then a short table."""

import time
from collections.abc import Callable, Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from encircle.network.transport_tables import plain_text
from encircle.progress import PERIOD_S
from encircle.protocol.endings import is_failure
from encircle.protocol.process.log import printable
from encircle.runner.hunts import Hunt
from encircle.world.coordinator.result import Result
from encircle.world.scenario.model import Scenario

SHOWN_MAX = 6


class Display:
    """Progress of one hunt; a context manager. The line goes when the hunt ends, however it does.

    ``console`` and ``clock_s`` are for tests.
    """

    def __init__(
        self,
        scenario: Scenario,
        link: str,
        console: Console | None = None,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._console = console or Console(stderr=True)
        self._clock_s = clock_s
        self._begun_s = self._reported_s = clock_s()
        self._ticks_max = scenario.ticks_max
        self._progress = Progress(
            TextColumn("{task.description:8}"),
            BarColumn(bar_width=20),
            TextColumn("tick {task.completed}/{task.total}"),
            TextColumn("{task.fields[distances]}"),
            TimeElapsedColumn(),
            console=self._console,
            transient=True,
        )
        first = "joining" if link == "zenoh" else "hunting"
        self._task = self._progress.add_task(first, total=scenario.ticks_max, distances="")

    def __enter__(self) -> "Display":
        if self._console.is_terminal:
            self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop()

    def update(self, report: dict[str, Any]) -> None:
        """Show a report of the run."""
        if "tick" in report:
            self._show(report["tick"], _near(report["distances_m"]))
        elif "result" in report:
            self._end(report["result"])
        elif "started" in report:
            pids = ", ".join(f"{name} {pid}" for name, pid in report["started"].items())
            self._say(f"run {report['run']} at {report['endpoint']}")
            self._say(f"processes: {pids}")
        elif "intervention" in report:
            given, event = report["intervention"]["given"], report["intervention"]["event"]
            self._say(f"tick {given}: intervention: {_event_text(event)}")
        elif "refused_intervention" in report:
            self._say(report["refused_intervention"])
        elif "departure" in report:
            tick, robot, what = report["departure"]
            policy = f" ({report['policy']})" if "policy" in report else ""
            self._say(f"tick {tick}: robot {robot} is {what}{policy}")
        elif "log" in report:
            self._say(report["log"])

    def _show(self, tick: int, near: str) -> None:
        """Show a tick: on a terminal at once, elsewhere every ``PERIOD_S`` s."""
        self._progress.update(self._task, completed=tick, description="hunting", distances=near)
        now_s = self._clock_s()
        if not self._console.is_terminal and now_s - self._reported_s >= PERIOD_S:
            self._reported_s = now_s
            self._say(f"tick {tick} of {self._ticks_max}, {near} to the target")

    def _end(self, result: dict[str, Any]) -> None:
        """Say how the hunt ended; of one that failed, an error does."""
        self._stop()
        if not is_failure(result["ended"]):
            how = "captured" if result["captured"] else "not captured"
            took = timedelta(seconds=round(self._clock_s() - self._begun_s))
            near = _near(result["distances_m"])
            self._say(f"ended: {how} at tick {result['ticks']}, {near} to the target, {took}")

    def _stop(self) -> None:
        # Where it was never started, it would print an empty line.
        if self._console.is_terminal:
            self._progress.stop()

    def _say(self, line: str) -> None:
        # Whole lines, however wide the terminal is: they are read by programs, too.
        self._console.print(printable(line), highlight=False, markup=False, soft_wrap=True)

    def show_result(self, hunt: Hunt, directory: Path, figure: Path) -> None:
        """The short table at the end, on standard output."""
        result, tick_s = hunt.result, hunt.scenario.tick_s
        title = plain_text(hunt.scenario.title) if hunt.scenario.title else None
        table = Table(title=title, show_header=False, title_justify="left")
        table.add_column(style="bold")
        table.add_column()

        def add(what: str, value: str) -> None:
            table.add_row(what, plain_text(value))

        if result.capture_tick is not None:
            outcome = f"at tick {result.capture_tick} ({result.capture_tick * tick_s:.1f} s)"
        else:
            outcome = f"no, after {result.ticks} ticks"
        lost = sum(result.packets_lost.values())
        causes = ", ".join(f"{n} by {cause}" for cause, n in result.packets_lost.items())
        add("captured", outcome)
        add(
            "distances to target",
            ", ".join(
                f"{robot} {d:.2f} m"
                for robot, d in zip(hunt.scenario.ids, result.distances_m, strict=True)
            ),
        )
        add("packets sent", f"{result.packets_sent}")
        add("packets lost", f"{lost}" + (f" ({causes})" if causes else ""))
        if hunt.scenario.radio == "world":
            add("packets' delay", _delay(result))
        if result.refused:
            refused = ", ".join(f"{n} {cause}" for cause, n in result.refused.items())
            add("messages refused", refused)
        for tick, robot, what in result.departures[:SHOWN_MAX]:
            add(f"tick {tick}", f"robot {robot} is {what}")
        if len(result.departures) > SHOWN_MAX:
            add("", f"and {len(result.departures) - SHOWN_MAX} more of that kind")
        for what, value in _punctuality(hunt):
            add(what, value)
        where = f"{hunt.processes} over Zenoh" if hunt.link == "zenoh" else "1, all in memory"
        add("processes", where)
        add("seed, digest", f"{hunt.seed}, {result.digest}")
        add("recording", str(directory / "recording.mcap"))
        add("figure", str(figure))
        Console().print(table)


def _delay(result: Result) -> str:
    """The mean delay that the channel made, beside the one that the scenario asks for."""
    delivered = "none arrive"
    if result.delay_s_mean is not None:
        delivered = f"{result.delay_s_mean:.4g} s on average"
    return f"{delivered}; asked for: {result.delay_s_mean_asked:.4g} s ({result.delay_model})"


def _near(distances_m: Sequence[float]) -> str:
    near = " ".join(f"{d:.1f}" for d in distances_m[:SHOWN_MAX])
    return near + (" ... m" if len(distances_m) > SHOWN_MAX else " m")


def _punctuality(hunt: Hunt) -> list[tuple[str, str]]:
    """How a run by the clock kept its time; nothing in lock-step."""
    timing = hunt.timing.get("real_time")
    if timing is None:
        return []
    jitter_ms = [f"{timing[f'jitter_s_{name}'] * 1e3:.2f}" for name in ("median", "p99", "max")]
    deadlines = (
        f"{timing['overruns']} overruns in {timing['ticks']} ticks,"
        f" {timing['deadlines_skipped']} deadlines skipped"
    )
    names = {"late": "late", "held": "held", "stood_still": "stood still"}
    commands = [
        f"{robot} " + ", ".join(f"{counts[n]} {word}" for n, word in names.items() if counts[n])
        for robot, counts in timing["robots"].items()
        if any(counts[name] for name in names)
    ]
    superseded = sum(counts["superseded"] for counts in timing["robots"].values())
    more = f"; {len(commands) - SHOWN_MAX} more" if len(commands) > SHOWN_MAX else ""
    return [
        ("world's deadlines", deadlines),
        ("jitter ms", f"median {jitter_ms[0]}, 99 % {jitter_ms[1]}, largest {jitter_ms[2]}"),
        ("commands not in time", "; ".join(commands[:SHOWN_MAX]) + more or "none"),
        *([("packets superseded", f"{superseded}")] if superseded else []),
    ]


def _event_text(event: Mapping[str, Any]) -> str:
    """An event as its scenario's file would have it, in one line."""
    return ", ".join(f"{key} = {value}" for key, value in event.items())
