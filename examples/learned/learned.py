"""A policy that was learned: a small network that looks from the target, the same for every robot.

It gets the numbers of ``encircle.learning.observation`` and turns them into the robot's own frame:
inwards, to the target, and aside, counter-clockwise about it. Of its peers it knows the distances
and bearings as it believes them, so that their order does not matter, nor where north is. A
situation and its mirror image have mirrored answers.

``train.py`` writes this file: the code as it was, and the weights that it has found at the end. So
one file is what learns and what hunts, here or in containers:

    ENCIRCLE_POLICIES=examples/learned encircle run sim1 --set team.strategy=learned.py:learned
"""

from itertools import pairwise
from math import atan2, hypot, pi

import numpy as np

from encircle.learning import decision, observation

STEP, TARGET, PEERS = 1, 3, 12
"""Where its own step, the target and the first peer begin among the numbers."""
PEER_SIZE = 7
MIRROR = (0, 1, 2, 3, 4, 5, 6, 7, 9, 8, 11, 10, 12, 13)
"""Which feature stands where in the mirror: the neighbours on both sides change places."""
SIGNS = (1, 1, 1, 1, -1, 1, -1, 1, 1, 1, 1, 1, 1, 1)
"""Those of what goes aside change there too."""
HIDDEN, FEATURES = 6, len(MIRROR)
FIRST = FEATURES * HIDDEN
SIZE = FIRST + 2 * (FEATURES + HIDDEN)
"""How many weights there are."""
NEAR = 1e-6


def learned(memory, view):
    """Step as the network says; it remembers nothing, and says nothing."""
    return memory, decision(view, act(observation(view), NETWORK))


def network(weights):
    """The layers of a network with weights (SIZE,): the hidden one, and that of the answers.

    The latter (FEATURES + HIDDEN, 2) takes the features too: what is linear is learned fast.
    """
    return weights[:FIRST].reshape(FEATURES, HIDDEN), weights[FIRST:].reshape(-1, 2)


def act(numbers, layers):
    """The action (2,) for an observation."""
    numbers = numbers.tolist()
    tx, ty = numbers[TARGET + 1], numbers[TARGET + 2]
    distance = hypot(tx, ty)
    if distance < NEAR:
        return 0.0, 0.0
    seen = features(numbers, distance)
    mirrored = [sign * seen[place] for sign, place in zip(SIGNS, MIRROR, strict=True)]
    both = np.array([seen, mirrored])
    hidden = product(both, layers[0])
    hidden /= 1.0 + np.abs(hidden)
    answers = product(np.hstack([both, hidden]), layers[1])
    (inward, aside), (mirrored_inward, mirrored_aside) = answers.tolist()
    inward, aside = inward + mirrored_inward, aside - mirrored_aside
    # What is longer than the longest step is as long as that.
    scale = distance * max(1.0, hypot(inward, aside))
    x, y = tx / scale, ty / scale
    return limited(inward * x + aside * y), limited(inward * y - aside * x)


def product(rows, matrix):
    """The matrix product, added up in one order on every machine, which ``@`` is not."""
    return (rows[:, :, None] * matrix).sum(axis=1)


def limited(number):
    """A number that rounding has brought beyond 1 or -1."""
    return max(-1.0, min(1.0, number))


def features(numbers, distance):
    """What the network sees; lengths in sensing ranges, velocities in full speeds."""
    tx, ty = numbers[TARGET + 1], numbers[TARGET + 2]
    vx, vy = numbers[TARGET + 3], numbers[TARGET + 4]
    step_x, step_y = numbers[STEP], numbers[STEP + 1]
    x, y = tx / distance, ty / distance
    ring = sorted(peers(numbers, tx, ty))
    # Alone, the gap to either side is the whole turn.
    left, right = (ring[0], ring[-1]) if ring else ((2.0 * pi, distance), (0.0, distance))
    turns = [0.0, *[turn for turn, _ in ring], 2.0 * pi]
    widest = max([after - before for before, after in pairwise(turns)])
    mean = (distance + sum([far for _, far in ring])) / (1 + len(ring))
    return (
        1.0,
        min(distance, 2.0),
        limited(mean - distance),
        vx * x + vy * y,
        vx * y - vy * x,
        step_x * x + step_y * y,
        step_x * y - step_y * x,
        hypot(vx, vy),
        left[0] / pi - 0.5,
        2.0 - right[0] / pi - 0.5,
        limited(left[1] - distance),
        limited(right[1] - distance),
        widest / pi - 0.5,
        numbers[TARGET + 5],
    )


def peers(numbers, tx, ty):
    """Of each known peer the turn about the target to its bearing, 0 to 2 pi, and its distance."""
    for first in range(PEERS, len(numbers), PEER_SIZE):
        known, x, y = numbers[first : first + 3]
        if known:
            dx, dy = x - tx, y - ty
            turn = atan2(ty * dx - tx * dy, -tx * dx - ty * dy) % (2.0 * pi)
            yield turn, hypot(dx, dy)


# The weights, and how they came about, are train.py's.
# train.py --seed 1 --generations 0 --pairs 16 --hunts 6
WEIGHTS = """
0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
0.5000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000
"""
NETWORK = network(np.array([float(weight) for weight in WEIGHTS.split()]))
