"""What a person sees of a running hunt: a progress line on standard error, then a short table."""

from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from encircle.hunts import Hunt
from world.scenario import Scenario

SHOWN_MAX = 6


class Display:
    """Progress of one hunt; a context manager."""

    def __init__(self, scenario: Scenario, link: str) -> None:
        self._console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description:8}"),
            BarColumn(bar_width=20),
            TextColumn("tick {task.completed}/{task.total}"),
            TextColumn("{task.fields[distances]}"),
            TimeElapsedColumn(),
            console=self._console,
        )
        first = "joining" if link == "zenoh" else "hunting"
        self._task = self._progress.add_task(first, total=scenario.ticks_max, distances="")

    def __enter__(self) -> "Display":
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()

    def update(self, report: dict[str, Any]) -> None:
        """Show a report of the run."""
        if "tick" in report:
            self._show("hunting", report["tick"], report["distances_m"])
        elif "result" in report:
            result = report["result"]
            self._show("ended", result["ticks"], result["distances_m"])
        elif "started" in report:
            pids = ", ".join(f"{name} {pid}" for name, pid in report["started"].items())
            self._console.print(f"processes: {pids}", highlight=False)
        elif "log" in report:
            self._console.print(report["log"], highlight=False)

    def _show(self, what: str, tick: int, distances_m: list[float]) -> None:
        near = " ".join(f"{d:.1f}" for d in distances_m[:SHOWN_MAX])
        more = " ..." if len(distances_m) > SHOWN_MAX else ""
        self._progress.update(
            self._task, completed=tick, description=what, distances=f"{near}{more} m"
        )

    def show_result(self, hunt: Hunt, directory: Path, figure: Path) -> None:
        """The short table at the end, on standard output."""
        result, tick_s = hunt.result, hunt.scenario.tick_s
        table = Table(title=hunt.scenario.title or None, show_header=False, title_justify="left")
        table.add_column(style="bold")
        table.add_column()
        if result.capture_tick is not None:
            outcome = f"at tick {result.capture_tick} ({result.capture_tick * tick_s:.1f} s)"
        else:
            outcome = f"no, after {result.ticks} ticks"
        lost = sum(result.packets_lost.values())
        causes = ", ".join(f"{n} by {cause}" for cause, n in result.packets_lost.items())
        table.add_row("captured", outcome)
        table.add_row(
            "distances to target",
            ", ".join(
                f"{robot} {d:.2f} m"
                for robot, d in zip(hunt.scenario.ids, result.distances_m, strict=True)
            ),
        )
        table.add_row("packets sent", f"{result.packets_sent}")
        table.add_row("packets lost", f"{lost}" + (f" ({causes})" if causes else ""))
        if result.refused:
            refused = ", ".join(f"{n} {cause}" for cause, n in result.refused.items())
            table.add_row("messages refused", refused)
        where = f"{hunt.processes} over Zenoh" if hunt.link == "zenoh" else "1, all in memory"
        table.add_row("processes", where)
        table.add_row("seed, digest", f"{hunt.seed}, {result.digest}")
        table.add_row("recording", str(directory / "recording.mcap"))
        table.add_row("figure", str(figure))
        Console().print(table)
