"""What looking on costs a hunt: ``python bench/onlooking.py [ROUNDS] [REPEATS] [PACE]``.

Hunts of four robots as processes, as fast as they can or PACE times faster than real time, one
after the other in turns: with nobody
there and states alone published (as it was before viewers heard more), with nobody there, with
``encircle watch`` that shows the hunt, with one that is stopped (SIGSTOP), killed in mid-run, or
whose page floods it. Prints one JSON object: medians of rounds per second, of the world's processor
time per round in us, and whether all digests are one.
"""

import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from tornado.ioloop import IOLoop
from tornado.websocket import websocket_connect

from encircle.runner.launch import free_endpoint

SCENARIO = {
    "team": {"robots": 4, "sensing_range_m": 500.0},
    "target": {
        "behaviour": "patrol",
        "parameters": {"waypoints": [[60, 0], [60, 60], [0, 60], [0, 0]]},
        "step_m_max": 0.5,
    },
}
WITHOUT_RADIO = """
from encircle.world.coordinator.journal import Journal
note = Journal.note_answers
def note_states_alone(journal, *given):
    journal.publishes = False
    note(journal, *given)
    journal.publishes = True
Journal.note_answers = note_states_alone
"""
WORLD = """
import os, sys
{patch}
from encircle.world.__main__ import main
status = main()
times = os.times()
print('{{"cpu_s": %f}}' % (times.user + times.system), flush=True)
os._exit(status)
"""
ARMS = ("states alone", "nobody", "shown", "stopped", "killed", "flooded")


def start(*words: Any, **streams: Any) -> "subprocess.Popen[str]":
    """A Python process."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, *map(str, words)], text=True, env=environment, **streams
    )


def flood(address: str, over: threading.Event) -> None:
    """Send nonsense to the page's server, on a new connection whenever it has enough of it."""

    async def send() -> None:
        while not over.is_set():
            try:
                feed = await websocket_connect(address.replace("http", "ws", 1) + "feed")
                while not over.is_set() and feed.close_code is None:
                    await feed.write_message('{"x": "' + 1000 * "y" + '"}')
                feed.close()
            except Exception:
                time.sleep(0.01)

    IOLoop().run_sync(send)


def hunt(arm: str, folder: Path, pace: int | None) -> dict[str, Any]:
    """One hunt; what its world says of it."""
    endpoint = free_endpoint()
    code = WORLD.format(patch=WITHOUT_RADIO if arm == "states alone" else "")
    where = ("--listen", endpoint, "--run", "b", "--json")
    where += () if pace is None else ("--pace", str(pace))
    world = start("-c", code, folder / "scenario.json", *where, stdout=-1, stderr=-3)
    viewer, over = None, threading.Event()
    if arm in ("shown", "stopped", "killed", "flooded"):
        shown = ("--connect", endpoint, "--run", "b", "--no-browser", "--watch-end", "run")
        viewer = start("-m", "encircle", "watch", *shown, stderr=-1)
        assert viewer.stderr is not None
        address = viewer.stderr.readline().split()[-1]
        if arm == "stopped":
            viewer.send_signal(signal.SIGSTOP)
        if arm == "flooded":
            threading.Thread(target=flood, args=(address, over), daemon=True).start()
    ours = ("--connect", endpoint, "--run", "b", "--quiet")
    robots = [start("-m", "encircle.agents", f"r{k}", *ours) for k in range(1, 5)]
    found: dict[str, Any] = {}
    assert world.stdout is not None
    for line in world.stdout:
        report = json.loads(line)
        if report.get("tick", 0) > 0 and viewer is not None and arm == "killed":
            viewer.kill()
        found |= report.get("result", {}) | {"cpu_s": report.get("cpu_s")}
    over.set()
    if viewer is not None:
        viewer.kill()
    for process in (*robots, world, *([viewer] if viewer else [])):
        process.wait()
        for stream in (process.stdout, process.stderr):
            if stream is not None:
                stream.close()
    return found


def main(rounds: int = 1000, repeats: int = 3, pace: int | None = None) -> None:
    """Measure all arms in turns."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scenario.json").write_text(json.dumps(SCENARIO | {"ticks_max": rounds}))
        found = {arm: [] for arm in ARMS}
        for repeat in range(repeats):
            for arm in ARMS if repeat % 2 == 0 else ARMS[::-1]:
                found[arm].append(hunt(arm, folder, pace))
    print(
        json.dumps(
            {
                "rounds_per_s": {
                    arm: round(statistics.median(rounds / one["rounds_s"] for one in hunts))
                    for arm, hunts in found.items()
                },
                "world_us_per_round": {
                    arm: round(statistics.median(1e6 * one["cpu_s"] / rounds for one in hunts))
                    for arm, hunts in found.items()
                },
                "digests": len({one["digest"] for hunts in found.values() for one in hunts}),
                "departures": sum(len(one["departures"]) for h in found.values() for one in h),
            }
        )
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
