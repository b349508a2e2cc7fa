"""Scheduled outages: links that lose everything sent in some ticks, by the scenario's events.

An *outage* cuts the directed links from a sender to a receiver, either of which may be any. A
*partition* cuts, both ways, the links between robots of different groups; a robot in no group talks
to everyone, and so can be the bridge between groups. Several may overlap; a link is cut while any
of them cuts it. What was sent before arrives. When a cut ends is in
``encircle.world.scenario.channel_events``. (A *silence* is a matter of the robot's radio, and
stands in ``Sending.silent``.)
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from encircle.world.channel.loss_causes import Cause
from encircle.world.scenario.channel_events import cut_spans
from encircle.world.scenario.channel_model import Outage, Partition, between

Cut = tuple[NDArray[np.bool_], NDArray[np.int64]]


@dataclass(frozen=True, eq=False, slots=True)
class Outages:
    """The cuts of a run. ``changes``: the ticks at which one begins or ends, ascending.

    ``cuts``: first tick, tick after the last, links (N, N), cause; in order of precedence, the
    weightier last.
    """

    changes: tuple[int, ...]
    cuts: tuple[tuple[int, int, NDArray[np.bool_], Cause], ...]


def build(events: Iterable[object], ids: Sequence[str]) -> Outages | None:
    """The scheduled outages among a scenario's events, None if there are none."""
    cuts = []
    for event, first, after in cut_spans(events):
        if isinstance(event, Outage):
            links, cause = between(event.sender, event.receiver, ids), Cause.OUTAGE
        elif isinstance(event, Partition):
            links, cause = _across(event.groups, ids), Cause.PARTITION
        else:
            continue
        cuts.append((first, after, links, cause))
    if not cuts:
        return None
    changes = sorted({tick for begin, end, _, _ in cuts for tick in (begin, end)})
    return Outages(tuple(changes), tuple(sorted(cuts, key=lambda cut: cut[3])))


def at(outages: Outages, tick: int) -> Cut | None:
    """Which links are cut at a tick, (N, N), and the cause where they are; None if none is."""
    return _between_changes(outages, bisect_right(outages.changes, tick))


@lru_cache(maxsize=64)
def _between_changes(outages: Outages, index: int) -> Cut | None:
    tick = outages.changes[index - 1] if index else -1
    active = [cut for cut in outages.cuts if cut[0] <= tick < cut[1]]
    if not active:
        return None
    causes = np.zeros(active[0][2].shape, np.int64)
    for _, _, links, cause in active:
        causes[links] = cause
    return causes > 0, causes


def _across(groups: Sequence[Sequence[str]], ids: Sequence[str]) -> NDArray[np.bool_]:
    """(N, N) the links between robots of different groups."""
    group = np.full(len(ids), -1)
    for number, robots in enumerate(groups):
        group[[robot in robots for robot in ids]] = number
    grouped = group >= 0
    links: NDArray[np.bool_] = grouped[:, None] & grouped & (group[:, None] != group)
    return links
