"""How punctual the world is by the clock, with four robot processes that hear each other.

    python bench/realtime.py

Jitter is how long after a tick's deadline the world woke up; a miss is a tick that was not done by
the next deadline. The bare loop waits for the same deadlines in the same way, in this process, and
does nothing else: it is what the machine and Python alone make of it. Both take turns.
"""

import argparse
import json
import time
from statistics import median
from typing import Any

from scenarios import endless_hunt

from encircle.progress import Progress
from encircle.protocol.mailbox import Mailbox
from encircle.runner.hunts import run
from encircle.world.coordinator.deadlines import DeadlineStatistics, next_deadline

ROBOTS = 4
RATES_HZ = (50, 100)
TURNS = 3
SECONDS = 10.0


def bare_loop(rate_hz: int, seconds: float) -> dict[str, float]:
    """The punctuality of a loop that does nothing but wait for its deadlines."""
    mail, punctuality, tick_s = Mailbox(), DeadlineStatistics(), 1.0 / rate_hz
    start_s, slot = time.monotonic(), 0
    while slot * tick_s < seconds:
        following = next_deadline(slot, time.monotonic() - start_s, tick_s)
        punctuality.add_advance(following - slot)
        slot = following
        while (left_s := start_s + slot * tick_s - time.monotonic()) > 0.0:
            mail.take(left_s)
        punctuality.add_lateness(time.monotonic() - start_s - slot * tick_s)
    return punctuality.as_dict()


def hunt(rate_hz: int, seconds: float) -> dict[str, Any]:
    """The punctuality of a hunt's world, and how many commands came too late."""
    changes = ["clock=wall", "radio=direct", f"tick_s={1.0 / rate_hz!r}"]
    done = run(endless_hunt(ROBOTS, int(seconds * rate_hz)), overrides=changes)
    found: dict[str, Any] = done.timing["real_time"]
    late = sum(counts["late"] for counts in found["robots"].values())
    return {**found, "commands_late": late, "commands": ROBOTS * found["ticks"]}


def measure_real_time(rate_hz: int, seconds: float = SECONDS, turns: int = TURNS) -> dict[str, Any]:
    """(f) misses in all turns together, jitter as the median of the turns."""
    bare, hunts = [], []
    with Progress(f"(f) real time at {rate_hz} Hz", "turns") as tell:
        for turn in range(turns):
            tell(turn, turns)
            bare.append(bare_loop(rate_hz, seconds))
            hunts.append(hunt(rate_hz, seconds))
    found: dict[str, Any] = {"rate_hz": rate_hz, "ticks": sum(each["ticks"] for each in hunts)}
    for name, each in (("hunt", hunts), ("bare", bare)):
        found[f"{name}_misses"] = sum(one["overruns"] for one in each)
        found[f"{name}_skipped"] = sum(one["deadlines_skipped"] for one in each)
        for quantile in ("median", "p99"):
            jitter_s = median(one[f"jitter_s_{quantile}"] for one in each)
            found[f"{name}_jitter_us_{quantile}"] = jitter_s * 1e6
    found["late_commands"] = sum(one["commands_late"] for one in hunts)
    found["commands"] = sum(one["commands"] for one in hunts)
    return found


def main() -> None:
    """Measure and print as JSON."""
    parser = argparse.ArgumentParser(description="Measure how punctual a world by the clock is.")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each turn")
    parser.add_argument("--turns", type=int, default=TURNS)
    options = parser.parse_args()
    for rate_hz in RATES_HZ:
        print(json.dumps(measure_real_time(rate_hz, options.seconds, options.turns), indent=2))


if __name__ == "__main__":
    main()
