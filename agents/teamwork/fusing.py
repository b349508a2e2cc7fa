"""Telling estimates of the target instead of detections, and fusing those of others.

With ``robot.detections`` = ``fuse`` a packet carries the sender's own estimate as of its tick. A
receiver predicts it to the present and fuses it with its own by covariance intersection
(``encircle.agents.estimation.covariance_intersection``), in the order of tick and sender. The
result is its estimate, into which its next own detection goes, and which it tells next. So an
estimate comes round to where it came from, and nobody knows what two of them have in common: that
is what the intersection is for. ``fuse-naive`` takes them for independent, to be compared with.

An estimate is not put at its own tick and filtered again, as detections are: what a robot has made
of its own since then is not known to be independent of it. A sender's newest estimate contains what
was in its earlier ones, so that copies and what comes out of order are passed over. Too old, and
counted as dropped, is one from before the filter's window, and one whose newest detection is older
than a track may be: else robots would keep up each other's memory of a target for ever.

A detection that comes from a peer, who does not fuse, counts as an estimate of its tick that knows
nothing of the velocity, as a filter's first detection does.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from encircle.agents.estimation import kalman
from encircle.agents.estimation.covariance_intersection import intersection, product
from encircle.agents.estimation.kalman import Detection, Estimate, Track
from encircle.protocol.messages import Pose, quantise_m
from encircle.protocol.parameters import Parameters
from encircle.protocol.wire.target_estimate import TargetEstimate, is_sound, rounded_covariance

FUSIONS: Mapping[str, Callable[[Estimate, Estimate], Estimate]] = {
    "fuse": intersection,
    "fuse-naive": product,
}
"""How two estimates become one, by ``robot.detections``; the other values fuse none."""


class Told(NamedTuple):
    """What one peer tells: its estimate of a tick, and the tick of the newest detection in it."""

    tick: int
    sender: int
    detected_tick: int
    estimate: Estimate


def incorporate(
    track: Track,
    detections: Sequence[Detection],
    packets: Sequence[tuple[int, Pose]],
    own: int,
    tick: int,
    tick_s: float,
    parameters: Parameters,
) -> Track:
    """The track at ``tick`` (one after its last) with own detections and others' estimates in it.

    ``detections``: all that reached robot number ``own``; ``packets``: ``(sender, pose)`` of
    earlier ticks.
    """
    known = dict(track.told_ticks)
    usable, dropped = [], track.dropped
    for told in _newest_of_each(detections, packets, own, parameters):
        if told.tick <= known.get(told.sender, -1):
            continue
        known[told.sender] = told.tick
        now = _predicted(told, tick, tick_s, parameters)
        if now is None:
            dropped += 1
        else:
            usable.append((told.detected_tick, now))
    newest = max([track.detected_tick, *[detected for detected, _ in usable]])
    track = track._replace(
        detected_tick=newest, dropped=dropped, told_ticks=tuple(sorted(known.items()))
    )
    mine = [detection for detection in detections if detection[1] == own]
    track = kalman.incorporate(track, mine, tick, tick_s, parameters)
    estimate, fuse = track.estimate, FUSIONS[parameters.detections]
    for _, theirs in usable:
        if estimate is None:
            estimate = theirs
        elif is_sound(estimate.covariance):
            estimate = fuse(estimate, theirs)
    entry = track.entries[-1]._replace(estimate=estimate)
    return track._replace(entries=(*track.entries[:-1], entry))


def estimate_to_tell(track: Track) -> TargetEstimate | None:
    """The track's estimate as it travels, None without one that is fit to be told."""
    estimate = track.estimate
    if estimate is None or not is_sound(estimate.covariance):
        return None
    x, y, vx, vy = [quantise_m(value) for value in estimate[:4]]
    return TargetEstimate(
        track.detected_tick, x, y, vx, vy, *rounded_covariance(estimate.covariance)
    )


def _newest_of_each(
    detections: Sequence[Detection],
    packets: Sequence[tuple[int, Pose]],
    own: int,
    parameters: Parameters,
) -> list[Told]:
    """The newest that each peer tells of the target, by tick and sender."""
    first = (parameters.measurement_m_std**2, 0.0, parameters.velocity_mps_std**2)
    told = [
        Told(tick, origin, tick, Estimate(x, y, 0.0, 0.0, first))
        for tick, origin, x, y in detections
        if origin != own
    ]
    for sender, pose in packets:
        if pose.estimate is not None:
            detected_tick, x, y, vx, vy, *covariance = pose.estimate
            p00, p01, p11 = covariance
            told.append(
                Told(pose.tick, sender, detected_tick, Estimate(x, y, vx, vy, (p00, p01, p11)))
            )
    newest: dict[int, Told] = {}
    for item in told:
        if item.sender not in newest or item.tick >= newest[item.sender].tick:
            newest[item.sender] = item
    return sorted(newest.values(), key=lambda item: item[:2])


def _predicted(told: Told, tick: int, tick_s: float, parameters: Parameters) -> Estimate | None:
    """What was told, as of ``tick``; None if it is too old, or too uncertain by then to be used."""
    window = 2 if parameters.late_detections == "ignore" else parameters.window_ticks
    if told.tick <= tick - window or told.detected_tick < tick - parameters.track_age_ticks_max:
        return None
    now = kalman.predicted(told.estimate, tick - told.tick, tick_s, parameters)
    return now if is_sound(now.covariance) else None
