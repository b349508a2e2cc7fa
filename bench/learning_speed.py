"""Steps per second of the learning environment, beside MPE2's simple_tag with as many pursuers.

    .venv/bin/python bench/learning_speed.py --peers .venv-bench/bin/python

A step of the environment is a tick of the whole laboratory: sensing, packets encoded and put on a
lossy channel, everybody's filter, the digest. A step of simple_tag is physics. The two take turns,
so that both meet the same machine; beside them, ticks of hunts whose policy hardly thinks say what
the environment itself costs.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

from encircle.learning import parallel_env
from encircle.runner.memory import run_in_memory
from encircle.world.arena import engine
from encircle.world.loading.load import load

HERE = Path(__file__).parent
TURNS = 5
LOSS = {"loss": {"model": "bernoulli", "rate": 0.5}}


def scene(robots: int, ticks: int) -> dict[str, Any]:
    """A hunt that nobody who only heads for the target ends: a capture takes them all around it."""
    return {
        "ticks_max": ticks,
        "team": {"robots": robots, "strategy": "pursuit"},
        "target": {"step_m_max": 0.3},
        "channel": LOSS,
    }


def environment_steps_per_s(robots: int, steps: int) -> float:
    """Steps per second of episodes under the loss, with the same actions at every step."""
    env, done, spent_s = parallel_env(scene(robots, steps)), 0, 0.0
    while done < steps:
        env.reset()
        actions = dict.fromkeys(env.agents, (0.3, 0.1))
        begun = time.perf_counter()
        while env.agents and done < steps:
            env.step(actions)
            done += 1
        spent_s += time.perf_counter() - begun
    return steps / spent_s


def run_ticks_per_s(robots: int, ticks: int) -> float:
    """Ticks per second of the same hunts in memory, with the shipped policy that thinks least."""
    scenario, done, seed = load(scene(robots, ticks)), 0, 0
    begun = time.perf_counter()
    while done < ticks:
        seed += 1
        done += run_in_memory(engine.build(scenario, seed), "bench", print).ticks
    return done / (time.perf_counter() - begun)


def simple_tag_steps_per_s(robots: int, steps: int, python: str) -> float:
    """Steps per second of simple_tag, in a process of its own."""
    command = [python, str(HERE / "peers" / "mpe2_physics.py"), str(robots), str(steps)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    told: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return told["steps_per_s"]


def measure_learning(
    robots: int, steps: int, peers: str | None, turns: int = TURNS
) -> dict[str, Any]:
    """Medians over turns of all three, and of the ratio within a turn."""
    own, runs, tags = [], [], []
    for _ in range(turns):
        own.append(environment_steps_per_s(robots, steps))
        runs.append(run_ticks_per_s(robots, steps))
        if peers:
            tags.append(simple_tag_steps_per_s(robots, steps, peers))
    return {
        "robots": robots,
        "environment_steps_per_s": median(own),
        "pursuit_ticks_per_s": median(runs),
        "simple_tag_steps_per_s": median(tags) if tags else None,
        "ratio_to_simple_tag": median(o / t for o, t in zip(own, tags, strict=True))
        if tags
        else None,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Speed of the learning environment.")
    parser.add_argument("--peers", help="a Python that has mpe2, to compare with")
    parser.add_argument("--steps", type=int, default=2000)
    options = parser.parse_args()
    for count in (4, 16):
        row = measure_learning(count, options.steps * 4 // count, options.peers)
        sys.stdout.write(json.dumps(row) + "\n")
