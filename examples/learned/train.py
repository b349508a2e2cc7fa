"""Train the policy of ``learned.py`` by an evolution strategy, and write it with its new weights.

    python examples/learned/train.py --out learned_again.py

In each generation pairs of networks, one to either side of the mean, hunt on the same few seeds;
the mean then moves along the differences, weighted by the ranks of what each reached (Salimans and
others, "Evolution strategies as a scalable alternative to reinforcement learning", 2017; steps by
Adam). The first mean heads straight for the target. What counts is the sum of the environment's
rewards, undiscounted, with a price on each tick.

Everything follows from the seed: the same one gives the same file, with however many workers.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from importlib.util import module_from_spec, spec_from_file_location
from multiprocessing import get_context
from pathlib import Path
from textwrap import fill

import numpy as np

from encircle.learning import parallel_env
from encircle.protocol.process.log import say, say_error

HERE = Path(__file__).parent
MARK = "# The weights, and how they came about, are train.py's.\n"
SCENE = HERE / "scene.toml"
REWARD = {"capture": 10.0, "tick": 0.02, "near": 1.0, "around": 1.0, "discount": 1.0}
SEEDS = range(1, 1001)
"""Those that it is trained on; what it can do is to be told of others."""
SPREAD, RATE, DECAYS, DIGITS = 0.15, 0.08, (0.9, 0.99), 4


@cache
def code(path):
    """The module in a policy's file."""
    spec = spec_from_file_location("learned_code", path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def environment():
    """One environment in each process."""
    return parallel_env(SCENE, reward=REWARD)


def reached(path, weights, seeds):
    """Mean over seeds of the sum of rewards, and the share of captures."""
    env, act, layers = environment(), code(path).act, code(path).network(weights)
    total = captures = 0.0
    for seed in seeds:
        observations, _ = env.reset(seed=seed)
        while env.agents:
            actions = {agent: act(seen, layers) for agent, seen in observations.items()}
            observations, rewards, terminated, _, _ = env.step(actions)
            total += rewards["r1"]
        captures += terminated["r1"]
    return total / len(seeds), captures / len(seeds)


def ranked(values):
    """Values as their ranks, evenly from -0.5 to 0.5."""
    ranks = np.empty(len(values))
    ranks[np.argsort(values, kind="stable")] = np.arange(len(values))
    return ranks / (len(values) - 1) - 0.5


def train(path, options, hunt):
    """The weights after all generations. ``hunt``: ``map`` of a pool, or Python's own."""
    size = code(path).SIZE
    draws = np.random.default_rng(options.seed)
    mean, slope, square = np.zeros(size), np.zeros(size), np.zeros(size)
    # How far inwards whatever is seen: half of it, and half in the mirror.
    mean[code(path).FIRST] = 0.5
    for generation in range(1, options.generations + 1):
        aside = draws.standard_normal((options.pairs, size))
        seeds = draws.choice(SEEDS, options.hunts, replace=False).tolist()
        tried = np.concatenate([mean + SPREAD * aside, mean - SPREAD * aside])
        results = list(hunt(partial(reached, path, seeds=seeds), tried))
        weights = ranked(np.array([value for value, _ in results]))
        better = weights[: options.pairs] - weights[options.pairs :]
        pulled = (better[:, None] * aside).sum(axis=0) / options.pairs
        slope = DECAYS[0] * slope + (1 - DECAYS[0]) * pulled
        square = DECAYS[1] * square + (1 - DECAYS[1]) * pulled**2
        unbiased = slope / (1 - DECAYS[0] ** generation)
        scale = np.sqrt(square / (1 - DECAYS[1] ** generation)) + 1e-8
        rate = RATE * (1.0 - 0.9 * generation / options.generations)
        mean = mean + rate * unbiased / scale
        value, captured = np.mean(results, axis=0)
        say(f"generation {generation}: {value:.2f} in the mean, {captured:.0%} captured")
    return mean


def with_weights(text, weights, command):
    """The file's text with other weights, and the command that they come from."""
    before, mark, _ = text.partition(MARK)
    rounded = [f"{weight:.{DIGITS}f}" for weight in weights]
    numbers = fill(" ".join(rounded), 98, break_on_hyphens=False)
    return (
        f'{before}{mark}# {command}\nWEIGHTS = """\n{numbers}\n"""\n'
        "NETWORK = network(np.array([float(weight) for weight in WEIGHTS.split()]))\n"
    )


def main(arguments):
    """Train and write; the exit status."""
    parser = argparse.ArgumentParser(description="Train the policy of learned.py.")
    parser.add_argument("--out", type=Path, required=True, help="the file to write, a new one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--generations", type=int, default=50)
    parser.add_argument("--pairs", type=int, default=10, help="pairs of networks in a generation")
    parser.add_argument("--hunts", type=int, default=4, help="hunts of each network")
    parser.add_argument("--workers", type=int, default=2, help="processes that hunt")
    options = parser.parse_args(arguments)
    if options.out.exists():
        say_error(f"--out {options.out}: is there already; name a new file")
        return 2
    if not options.out.parent.is_dir():
        say_error(f"--out {options.out}: {options.out.parent} is no directory")
        return 2
    path = HERE / "learned.py"
    if options.workers == 1:
        weights = train(path, options, map)
    else:
        with ProcessPoolExecutor(options.workers, get_context("spawn")) as pool:
            weights = train(path, options, pool.map)
    numbers = ("seed", "generations", "pairs", "hunts")
    command = " ".join(f"--{name} {getattr(options, name)}" for name in numbers)
    text = with_weights(path.read_text(), weights, f"train.py {command}")
    with options.out.open("x") as file:
        file.write(text)
    say(f"written to {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
