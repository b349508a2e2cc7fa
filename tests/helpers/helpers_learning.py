"""A policy that does something that depends on every number it observes, and hunts with it."""

import numpy as np

import encircle
from encircle.learning import parallel_env

PAYLOAD = 3
POLICY = """
from helpers_learning import answer


def mixing(memory, view):
    return memory, answer(view)
"""
NAME = "mixing.py:mixing"


def mixed(numbers):
    """An action (2 + PAYLOAD,) that another number anywhere in an observation would change."""
    numbers = np.asarray(numbers, float)
    rows = np.arange(2 + PAYLOAD)[:, None]
    weights = ((7 * rows + 3) * (np.arange(len(numbers)) + 2) % 11 - 5) / 5
    sums = (weights * numbers).sum(axis=1)
    return sums / (1.0 + np.abs(sums))


def answer(view):
    """The policy's decision."""
    from encircle.learning import decision, observation

    return decision(view, mixed(observation(view, payload=PAYLOAD, scan=True)))


def played(scenario, seed, agents=None):
    """An episode to its end with the same actions: what the last step returned, by agent."""
    env = parallel_env(scenario, agents=agents, payload=PAYLOAD, scan=True)
    observations, _ = env.reset(seed=seed)
    last = None
    while env.agents:
        last = env.step({agent: mixed(observations[agent]) for agent in env.agents})
        observations = last[0]
    return last


def run_of(scenario, seed):
    """The hunt of ``encircle.run``."""
    return encircle.run(scenario, seed=seed, link="memory")
