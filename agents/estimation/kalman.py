"""Kalman filter over everybody's detections of the target, each at its own tick, also late ones.

Constant-velocity model with white acceleration noise, position measured, noise isotropic. The two
axes are then the same filter run twice: one 2 x 2 covariance serves both, and several detections of
one tick are exactly one detection at their mean with the variance divided by their number. The
covariance and gain depend on the numbers of detections only, not on what was detected. filterpy
gives the process noise. A step is what its ``predict`` and ``update`` do, operation by operation,
in plain numbers: many times as fast for matrices of this size, and its bits do not depend on how a
processor multiplies matrices. It is rounded to 1e-12, so that the recursion comes to rest, and
remembered.

Raw detections travel, with origin and tick, unless robots tell estimates
(``encircle.agents.teamwork.fusing``). A detection that arrives late is put at its tick and the
filter is run again from there over its short window, so the result is the same as if everything had
arrived in order, and nothing is counted twice, whatever ways a detection takes to get here. The
alternative, to ignore what is late, is there to be compared with.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple, TypeAlias

from encircle.protocol.messages import Point
from encircle.protocol.parameters import Parameters
from encircle.protocol.process.deferred_imports import UNUSED, deferred, lazy

with lazy(*UNUSED), deferred("scipy.stats", "scipy.ndimage"):
    from filterpy.common import Q_discrete_white_noise

COVARIANCE_DIGITS = 12
STEPS_KEPT_MAX = 4096


class Estimate(NamedTuple):
    """Mean (m, m/s) and per-axis covariance (p00, p01, p11) of the target's state at a tick."""

    x: float
    y: float
    vx: float
    vy: float
    covariance: tuple[float, float, float]

    @property
    def position(self) -> Point:
        """Where the target is believed to be, in m."""
        return self.x, self.y


Detection: TypeAlias = tuple[int, int, float, float]
"""``(tick, origin, x, y)``: where robot number ``origin`` detected the target at ``tick``, in m."""


class Entry(NamedTuple):
    """One tick of the window: its detections and the filtered estimate after them.

    Detections stand in robot order, not in order of arrival: addition is not associative.
    """

    detections: tuple[Detection, ...]
    estimate: Estimate | None


class Track(NamedTuple):
    """The filter's state: entries for the ticks ``first_tick``, ``first_tick + 1``, ..."""

    first_tick: int
    base: Estimate | None
    """The estimate just before the first entry, from which the window is run again."""
    entries: tuple[Entry, ...]
    detected_tick: int
    """Newest tick at which anyone is known to have detected the target; -1 if none is."""
    dropped: int
    """Detections, or estimates told by others, that came too late to be used."""
    told_ticks: tuple[tuple[int, int], ...] = ()
    """Where estimates are told: robots' numbers, and the ticks of their newest that has come."""

    @property
    def estimate(self) -> Estimate | None:
        """The newest estimate, None while nothing is known."""
        return self.entries[-1].estimate if self.entries else None


EMPTY_TRACK = Track(0, None, (), -1, 0)
EMPTY = Entry((), None)


def incorporate(
    track: Track, detections: Iterable[Detection], tick: int, tick_s: float, parameters: Parameters
) -> Track:
    """The track at ``tick`` (one after the track's last) with these detections folded in.

    A track that nobody has fed for ``track_age_ticks_max`` is given up, and starts anew with the
    next detection; then what is older than the last one of the old track comes too late.
    """
    entries = [*track.entries, EMPTY]
    first, base = track.first_tick, track.base
    surplus = len(entries) - parameters.window_ticks
    if surplus > 0:
        first, base = first + surplus, entries[surplus - 1].estimate
        del entries[:surplus]
    dirty = len(entries) - 1
    newest, dropped = track.detected_tick, track.dropped
    # An undelayed link brings a detection at the tick after it was made.
    late_tick = tick - 1 if parameters.late_detections == "ignore" else first
    by_tick: dict[int, list[Detection]] = {}
    of_tick: list[Detection] = []
    of = None
    for detection in detections:
        # Those of one tick mostly come one after the other.
        if detection[0] != of:
            of = detection[0]
            of_tick = by_tick.setdefault(of, [])
        of_tick.append(detection)
    for heard_tick, arrived in by_tick.items():
        index = heard_tick - first
        if index < 0:
            dropped += len(arrived)
            continue
        known = entries[index].detections
        if heard_tick < late_tick:
            dropped += len({d[1] for d in arrived} - {d[1] for d in known})
            continue
        merged = {d[1]: d for d in (*arrived, *known)}  # one per origin, the one known first
        if len(merged) > len(known):
            entries[index] = Entry(tuple(sorted(merged.values())), None)
            if index < dirty:
                dirty = index
            if heard_tick > newest:
                newest = heard_tick
    if -1 < newest < tick - parameters.track_age_ticks_max:
        # What the old track was fed with is forgotten, so a copy of it must not feed the new one.
        first = max(first, newest + 1)
        return Track(first, None, (EMPTY,) * (tick + 1 - first), -1, dropped, track.told_ticks)
    noise = (tick_s, parameters.acceleration_mps2_std, parameters.measurement_m_std)
    before = entries[dirty - 1].estimate if dirty else base
    for index in range(dirty, len(entries)):
        heard = entries[index].detections
        before = _step(before, heard, noise, parameters.velocity_mps_std)
        entries[index] = Entry(heard, before)
    return Track(first, base, tuple(entries), newest, dropped, track.told_ticks)


