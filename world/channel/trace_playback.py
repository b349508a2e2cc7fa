"""Replaying a trace: which of its rows a packet meets.

*Repeat*: the packet of tick k meets row k modulo the trace's length, on every link. *Shifted*: the
same, but each link begins at a row of its own, drawn from the seed; the draw is one for loss and
delay, so that two traces from one recording stay in step. *Resample*: each packet draws a row,
independently, which keeps the recorded distribution and forgets its order. Rows are per tick,
whether or not a packet is sent then, so that a packet's row depends on its link and tick alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encircle.world.random_streams import Purpose, link_uniforms
from encircle.world.scenario.channel_model import Parts, between
from encircle.world.scenario.delay_models import Delay, TraceDelay
from encircle.world.scenario.loss_models import Loss, TraceLoss

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False, slots=True)
class Rows:
    """Rows for some ``links``; a link's are ``length`` of the ``flat`` ones, from ``first`` on.

    All but ``flat`` are (N, N). ``start``: the row that a link's packet of tick 0 meets.
    """

    links: NDArray[np.bool_]
    flat: Floats
    first: Ints
    length: Ints
    start: Ints

    def at(self, tick: Ints | int) -> Floats:
        """What stands in the rows of a tick, (N, N), or of several ticks, (T, 1, 1)."""
        return self.flat[self.first + (self.start + tick) % self.length]

    def by(self, draws: Floats) -> Floats:
        """What stands in the rows that ``draws`` from [0, 1) fall on, for the last two axes' links.

        Where the rows are sorted that is the inverse of their empirical distribution.
        """
        row = np.minimum((draws * self.length).astype(np.int64), self.length - 1)
        return self.flat[self.first + row]


def rows_per_link(
    parts: Parts[Loss] | Parts[Delay], ids: Sequence[str], modes: Sequence[str]
) -> list[tuple[NDArray[np.bool_], list[float | None], str]]:
    """The traces of some modes in a channel: links, values and mode of each set of rows."""
    rows: list[tuple[NDArray[np.bool_], list[float | None], str]] = []
    for _, links, model in parts:
        if isinstance(model, TraceLoss | TraceDelay) and model.mode in modes:
            others = links
            for own in model.links:
                own_link = between(own.sender, own.receiver, ids)
                rows.append((links & own_link, list(own.values), model.mode))
                others = others & ~own_link
            if model.values is not None:
                rows.append((others, list(model.values), model.mode))
    return [of_links for of_links in rows if of_links[0].any()]


def laid_out(
    rows: Sequence[tuple[NDArray[np.bool_], Sequence[float], str]], robots: int, seed: int
) -> Rows | None:
    """Rows per link, one behind the other; None if there are none."""
    if not rows:
        return None
    links = np.zeros((robots, robots), bool)
    first, start = np.zeros((2, robots, robots), np.int64)
    length = np.ones((robots, robots), np.int64)
    shift = link_uniforms(seed, Purpose.TRACE_START, 0, robots)
    flat: list[float] = []
    for own_links, values, mode in rows:
        links |= own_links
        first[own_links], length[own_links] = len(flat), len(values)
        if mode == "shifted":
            row = (shift[own_links] * len(values)).astype(np.int64)
            start[own_links] = np.minimum(row, len(values) - 1)
        flat += values
    return Rows(links, np.array(flat), first, length, start)


def without_gaps(values: Sequence[float | None]) -> list[float]:
    """Delays with each lost packet's filled in by that of the packet received last before it.

    Those before the first received one get its delay.
    """
    last = next(value for value in values if value is not None)
    filled = []
    for value in values:
        last = last if value is None else value
        filled.append(last)
    return filled


def received(values: Sequence[float | None]) -> list[float]:
    """The delays of the packets that were received, ascending."""
    return sorted(value for value in values if value is not None)
