"""Measures of agreement: when the robots' chosen points first fit, and what was sent until then.

Robots *agree* at a tick if all that take part, two or more, hold a point, no two hold the same, and
for ``AGREED_TICKS`` ticks, this one included, nothing disturbs that: no two robots come to hold one
point and none switches (``encircle.measures.choice``). A robot that then holds no point, because it
closes in, disturbs nothing, nor does the end of the run. Without this wait a lucky moment in
mid-negotiation would count: two robots that change places at every tick are apart at every second.

The *negotiation* opens at the first tick at which a robot holds a point. What is sent at a tick is
heard one later at the earliest, so the packets of the ticks from the opening to the one before the
agreement are those that can have brought it about. A team that agrees as it opens needs none.

Where no two robots ever hold points at the same tick there is nothing to agree about: all of this
is then NaN. Where they do and never agree, ``agreed`` is 0 and the rest is NaN, as the time of a
capture is without one: such a run is censored, and no mean of the others speaks for it.
"""

import numpy as np

from encircle.measures.choice import encircling, several, shared_points, switched
from encircle.measures.common import cached_per_log, in_unit
from encircle.runlog.packet_parts import PAYLOAD
from encircle.runlog.runlog import NAN, Integers, RunLog

AGREED_TICKS = 5


@cached_per_log
def _first_agreement(log: RunLog) -> int | None:
    """The first tick at which robots agree, None if they never do."""
    clash = np.asarray(shared_points(log).any(axis=1))
    whole = (encircling(log) == log.there).all(axis=1) & (log.there.sum(axis=1) >= 2)
    disturbed = clash.copy()
    disturbed[1:] |= switched(log).any(axis=1)
    for tick in np.flatnonzero(whole & ~clash):
        if not disturbed[tick + 1 : tick + AGREED_TICKS].any():
            return int(tick)
    return None


@in_unit("1")
def agreed(log: RunLog) -> float:
    """1 if the robots agreed who takes which point, else 0."""
    return float(_first_agreement(log) is not None) if several(log).any() else NAN


@in_unit("tick")
def agreement_tick(log: RunLog) -> float:
    """The first tick at which the robots agree."""
    tick = _first_agreement(log)
    return NAN if tick is None else float(tick)


@in_unit("s")
def agreement_s(log: RunLog) -> float:
    """The time at which the robots agree first."""
    return agreement_tick(log) * log.scenario.tick_s


@in_unit("tick")
def negotiation_ticks(log: RunLog) -> float:
    """Ticks from the first at which a robot holds a point to the agreement."""
    opening = float(encircling(log).any(axis=1).argmax()) if log.ticks else NAN
    return agreement_tick(log) - opening


@in_unit("1")
def negotiation_messages(log: RunLog) -> float:
    """Poses published in the negotiation, each counted once however many receive it."""
    return _sum_of_negotiation(log, (log.sizes_bytes > 0).astype(np.int64))


@in_unit("B")
def negotiation_bytes(log: RunLog) -> float:
    """Bytes of the poses published in the negotiation."""
    return _sum_of_negotiation(log, log.sizes_bytes)


@in_unit("B")
def negotiation_payload_bytes(log: RunLog) -> float:
    """Bytes of what policies said in the negotiation."""
    return _sum_of_negotiation(log, log.parts_bytes[..., PAYLOAD])


def _sum_of_negotiation(log: RunLog, by_robot: Integers) -> float:
    """The sum of (T, N) over the ticks before the agreement, since the opening."""
    end = _first_agreement(log)
    if end is None:
        return NAN
    return float(by_robot[end - int(negotiation_ticks(log)) : end].sum())
