"""Which rows are sampled, evenly over the arms of a study, and what may have escaped the sample.

Every cell has as many runs as there are seeds. A sample takes the same number from each cell, and
one more from some cells, which are drawn, as are the runs within a cell.
"""

from collections.abc import Sequence
from math import exp, inf, lgamma, log

import numpy as np

from encircle.statistics.intervals import CONFIDENCE


def sampled(
    cells: Sequence[int], seeds: Sequence[int], count: int, seed: int
) -> list[tuple[int, int]]:
    """A sample of ``count`` runs (cell, seed), sorted, or all of them if there are no more.

    ``seed`` draws it: the same one draws the same runs.
    """
    total = len(cells) * len(seeds)
    if count >= total:
        return [(cell, own) for cell in cells for own in seeds]
    draws = np.random.default_rng(seed)
    each, rest = divmod(count, len(cells))
    more = set(draws.permutation(len(cells))[:rest].tolist())
    chosen = []
    for index, cell in enumerate(cells):
        order = draws.permutation(len(seeds))[: each + (index in more)]
        chosen += [(cell, seeds[k]) for k in sorted(order.tolist())]
    return chosen


def altered_max(cells: int, seeds: int, count: int) -> int:
    """How many rows may be altered, at most, although a sample of ``count`` shows none of them.

    If more are altered, the sample of ``sampled`` meets at least one of them with a probability of
    95 % or more, wherever they are.
    """
    low, high = 0, cells * seeds
    while low < high:
        middle = (low + high + 1) // 2
        if escape_probability(cells, seeds, count, middle) >= 1.0 - CONFIDENCE:
            low = middle
        else:
            high = middle - 1
    return low


def escape_probability(cells: int, seeds: int, count: int, altered: int) -> float:
    """The largest probability that a sample meets none of ``altered`` rows, over where they are.

    With q = count div C runs from each of C cells of S, and r = count mod C cells with one more,
    it is the product over cells of C(S - k, q) / C(S, q), times the mean over the choices of r
    cells of the product of (S - k - q) / (S - q) in these, where k is a cell's altered rows. Its
    logarithm is concave and symmetric in the k, so that it is largest where they are as even as
    they can be: t cells with k + 1 and the others with k.
    """
    each, rest = divmod(count, cells)
    if each >= seeds:
        return 0.0 if altered else 1.0
    k, t = divmod(altered, cells)
    logs = (cells - t) * _missed(seeds, k, each) if t < cells else 0.0
    logs += t * _missed(seeds, k + 1, each) if t else 0.0
    if logs == -inf:
        return 0.0
    fewer, more = (max(0.0, (seeds - n - each) / (seeds - each)) for n in (k, k + 1))
    terms = [
        exp(_choose(t, j) + _choose(cells - t, rest - j) - _choose(cells, rest))
        * more**j
        * fewer ** (rest - j)
        for j in range(max(0, rest - cells + t), min(t, rest) + 1)
    ]
    return exp(logs) * sum(terms)


def _missed(seeds: int, altered: int, drawn: int) -> float:
    """Log of the chance that ``drawn`` of ``seeds`` runs are none of the altered ones."""
    left = seeds - altered
    return -inf if left < drawn else _choose(left, drawn) - _choose(seeds, drawn)


def _choose(n: int, k: int) -> float:
    """Log of the binomial coefficient."""
    if k in (0, n):
        return 0.0
    return log(n) if k == 1 else lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)
