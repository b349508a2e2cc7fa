"""How long programs take to start, as ratios to what cannot be done without, and what robots weigh.

The measure is a fresh interpreter that imports numpy and ``scipy.optimize``: everything here needs
at least that. It is taken in turns with the commands, so that both sides meet the same machine.

    python bench/start_up.py [TURNS]
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from scenarios import endless_hunt, ordinary_hunt

from encircle.progress import Progress, Tell
from encircle.runner.hunts import run
from encircle.runner.launch import Timeouts
from encircle.runner.nodes import close_fork_servers

TURNS = 5
MANY = 64
MANY_TICKS_MAX = 3000
BARE = "import numpy, scipy.optimize"
BY_HAND = """
import sys, time
begun = time.perf_counter()
import encircle.agents.process.robot
print(time.perf_counter() - begun)
sys.path.insert(0, sys.argv[1])
from start_up import memory_mib
print(*memory_mib("self"))
"""
PROGRAM = str(Path(sys.executable).parent / "encircle")
PATIENT = Timeouts(join_s_max=600.0, answer_s_max=60.0)


def measure_start_up(turns: int, tell: Tell) -> dict[str, Any]:
    """All of it. Ratios are medians of the turns' own."""
    times: dict[str, list[float]] = {}
    for turn in range(turns):
        tell(turn, turns + 2)
        bare_s = seconds_of(sys.executable, "-c", BARE)
        times.setdefault("bare_s", []).append(bare_s)
        for name, measure in COMMANDS.items():
            times.setdefault(name, []).append(measure() / bare_s)
    tell(turns, turns + 2)
    by_hand = robot_by_hand()
    forked = forked_robots(4)
    tell(turns + 1, turns + 2)
    bare_s = seconds_of(sys.executable, "-c", BARE)
    many = many_robots(bare_s)
    return {
        **{f"{name}{'' if name == 'bare_s' else '_ratio'}": median(v) for name, v in times.items()},
        "robot_by_hand": by_hand,
        "robot_forked": forked,
        f"robots_{MANY}": many,
    }


def seconds_of(*command: str) -> float:
    """How long a command takes to its end."""
    begun = time.perf_counter()
    subprocess.run(command, capture_output=True, check=True)
    return time.perf_counter() - begun


def first_tick_s() -> float:
    """From the command line of ``encircle run sim1`` to the world's first tick."""
    with tempfile.TemporaryDirectory() as scratch:
        begun = time.time()
        command = [PROGRAM, "run", "sim1", "--json", "--out", str(Path(scratch) / "run")]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(json.loads(done.stdout)["begun_unix_s"] - begun)


def memory_run_s() -> float:
    """``encircle run sim1 --link memory`` to its end, with its recording and its picture."""
    with tempfile.TemporaryDirectory() as scratch:
        out = str(Path(scratch) / "run")
        return seconds_of(PROGRAM, "run", "sim1", "--link", "memory", "--out", out)


COMMANDS: dict[str, Callable[[], float]] = {
    "first_tick": first_tick_s,
    "run_in_memory": memory_run_s,
    "list_of_studies": lambda: seconds_of(PROGRAM, "study"),
    "list_of_scenarios": lambda: seconds_of(PROGRAM, "scenarios"),
}


def robot_by_hand() -> dict[str, float]:
    """Import time in s, resident and private memory in MiB of a robot in an interpreter its own."""
    command = [sys.executable, "-c", BY_HAND, str(Path(__file__).parent)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return dict(zip(("import_s", "rss_mib", "uss_mib"), map(float, said), strict=True))


def forked_robots(robots: int) -> dict[str, float]:
    """What a forked robot weighs in the middle of a hunt, and how soon it has joined.

    ``joined_s``: from the world's readiness to the last robot's, the fork server being there.
    """
    weights: dict[str, tuple[float, float]] = {}
    pids: dict[str, int] = {}

    def note(report: dict[str, Any]) -> None:
        pids.update(report.get("started", {}))
        if report.get("tick", 0) > 0:
            for name in pids.keys() - {"world"}:
                try:
                    weights[name] = max(memory_mib(str(pids[name])), weights.get(name, (0.0, 0.0)))
                except OSError:
                    continue  # it has ended

    hunt = run(endless_hunt(robots, 1500), progress=note)
    return {
        "joined_s": hunt.timing["joined_s"],
        "rss_mib": max(rss for rss, _ in weights.values()),
        "uss_mib": max(uss for _, uss in weights.values()),
    }


def memory_mib(process: str) -> tuple[float, float]:
    """Resident and private memory of a process in MiB, from Linux's ``smaps_rollup``."""
    lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()[1:]
    kib = {name: int(rest.split()[0]) for name, _, rest in (x.partition(":") for x in lines)}
    return kib["Rss"] / 1024, (kib["Private_Clean"] + kib["Private_Dirty"]) / 1024


def many_robots(bare_s: float) -> dict[str, Any]:
    """So many robot processes that hunt to a capture, from nothing: how soon all have joined.

    The time runs from before the fork server is there to the world's first tick.
    """
    close_fork_servers()
    scenario = {
        **ordinary_hunt(MANY),
        "ticks_max": MANY_TICKS_MAX,
        "capture": {"count": 4},
        "target": {"step_m_max": 0.1},
    }
    begun = time.time()
    hunt = run(scenario, timeouts=PATIENT)
    joined_s = hunt.timing["begun_unix_s"] - begun
    return {
        "joined_s": joined_s,
        "joined_ratio": joined_s / bare_s,
        "captured": hunt.captured,
        "ticks": hunt.result.ticks,
        "lost": len(hunt.result.departures),
    }


def main() -> None:
    """Measure, and print JSON."""
    turns = int(sys.argv[1]) if len(sys.argv) > 1 else TURNS
    with Progress("start-up", "turns") as tell:
        print(json.dumps(measure_start_up(turns, tell), indent=2))


if __name__ == "__main__":
    main()
