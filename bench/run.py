"""``make bench``: the speeds that the README quotes, as tables and as JSON.

Ratios are taken within one run, in turns, so that both sides meet the same machine. Nothing else
should be running: with more than two busy processes on two cores the figures mean little.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from decisions import measure as measure_decisions
from floor import measure_floor
from learning_speed import measure_learning
from realtime import RATES_HZ, measure_real_time
from rich.console import Console
from rich.table import Table
from scenarios import endless_hunt, ordinary_hunt
from start_up import measure_start_up
from studies import measure_studies
from wide import SIZES, measured

from encircle.progress import Progress, Tell
from encircle.runner.hunts import run
from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.loading.load import load
from encircle.world.recording.run_directory import versions

HERE = Path(__file__).parent
TURNS = 3
PAIRS = 3
ORDINARY_TURNS = 3
MANY = 16
STARTS = 5


def message_sizes(robots: int) -> tuple[int, int, int]:
    """Median bytes of an observation, a pose and a command of the endless hunt."""
    sizes: dict[str, list[int]] = {"observation": [], "pose": [], "command": []}

    def note(_tick: int, key: str, payload: bytes) -> None:
        channel = key.rsplit("/", 1)[1]
        if channel in sizes:
            sizes[channel].append(len(payload))

    arena = engine.build(load(endless_hunt(robots, 60)), 1)
    run_in_memory(arena, "bench-0123456789ab", print, note)
    return tuple(int(median(sizes[name])) for name in sizes)  # type: ignore[return-value]


def told(arguments: list[str], python: str = sys.executable) -> dict[str, float]:
    """Run a program that prints one JSON object."""
    done = subprocess.run([python, *arguments], capture_output=True, text=True, timeout=300)
    if done.returncode != 0:
        raise SystemExit(f"{arguments[0]} failed:\n{done.stderr}")
    answer: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return answer


def lock_step(robots: int, rounds: int, peers: str | None, tell: Tell) -> dict[str, Any]:
    """(a) rounds per second of the hunt, of the bare barrier and of mango's.

    The hunt twice: a process for each robot, and half of the robots in a process.
    """
    sizes = message_sizes(robots)
    hunts, shared, bare, looped, mango = [], [], [], [], []
    for turn in range(TURNS):
        tell(turn, TURNS)
        numbers = [str(n) for n in (robots, rounds, *sizes)]
        barrier = [str(HERE / "barrier.py"), "world"]
        bare.append(told([*barrier, "robot", *numbers])["rounds_per_s"])
        looped.append(told([*barrier, "asyncio-robot", *numbers])["rounds_per_s"])
        for together, speeds in ((1, hunts), (robots // 2, shared)):
            with tempfile.TemporaryDirectory() as scratch:
                hunt = run(
                    endless_hunt(robots, rounds),
                    out=Path(scratch) / "run",
                    robots_per_process=together,
                )
            speeds.append(hunt.result.ticks / hunt.timing["rounds_s"])
        if peers:
            script = str(HERE / "peers" / "mango_barrier.py")
            mango.append(told([script, str(robots), str(rounds)], peers)["rounds_per_s"])
    return {
        "robots": robots,
        "message_bytes": dict(zip(("observation", "pose", "command"), sizes, strict=True)),
        "hunt_rounds_per_s": median(hunts),
        "bare_rounds_per_s": median(bare),
        "bare_asyncio_rounds_per_s": median(looped),
        "ratio_to_bare": _median_ratio(hunts, bare),
        "two_processes_rounds_per_s": median(shared),
        "two_processes_ratio_to_bare": _median_ratio(shared, bare),
        "mango_rounds_per_s": median(mango) if mango else None,
        "ratio_to_mango": _median_ratio(hunts, mango) if mango else None,
        "two_processes_ratio_to_mango": _median_ratio(shared, mango) if mango else None,
    }


def _median_ratio(speeds: Sequence[float], others: Sequence[float]) -> float:
    """The median of the turns' ratios."""
    return median(speed / other for speed, other in zip(speeds, others, strict=True))


def in_memory(robots: int, ticks: int, peers: str | None, tell: Tell) -> dict[str, Any]:
    """(b) ticks per second on one core: an endless hunt, ordinary hunts, MPE2's bare physics."""
    endless, ordinary, physics = [], [], []
    arena = engine.build(load(endless_hunt(robots, ticks)), 1)
    several = [engine.build(load(ordinary_hunt(robots)), seed) for seed in range(5)]
    # One pass takes 0.1 s with four robots, too short for a figure that can be repeated.
    passes = ORDINARY_TURNS if robots < MANY else 1
    for turn in range(TURNS):
        tell(turn, TURNS)
        # One right after the other: the machine's own speed may be another some seconds later.
        for _ in range(PAIRS):
            begun = time.perf_counter()
            run_in_memory(arena, "bench", print)
            endless.append(ticks / (time.perf_counter() - begun))
            if peers:
                script = str(HERE / "peers" / "mpe2_physics.py")
                physics.append(told([script, str(robots), str(ticks)], peers)["steps_per_s"])
        for _ in range(passes):
            begun = time.perf_counter()
            done = sum(run_in_memory(one, "bench", print).ticks for one in several)
            ordinary.append(done / (time.perf_counter() - begun))
    return {
        "robots": robots,
        "endless_ticks_per_s": median(endless),
        "ordinary_ticks_per_s": median(ordinary),
        "mpe2_physics_steps_per_s": median(physics) if physics else None,
        "ratio_to_mpe2": _median_ratio(endless, physics) if physics else None,
    }


