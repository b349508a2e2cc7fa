"""Where each robot assumes its team to be, for a whole run at once.

The same numbers, to the bit, as ``encircle.agents.teamwork.peers.planning_team`` gives one robot at
one tick, as arrays over all robots and some ticks at a time: a study asks for every run.
"""

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from encircle.agents.teamwork.peers import Peer, PeerTable
from encircle.protocol.messages import Point
from encircle.protocol.parameters import Parameters

Floats = NDArray[np.float64]

VALUES_MAX = 2_000_000
"""How many numbers of peer tables are held at a time."""
NAN = float("nan")
NO_PEER = (NAN,) * 5


def believed_positions(
    tables: Sequence[PeerTable | None],
    positions: Sequence[Point | None],
    count: int,
    parameters: Parameters,
) -> Floats:
    """(T, N, N, 2) where each robot assumes each one to be, NaN where it leaves one out.

    ``tables`` and ``positions``: T times N, of each robot its peer table and its own position in m,
    both None of one that is lost.
    """
    ticks = len(tables) // count
    step = max(1, VALUES_MAX // (count * count * len(NO_PEER)))
    believed = np.empty((ticks, count, count, 2))
    for first in range(0, ticks, step):
        rows = slice(first * count, (first + step) * count)
        known = _known(tables[rows], positions[rows], first, count)
        believed[first : first + step] = _assumed(known, first, parameters)
    return believed


def _known(
    tables: Sequence[PeerTable | None], positions: Sequence[Point | None], first: int, count: int
) -> Floats:
    """(K, N, N, 5) entries as in peer tables from tick ``first`` on, each robot's own included."""
    ticks = len(tables) // count
    nobody: PeerTable = (None,) * count
    entries = _entries(chain.from_iterable(nobody if t is None else t for t in tables))
    known = np.fromiter(entries, np.float64, ticks * count * count * len(NO_PEER))
    known = known.reshape(ticks, count, count, len(NO_PEER))
    robots = np.arange(count)
    own = [
        NO_PEER if p is None else (first + k // count, *p, 0.0, 0.0)
        for k, p in enumerate(positions)
    ]
    known[:, robots, robots] = np.array(own).reshape(ticks, count, len(NO_PEER))
    return known


def _entries(peers: Iterator[Peer | None]) -> Iterator[float]:
    return chain.from_iterable(NO_PEER if peer is None else peer for peer in peers)


def _assumed(known: Floats, first: int, parameters: Parameters) -> Floats:
    """(K, N, N, 2) positions in m that follow from what is known, K ticks from ``first`` on."""
    now = np.arange(first, first + len(known))[:, None, None]
    since = known[..., 0]
    assumed = known[..., 1:3]
    if parameters.peer_policy != "hold":
        trusted = np.minimum(now - since, parameters.extrapolate_ticks_max)
        assumed = assumed + trusted[..., None] * known[..., 3:]
    young = since >= now - parameters.peer_age_ticks_max
    return np.asarray(np.where(young[..., None], assumed, NAN))