def coast_to(track: Track, tick: int, tick_s: float, parameters: Parameters) -> Track:
    """The track as of the tick before ``tick``, nothing having been heard since its last.

    One whose target would be given up for lost in between starts anew at ``tick``.
    """
    next_tick = track.first_tick + len(track.entries)
    if tick - next_tick > parameters.track_age_ticks_max:
        return track._replace(first_tick=tick, base=None, entries=(), detected_tick=-1)
    for passed in range(next_tick, tick):
        track = incorporate(track, (), passed, tick_s, parameters)
    return track


def next_estimate(
    before: Estimate | None,
    detections: tuple[Detection, ...],
    tick_s: float,
    parameters: Parameters,
) -> Estimate | None:
    """The estimate one tick later, for detections that come in order: the filter, no window."""
    noise = (tick_s, parameters.acceleration_mps2_std, parameters.measurement_m_std)
    return _step(before, detections, noise, parameters.velocity_mps_std)


def predicted(estimate: Estimate, ticks: int, tick_s: float, parameters: Parameters) -> Estimate:
    """The estimate ``ticks`` later without detections, by the filter's motion model at once.

    The process noise over k ticks of length h sums up, per axis, to (s h)^2 times
    h^2 k (4 k^2 - 1) / 12 for the position, k for the velocity, and h k^2 / 2 between the two.
    """
    x, y, vx, vy, (p00, p01, p11) = estimate
    k, time_s = float(ticks), ticks * tick_s
    noise = (parameters.acceleration_mps2_std * tick_s) ** 2
    covariance = (
        p00
        + time_s * (2.0 * p01 + time_s * p11)
        + noise * tick_s**2 * k * (4.0 * k * k - 1.0) / 12.0,
        p01 + time_s * p11 + noise * tick_s * k * k / 2.0,
        p11 + noise * k,
    )
    return Estimate(x + time_s * vx, y + time_s * vy, vx, vy, covariance)


def _step(
    before: Estimate | None,
    detections: tuple[Detection, ...],
    noise: tuple[float, float, float],
    velocity_mps_std: float,
) -> Estimate | None:
    """One tick of the filter: predict, then update with all of the tick's detections at once."""
    count = len(detections)
    if count:
        # Not by sum(), which from Python 3.12 on compensates for rounding, and before did not.
        total_x = total_y = 0.0
        for _, _, detected_x, detected_y in detections:
            total_x += detected_x
            total_y += detected_y
        mean_x, mean_y = total_x / count, total_y / count
        if before is None:
            covariance = (noise[2] ** 2 / count, 0.0, velocity_mps_std**2)
            return Estimate(mean_x, mean_y, 0.0, 0.0, covariance)
    elif before is None:
        return None
    x, y, vx, vy, covariance = before
    x += noise[0] * vx
    y += noise[0] * vy
    covariance, gain_x, gain_v = covariance_step(covariance, count, *noise)
    if count:
        error_x, error_y = mean_x - x, mean_y - y
        x += gain_x * error_x
        y += gain_x * error_y
        vx += gain_v * error_x
        vy += gain_v * error_y
    return Estimate(x, y, vx, vy, covariance)


@lru_cache(maxsize=STEPS_KEPT_MAX)
def covariance_step(
    covariance: tuple[float, float, float],
    count: int,
    tick_s: float,
    acceleration_mps2_std: float,
    measurement_m_std: float,
) -> tuple[tuple[float, float, float], float, float]:
    """Predict and update one axis's covariance with ``count`` detections; also the Kalman gain.

    The update is Joseph's form, which keeps a covariance positive definite.
    """
    p00, p01, p11 = covariance
    q00, q01, q11 = _process_noise(tick_s, acceleration_mps2_std)
    ahead = p01 + tick_s * p11
    p00, p01, p11 = p00 + tick_s * p01 + tick_s * ahead + q00, ahead + q01, p11 + q11
    gain_x = gain_v = 0.0
    if count:
        variance = measurement_m_std**2 / count
        inverse = 1.0 / (p00 + variance)
        gain_x, gain_v = p00 * inverse, p01 * inverse
        kept, moved_x, moved_v = 1.0 - gain_x, p01 - gain_v * p00, p11 - gain_v * p01
        p11 = moved_v - moved_x * gain_v + gain_v * variance * gain_v
        p01 = kept * p01 - kept * p00 * gain_v + gain_x * variance * gain_v
        p00 = kept * p00 * kept + gain_x * variance * gain_x
    digits = COVARIANCE_DIGITS
    return (round(p00, digits), round(p01, digits), round(p11, digits)), gain_x, gain_v


@lru_cache(maxsize=16)
def _process_noise(tick_s: float, acceleration_mps2_std: float) -> tuple[float, float, float]:
    """One axis's covariance of a tick's acceleration."""
    noise = Q_discrete_white_noise(2, tick_s, acceleration_mps2_std**2)
    return float(noise[0, 0]), float(noise[0, 1]), float(noise[1, 1])
