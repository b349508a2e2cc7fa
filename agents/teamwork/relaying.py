"""Passing on what others detected, so that a detection can take a way round a bad link.

Every packet of a relaying robot repeats the newest detections by others that it knows, so one
packet that arrives makes up for several that were lost. A detection carries origin and tick, so
that a robot that receives it twice counts it once (``encircle.agents.estimation.kalman``). Relayed
is what the filter's window holds: neither what arrived too late to be used, nor what belongs to a
track that was given up. The robot's own earlier detections are left out: repeating them is another
remedy than relaying, and a study could not separate the two.
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
        for detection_tick, origin, x, y in entry.detections:
            if origin != own:
                collected.append((team[origin], detection_tick, x, y))
        if len(collected) >= RELAYED_MAX:
            break
    return tuple(collected[:RELAYED_MAX])


def relayed_detections(
    packets: Sequence[Pose], tick: int, own: int, indices: Mapping[str, int]
) -> list[Detection]:
    """The earlier detections by others that these packets relay, each once.

    Several packets relay the same detection; if they differ, the last one counts.
    """
    collected: dict[tuple[int, int], Detection] = {}
    for packet in packets:
        for origin, detection_tick, x, y in packet.relayed:
            index = indices[origin]
            if index != own and detection_tick < tick:
                collected[detection_tick, index] = (detection_tick, index, x, y)
    return list(collected.values())
