"""How a round's time and a run's memory grow with the team: ``python bench/wide.py``.

Whole hunts in memory, recorded to a file, with 4 to 256 robots. Processor time is split by part: in
each function that opens a part all time counts for that part, but what a function inside it that
opens another one takes. Each size runs in a process of its own, so that memory is its own too. A
power law is fitted to each part by least squares on logarithms, with a 95 % interval of Student's t
from the scatter of the sizes about the line. What 1,000 robots would need is given twice: by that
line, and by measuring the parts alone on arrays of that size.

All robots see each other. ``--noise 0.05``: each robot detects the target where it is not, so that
no two believe the same and each computes its own assignments (``agents/planning/best_ring.py``).
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
from scenarios import endless_hunt
from scipy.optimize import linear_sum_assignment
from scipy.stats import linregress, t

from encircle.agents.brain import brain
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.planning import best_ring
from encircle.agents.planning.assignment import whole_quanta
from encircle.runner import memory
from encircle.world.arena import engine, sensing
from encircle.world.channel import channel
from encircle.world.coordinator.journal import Journal
from encircle.world.coordinator.outgoing import OpenRound
from encircle.world.loading.load import load
from encircle.world.recording.recorder import Recorder

SIZES = (4, 8, 16, 32, 64, 128, 256)
FITTED_FROM = 16
"""Below that, calls take longer than what is done in them."""
PARTS: dict[str, tuple[tuple[Any, str], ...]] = {
    "world": ((engine, "observe"), (engine, "advance")),
    "channel": ((channel, "transmit"), (channel, "deliver")),
    "perceive": ((RobotCore, "_begin"), (brain, "perceive")),
    "assignment": ((best_ring, "assign"), (best_ring, "assign_in_cyclic_order")),
    "act": ((brain, "act"),),
    "record": (
        (memory, "give_answer"),
        (Journal, "note_state"),
        (Journal, "note_answers"),
        (Journal, "commit"),
        (OpenRound, "messages"),
    ),
}
REST = "policy and rest"
WIDEST = 1000
SENSING_M = 1000.0
"""So far that all robots see each other whatever the size of the team."""


class Stopwatch:
    """Seconds of processor time by part, of which one runs at a time."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys([*PARTS, REST], 0.0)
        self._part, self._since = REST, time.process_time()

    def switch(self, part: str) -> str:
        """Count for another part from now on; returns the one before."""
        now, before = time.process_time(), self._part
        self.seconds[before] += now - self._since
        self._part, self._since = part, now
        return before

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, as one that opens a part."""

        def call(*arguments: Any, **named: Any) -> Any:
            before = self.switch(part)
            try:
                return function(*arguments, **named)
            finally:
                self.switch(before)

        return call


@contextmanager
def watched() -> Iterator[Stopwatch]:
    """A stopwatch that is told by the functions of ``PARTS``."""
    watch = Stopwatch()
    with ExitStack() as patches:
        for part, functions in PARTS.items():
            for owner, name in functions:
                function = getattr(owner, name)
                if not callable(function):  # a cached property
                    patches.enter_context(
                        patch.object(function, "func", watch.timed(part, function.func))
                    )
                    continue
                patches.enter_context(patch.object(owner, name, watch.timed(part, function)))
        yield watch


def measure_here(robots: int, noise_m_std: float, cyclic: bool) -> dict[str, Any]:
    """One size, in this process: milliseconds of each part per round, memory, recorded bytes."""
    ticks = max(6, min(200, 3000 // robots))
    scenario = endless_hunt(robots, ticks) | {"sensing": {"noise_m_std": noise_m_std}}
    scenario["team"]["sensing_range_m"] = SENSING_M
    if cyclic:
        scenario["robot"] = {"assignment": "cyclic"}
    arena = engine.build(load(scenario), 1)
    before_mib = peak_mib()
    rounds: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder, watched() as watch:
        recorder = Recorder(Path(folder) / "run.mcap", arena.scenario.tick_s, {})

        def note(_world: Any) -> None:
            watch.switch(REST)
            rounds.append(dict(watch.seconds))

        done = memory.run_in_memory(arena, "wide", print, recorder.record, note)
        recorder.close()
        recorded = (Path(folder) / "run.mcap").stat().st_size
    each = [
        {part: (after[part] - before[part]) * 1e3 for part in after}
        for before, after in pairwise(rounds[1:])
    ]
    typical = {part: float(np.quantile([one[part] for one in each], 0.25)) for part in each[0]}
    return {
        "robots": robots,
        "ms": typical,
        "total_ms": sum(typical.values()),
        "memory_mib": peak_mib() - before_mib,
        "recorded_kib": recorded / 1024 / done.ticks,
        "digest": done.digest,
    }


def peak_mib() -> float:
    """The most memory that this process has had resident."""
    # Of this program alone: getrusage also counts what its parent had as it forked.
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def measured(robots: int, noise_m_std: float, cyclic: bool, turns: int) -> dict[str, Any]:
    """One size, in processes of its own: of several turns the quickest of each part."""
    command = [sys.executable, __file__, "--one", str(robots), "--noise", str(noise_m_std)]
    command += ["--cyclic"] * cyclic
    rows = []
    for _ in range(turns):
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    ms = {part: min(row["ms"][part] for row in rows) for part in rows[0]["ms"]}
    memory_mib = median(row["memory_mib"] for row in rows)
    return rows[0] | {"ms": ms, "total_ms": sum(ms.values()), "memory_mib": memory_mib}


def fitted(sizes: list[int], values: list[float]) -> tuple[float, float, float]:
    """Exponent b of a N^b, half its 95 % interval, and the value at ``WIDEST`` robots."""
    line = linregress(np.log(sizes), np.log(np.maximum(values, 1e-6)))
    half = float(t.ppf(0.975, len(sizes) - 2) * line.stderr)
    return float(line.slope), half, float(np.exp(line.intercept + line.slope * np.log(WIDEST)))


def quickest_ms(action: Callable[[], object], repeats: int = 3) -> float:
    """The quickest of some calls."""
    took = []
    for _ in range(repeats):
        begun = time.process_time()
        action()
        took.append(time.process_time() - begun)
    return 1e3 * min(took)


def parts_alone(robots: int, rings: int) -> dict[str, float]:
    """The parts that arrays decide, on made-up arrays of this size, in ms a round."""
    draw = np.random.default_rng(1)
    positions = draw.uniform(-robots, robots, (robots + 1, 2))
    radii, ranges = np.full(robots + 1, 0.2), np.full(robots + 1, 200.0)
    bearings = 2.0 * np.pi * np.arange(robots) / robots
    ring = 3.0 * np.column_stack((np.cos(bearings), np.sin(bearings)))
    costs = whole_quanta(np.hypot(*np.moveaxis(positions[:-1, None] - ring, -1, 0)))

    def sense() -> None:
        geometry = sensing.geometry(positions, radii, robots + 1)
        sensing.in_sight(geometry, ranges, radii)
        sensing.scan(geometry, ranges, radii, 36)

    radio = channel.Channel(
        1, robots, None, None, None, None, None,
        channel.delay.build([], [f"r{k}" for k in range(robots)], 0.1, 1), False, None, False, None,
    )  # fmt: skip
    state = channel.initial(radio)
    return {
        "world": quickest_ms(sense),
        "channel": quickest_ms(lambda: channel.transmit(radio, state, channel.Sending(0))),
        "assignment": rings * quickest_ms(lambda: linear_sum_assignment(costs), 1),
    }


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Markdown: a row for each size, then the exponents, then 1,000 robots by the fit."""
    parts = list(rows[0]["ms"])
    columns = {part: [row["ms"][part] for row in rows] for part in parts}
    columns["all"] = [row["total_ms"] for row in rows]
    columns["memory"] = [row["memory_mib"] for row in rows]
    columns["recorded"] = [row["recorded_kib"] for row in rows]
    names = [f"{name} (ms)" for name in [*parts, "all"]] + ["memory (MiB)", "recorded (KiB)"]
    lines = [
        "| robots | " + " | ".join(names) + " | rounds/s |",
        "|---|" + "---|" * (len(names) + 1),
    ]
    for index, row in enumerate(rows):
        cells = [f"{values[index]:.3g}" for values in columns.values()]
        lines.append(f"| {row['robots']} | {' | '.join(cells)} | {1e3 / row['total_ms']:.3g} |")
    first = next(k for k, row in enumerate(rows) if row["robots"] >= FITTED_FROM)
    sizes = [row["robots"] for row in rows[first:]]
    fits = [fitted(sizes, values[first:]) for values in columns.values()]
    exponents = [f"{slope:.2f} ± {half:.2f}" for slope, half, _ in fits]
    lines.append(f"| exponent | {' | '.join(exponents)} | |")
    at_widest = [f"{value:.3g}" for _, _, value in fits]
    widest_rate = 1e3 / fits[len(parts)][2]
    lines.append(f"| {WIDEST:,} by the fit | {' | '.join(at_widest)} | {widest_rate:.2g} |")
    return lines


def main() -> None:
    """Measure all sizes and print the table."""
    parser = argparse.ArgumentParser(description="Time and memory by the size of the team.")
    parser.add_argument("--one", type=int, help="measure this size in this process, as JSON")
    parser.add_argument("--noise", type=float, default=0.0, help="of detections, in m")
    parser.add_argument("--cyclic", action="store_true", help="the cheaper assignment")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--most", type=int, default=SIZES[-1], help="the largest team")
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure_here(options.one, options.noise, options.cyclic)))
        return
    sizes = [size for size in SIZES if size <= options.most]
    rows = [measured(size, options.noise, options.cyclic, options.turns) for size in sizes]
    print("\n".join(table(rows)))
    alone = parts_alone(WIDEST, 7)
    shown = ", ".join(f"{part} {ms:,.0f} ms" for part, ms in alone.items())
    print(f"\n{WIDEST:,} robots, parts measured alone: {shown} (assignment: of one view)")


if __name__ == "__main__":
    main()
