"""Measures of the radio: how old what has come over is, what was lost, how much was sent.

The age of information of a link at a tick is the tick less the one at which the newest packet
delivered by then was sent (Kaul, Yates, Gruteser, "Real-time status: how often should one update?",
INFOCOM 2012). A packet takes a tick at least, so the age is 1 at best. Before the first delivery
the age is counted from the tick before the first, as if a packet sent then had come at tick 0: an
undisturbed link has age 1 from the start, and a link over which nothing ever comes keeps ageing. To
leave such ticks out would make the worst links look better than the middling.
"""

import numpy as np

from encircle.measures.common import (
    cached_per_log,
    in_unit,
    links,
    links_there,
    mean_or_nan,
    percentile_or_nan,
)
from encircle.runlog.packet_parts import ESTIMATE, PAYLOAD, RELAYED
from encircle.runlog.runlog import NAN, Integers, RunLog

NEVER = np.iinfo(np.int64).max


@cached_per_log
def _newest_ticks(log: RunLog) -> Integers:
    """(T, N (N - 1)) when the newest packet delivered by a tick was sent, -1 before the first."""
    newest = np.full((log.ticks, log.count, log.count), -1)
    for fates in (log.due, log.copies):
        # What comes at the last tick comes after the last decision.
        sent, sender, receiver = np.nonzero((fates > 0) & (fates < log.ticks))
        np.maximum.at(newest, (fates[sent, sender, receiver], sender, receiver), sent)
    newest = np.maximum.accumulate(newest, axis=0)
    return newest[:, links(log.count)]


@cached_per_log
def ages_ticks(log: RunLog) -> Integers:
    """(T, N (N - 1)) age of information of each directed link at each tick of decision."""
    return np.asarray(np.arange(log.ticks)[:, None] - _newest_ticks(log))


@cached_per_log
def _ages_there(log: RunLog) -> Integers:
    """(A,) ages of the links whose ends took part in the round."""
    return ages_ticks(log)[links_there(log)]


@in_unit("tick")
def age_ticks_mean(log: RunLog) -> float:
    """Age of information, mean over links and ticks."""
    return mean_or_nan(_ages_there(log))


@in_unit("tick")
def age_ticks_p95(log: RunLog) -> float:
    """Age of information, 95th percentile over links and ticks."""
    return percentile_or_nan(_ages_there(log), 95.0)


@in_unit("tick")
def age_ticks_max(log: RunLog) -> float:
    """Age of information, highest over links and ticks."""
    return float(_ages_there(log).max()) if _ages_there(log).size else NAN


@in_unit("tick")
def age_ticks_mean_worst(log: RunLog) -> float:
    """Age of information of the link with the highest mean over ticks."""
    there = links_there(log)
    ticks = there.sum(axis=0)
    totals = np.where(there, ages_ticks(log), 0).sum(axis=0)
    return float((totals[ticks > 0] / ticks[ticks > 0]).max()) if ticks.any() else NAN


@in_unit("1")
def unheard_share(log: RunLog) -> float:
    """The share of links and ticks before the first delivery, not counting tick 0."""
    return mean_or_nan((_newest_ticks(log) < 0)[1:][links_there(log)[1:]])


@cached_per_log
def delays_ticks(log: RunLog) -> Integers:
    """(D,) delays of the packets that the radio delivers, the first copy of each."""
    first = np.minimum(
        np.where(log.due > 0, log.due, NEVER), np.where(log.copies > 0, log.copies, NEVER)
    )
    sent, sender, receiver = np.nonzero(first < NEVER)
    return np.asarray(first[sent, sender, receiver] - sent)


@in_unit("1")
def delivery_ratio(log: RunLog) -> float:
    """Packets that the radio delivers over packets sent; one packet per pose and directed link."""
    sent = int(np.count_nonzero(log.due))
    return len(delays_ticks(log)) / sent if sent else NAN


@in_unit("tick")
def delay_ticks_mean(log: RunLog) -> float:
    """Delay of the packets that the radio delivers, mean over packets."""
    return mean_or_nan(delays_ticks(log))


@in_unit("s")
def delay_s_mean(log: RunLog) -> float:
    """Delay of the packets that the radio delivers in seconds, mean over packets."""
    return delay_ticks_mean(log) * log.scenario.tick_s


@in_unit("1")
def messages_sent(log: RunLog) -> float:
    """Poses that robots published, each counted once however many receive it."""
    return float(np.count_nonzero(log.sizes_bytes))


@in_unit("Hz")
def messages_hz_mean(log: RunLog) -> float:
    """Poses published per second, mean over robots."""
    return messages_sent(log) / _duration_s(log) / log.count if log.ticks else NAN


@in_unit("B")
def sent_bytes(log: RunLog) -> float:
    """Bytes of the poses that robots published."""
    return float(log.sizes_bytes.sum())


@in_unit("B/s")
def sent_bytes_per_s(log: RunLog) -> float:
    """Bytes published by all robots per second."""
    return sent_bytes(log) / _duration_s(log) if log.ticks else NAN


@in_unit("B")
def sent_bytes_pose(log: RunLog) -> float:
    """Bytes of the published poses themselves, without the parts that the next three count."""
    return sent_bytes(log) - float(log.parts_bytes.sum())


@in_unit("B")
def sent_bytes_payload(log: RunLog) -> float:
    """Bytes of what policies said in published poses."""
    return float(log.parts_bytes[..., PAYLOAD].sum())


@in_unit("B")
def sent_bytes_relayed(log: RunLog) -> float:
    """Bytes of relayed detections in published poses."""
    return float(log.parts_bytes[..., RELAYED].sum())


@in_unit("B")
def sent_bytes_estimate(log: RunLog) -> float:
    """Bytes of estimates of the target in published poses."""
    return float(log.parts_bytes[..., ESTIMATE].sum())


def _duration_s(log: RunLog) -> float:
    return log.ticks * log.scenario.tick_s
