"""Passing on what others detected, so that a detection can take a way round a bad link.

Every packet of a relaying robot repeats the newest detections that it has heard of, so one packet
that gets through makes up for several that did not. They carry origin and tick, so that whoever
hears of one twice counts it once (``encircle.agents.estimation.kalman``). Passed on is what the
filter's window holds: not what came too late to be used, nor what belongs to a track that was given
up. The robot's own earlier detections are left out: to repeat oneself is another remedy than to
help others, and a study could not tell the two apart.
"""

from collections.abc import Mapping, Sequence

from encircle.agents.estimation.kalman import Detection, Track
from encircle.protocol.messages import Pose
from encircle.protocol.wire.limits import RELAYED_MAX

Relayed = tuple[tuple[str, int, float, float], ...]


def detections_to_relay(
    track: Track, tick: int, own: int, team: Sequence[str], age_ticks_max: int
) -> Relayed:
    """What others detected before a tick, newest first and then in robot order."""
    collected: list[tuple[str, int, float, float]] = []
    oldest = max(0, tick - age_ticks_max - track.first_tick)
    for entry in track.entries[oldest:][::-1]:
        for heard_tick, origin, x, y in entry.detections:
            if origin != own:
                collected.append((team[origin], heard_tick, x, y))
        if len(collected) >= RELAYED_MAX:
            break
    return tuple(collected[:RELAYED_MAX])


def relayed_detections(
    packets: Sequence[Pose], tick: int, own: int, indices: Mapping[str, int]
) -> list[Detection]:
    """The earlier detections by others that these packets pass on, each once.

    The same is heard from many sides; of what should not differ but does, the last one counts.
    """
    collected: dict[tuple[int, int], Detection] = {}
    for packet in packets:
        for origin, heard_tick, x, y in packet.relayed:
            index = indices[origin]
            if index != own and heard_tick < tick:
                collected[heard_tick, index] = (heard_tick, index, x, y)
    return list(collected.values())
