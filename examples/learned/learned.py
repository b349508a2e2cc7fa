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
# train.py --seed 1 --generations 50 --pairs 10 --hunts 4
WEIGHTS = """
-0.4286 0.6194 0.1645 0.0574 -0.5564 -0.2232 -0.8713 0.3396 0.0502 0.2986 0.0584 0.4341 -0.5262
0.6487 0.2914 0.7185 0.3867 0.1541 -0.2437 -0.2121 -0.2979 -0.0987 -0.5408 0.6943 -0.7518 0.2668
0.1846 -0.0681 -0.1194 -0.0946 0.1614 -0.2838 0.1864 0.8035 -0.1787 -0.1670 -0.3894 0.5063 0.4446
-0.1385 -0.7592 -0.4631 -0.2972 0.8747 0.0243 -0.1135 -0.3275 -0.1067 0.2976 -0.1474 0.4302
-0.1177 -0.2849 -0.2343 0.7400 -0.6002 -0.0556 0.1194 0.2487 -0.4040 0.4708 -0.1383 0.4530 -0.0255
0.6051 0.9072 -0.0767 -0.3283 -0.1114 0.6635 -0.3295 0.3333 -0.0759 0.7520 -0.0455 -0.6785 -0.3342
-0.4601 -0.2134 -0.3552 0.3332 -0.3572 0.1835 0.2225 0.1941 0.2423 0.4547 0.2508 0.2369 0.3184
0.1674 0.0978 0.9742 1.1642 0.0619 -0.4910 -0.4554 0.6721 0.2351 -0.1948 -1.0005 0.8925 0.0440
-0.9812 0.3871 -1.0412 -0.7941 -0.1042 -0.1995 0.4863 0.2445 0.0247 0.2304 -0.1138 0.2827 0.2198
0.3216 0.9549 -0.2295 -0.3698 -0.3763 0.3095 -0.3530 0.6150
"""
NETWORK = network(np.array([float(weight) for weight in WEIGHTS.split()]))
