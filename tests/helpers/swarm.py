"""Long swarms: runs and packets by the thousand, shard by shard, with figures in the end.

    python tests/helpers/swarm.py memory --runs 10000       # faulty hunts in memory
    python tests/helpers/swarm.py processes --runs 200      # hunts as processes, struck by signals
    python tests/helpers/swarm.py packets --packets 1000000 # mutated packets to every receiver

From the root of the repository. ``--first`` is the first seed: a shard is a span of seeds. What
fails names its seed and the line that plays it alone, and the swarm goes on; its status is 1 then.
"""

import argparse
import json
import os
import resource
import signal
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
sys.path[:0] = [str(FOLDER.parents[1]), str(FOLDER), str(FOLDER / "processes")]

FRAMES_SHOWN = 4
BY_CLOCK_EVERY = 8
"""Of so many seeds in memory, one is a run by the clock."""
PACKETS_PER_SEED = 10_000
WORKED_S_MAX = 900
"""Processor time after which a seed hangs: the others take a thousandth of it."""

Play = Callable[[int], Counter[str]]
"""What a seed does; returns its figures. It raises what is broken."""


def in_memory(seed: int) -> Counter[str]:
    """One hunt in memory, in lock-step or by a made-up clock, and what it is held to."""
    from helpers_clocked_swarm import checked_by_clock
    from helpers_swarm_checks import checked

    by_clock = seed % BY_CLOCK_EVERY == BY_CLOCK_EVERY - 1
    played = checked_by_clock(seed) if by_clock else checked(seed)
    result, scenario = played.result, played.scenario
    figures = Counter({f"fault: {kind}": count for kind, count in played.faults.items() if count})
    figures += Counter(
        {
            "runs by the clock": int(by_clock),
            "ticks": result.ticks,
            "captured": int(result.captured),
            "packets sent": result.packets_sent,
            "packets copied": result.packets_copied,
            "packets lost": sum(result.packets_lost.values()),
            "packets delivered": result.packets_delivered,
            "packets in flight at the end": result.packets_in_flight,
            "messages refused by the world": sum(result.refused.values()),
            "losses of robots": sum(what != "back" for _, _, what in result.departures),
        }
    )
    figures.update(f"policy: {scenario.strategy_of(robot)}" for robot in scenario.ids)
    figures[f"detections: {scenario.robot.get('detections', 'own')}"] += 1
    figures[f"publish: {scenario.robot.get('publish', 'always')}"] += 1
    return figures


def packets(seed: int) -> Counter[str]:
    """Mutated packets of one recorded run, to every receiver."""
    from helpers_receivers import mutated

    return mutated(seed, PACKETS_PER_SEED)


def over_processes(seed: int) -> Counter[str]:
    """One hunt as processes to which something happens."""
    from helpers_struck import struck

    return struck(seed)


KINDS: dict[str, Play] = {"memory": in_memory, "packets": packets, "processes": over_processes}


def swarm(kind: str, seeds: Iterable[int], say: Callable[[str], None] = print) -> Counter[str]:
    """Play all seeds; returns figures. ``figures["failed"]`` counts what is broken.

    ``say`` gets what is broken, and now and then how far it is.
    """
    play, figures, seeds = KINDS[kind], Counter[str](), list(seeds)
    signal.signal(signal.SIGPROF, _hangs)
    for number, seed in enumerate(seeds, 1):
        signal.setitimer(signal.ITIMER_PROF, WORKED_S_MAX)
        try:
            figures += play(seed)
        except Exception as error:
            figures["failed"] += 1
            said = "".join(traceback.format_exception(error, limit=-FRAMES_SHOWN)).rstrip()
            say(f"{said}\n{kind} seed {seed} is broken; alone: {again(kind, seed)}")
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        figures["seeds"] += 1
        if number % max(1, len(seeds) // 100) == 0 or _stopped:
            say(_progress(kind, number, len(seeds), figures["failed"]))
        if _stopped:
            say(f"{kind}: stopped after seed {seed}")
            break
    return figures


def again(kind: str, seed: int) -> str:
    """The line that plays one seed alone."""
    return f"python tests/helpers/swarm.py {kind} --first {seed} --seeds 1"


def _progress(kind: str, number: int, count: int, failed: int) -> str:
    mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    times = os.times()
    return (
        f"{kind}: {number} of {count} seeds, {failed} broken; {times.elapsed - BEGAN:.0f} s,"
        f" {times.user + times.system:.0f} s of processor time, {mib} MiB at most"
    )


BEGAN = os.times().elapsed


def main(arguments: list[str]) -> int:
    """The command; returns its status."""
    parser = argparse.ArgumentParser(description="Long swarms; see the top of this file.")
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--seeds", "--runs", type=int, dest="count", help="how many seeds")
    parser.add_argument("--packets", type=int, help="how many packets, in place of seeds")
    given = parser.parse_args(arguments)
    count = given.count or (given.packets or PACKETS_PER_SEED) // PACKETS_PER_SEED
    from encircle.world.loading.remarks import ScenarioRemark

    warnings.simplefilter("error")
    warnings.simplefilter("ignore", ScenarioRemark)
    signal.signal(signal.SIGTERM, _stop)
    figures = swarm(given.kind, range(given.first, given.first + count), _say)
    _say(json.dumps(dict(sorted(figures.items())), indent=1))
    return 1 if figures["failed"] else 0


_stopped: list[int] = []


def _stop(number: int, _frame: object) -> None:
    """SIGTERM: the seed that is under way is the last one."""
    _stopped.append(number)


def _hangs(_number: int, _frame: object) -> None:
    raise AssertionError(f"it has worked for {WORKED_S_MAX} s, and is not at its end")


def _say(line: str) -> None:
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