def machine() -> dict[str, Any]:
    """What these figures were measured on."""
    models = [
        line.split(":", 1)[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    return {"cpu": models[0] if models else platform.machine(), "cores": os.cpu_count()}


def told_of(name: str, measure: Callable[[Tell], dict[str, Any]]) -> dict[str, Any]:
    """Measure something by turns, and show on standard error how far that is."""
    with Progress(name, "turns") as tell:
        return measure(tell)


def show(title: str, rows: list[dict[str, Any]]) -> None:
    """One table on the terminal."""
    table = Table(title=title, title_justify="left")
    for name in rows[0]:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*(shown(value) for value in row.values()))
    Console(width=150).print(table)


def shown(value: Any) -> str:
    """A value of a table."""
    if isinstance(value, float):
        return f"{value:,.2f}" if abs(value) < 100 else f"{value:,.0f}"
    if isinstance(value, dict):
        return ", ".join(f"{k} {v}" for k, v in value.items())
    if isinstance(value, list):
        return ", ".join(shown(v) for v in value)
    return "-" if value is None else str(value)


def main() -> None:
    """Measure everything, print the tables, write the JSON."""
    parser = argparse.ArgumentParser(description="Measure what the README quotes.")
    parser.add_argument("--json", type=Path, default=Path("bench/results.json"))
    parser.add_argument("--peers", help="a Python that has mango-agents and mpe2, to compare with")
    parser.add_argument("--quick", action="store_true", help="small numbers, to see that it works")
    options = parser.parse_args()
    rounds, ticks = (100, 100) if options.quick else (1500, 1000)
    report: dict[str, Any] = {"machine": machine(), "versions": versions()}
    starts = 1 if options.quick else STARTS
    report["d_start"] = told_of("(d) start", partial(measure_start_up, starts))
    show("(d) start", [report["d_start"]])
    report["a_lock_step"] = [
        told_of(f"(a) lock-step, {n} robots", partial(lock_step, n, r, options.peers))
        for n, r in ((4, rounds), (16, rounds // 2))
    ]
    show("(a) lock-step rounds per second over Zenoh", report["a_lock_step"])
    report["b_in_memory"] = [
        told_of(f"(b) in memory, {n} robots", partial(in_memory, n, t, options.peers))
        for n, t in ((4, ticks), (16, ticks // 3), (64, ticks // 20))
    ]
    show("(b) ticks per second in memory, one core", report["b_in_memory"])
    with Progress("(c) decisions", "teams") as tell:
        teams = (4, 8, 16, 64)
        report["c_decisions"] = []
        for done, n in enumerate(teams):
            tell(done, len(teams))
            report["c_decisions"].append(measure_decisions(n))
    show("(c) one robot's decision", report["c_decisions"])
    report["e_studies"] = measure_studies(1 if options.quick else 8)
    show("(e) studies", [report["e_studies"]])
    turn = (2.0, 1) if options.quick else (10.0, TURNS)
    report["f_real_time"] = [measure_real_time(rate_hz, *turn) for rate_hz in RATES_HZ]
    show("(f) a world by the clock with 4 robots, beside a bare loop", report["f_real_time"])
    steps, turns = (100, 1) if options.quick else (2000, TURNS)
    report["g_learning"] = [
        measure_learning(n, s, options.peers, turns) for n, s in ((4, steps), (16, steps // 4))
    ]
    show("(g) steps per second of the learning environment, one core", report["g_learning"])
    report["h_floor"] = [measure_floor(64, options.peers, turns)]
    show(
        "(h) 64 robots in memory, ms a round, beside the assignments that they solve",
        report["h_floor"],
    )
    widths = SIZES[:4] if options.quick else SIZES
    report["i_wide"] = [measured(n, 0.0, False, 1) for n in widths]
    columns = ("robots", "total_ms", "memory_mib", "recorded_kib")
    rows = [{**{c: row[c] for c in columns}, **row["ms"]} for row in report["i_wide"]]
    show("(i) ms a round, MiB, KiB a round, and ms by part, by the size of the team", rows)
    options.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    print(f"written to {options.json}")


if __name__ == "__main__":
    main()
