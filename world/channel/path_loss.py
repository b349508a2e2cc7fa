"""Signals that are too weak: log-distance path loss, log-normal shadowing, Rayleigh fading.

A packet passes if its ratio of signal to noise is at least the receiver's threshold. In units of
that threshold the ratio over a distance d is

    (range / d)^exponent * 10^(X / 10) * |g|^2

*Path loss* (Rappaport, Wireless Communications, 2nd ed., eq. 4.68): the mean falls as d^-exponent,
and is at the threshold at ``range_m``.

*Shadowing*: X dB is normal with mean 0 and deviation sigma, drawn once per pair of robots and
reciprocal: the same both ways. With ``shadowing_s`` it drifts, the same process as below for real
numbers (Gudmundson 1991, with time for distance), so that it stays normal with the same deviation.

*Fading* (Rayleigh): g is complex normal with E|g|^2 = 1, so that |g|^2 is exponential and a packet
passes with probability exp(-1 / mean ratio). Without a coherence time each packet on each directed
link has a fade of its own, which is decided by the draw that also decides Bernoulli losses: arms
that differ in these models meet losses as alike as they can be. With a coherence time T the gain
belongs to the pair and is reciprocal: packets of one tick meet the same gain in both directions. It
is the stationary first-order autoregressive process

    g(k + 1) = rho g(k) + sqrt(1 - rho^2) w(k),   rho = exp(-tick / T)

with w like g, so that gains have the correlation exp(-|t| / T) and powers exp(-2 |t| / T). Jakes'
model of many scatterers has a Bessel function there, which this is not. Each step's w is a function
of seed, pair and tick alone, and made at every tick, whether or not a packet is sent.

Left out: interference (``encircle.world.channel.contention``), correlation of shadowing between
pairs that are near each other, thresholds that depend on a packet's length.
"""

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from encircle.world.random_streams import DRAW_MIN, Purpose, pair_uniforms
from encircle.world.scenario.channel_model import Parts
from encircle.world.scenario.loss_models import Loss, PathLoss

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Numbers = TypeVar("Numbers", Floats, Complexes)
FIRST_STATE_TICK = 2**63
"""Tick 0 draws the first packet's own step; the state before it is drawn at this one."""


@dataclass(frozen=True, eq=False, slots=True)
class WeakSignals:
    """Path loss per directed link, all (N, N).

    ``links``: which links have it; ``fades``: those with a fade of their own for each packet;
    ``gain_kept``: rho of the gains, NaN where gains have no memory; ``shadow_db``: the shadowing's
    deviation; ``shadow_kept``: its rho, 1 where it is fixed.
    """

    seed: int
    robots: int
    links: NDArray[np.bool_]
    range_m: Floats
    exponent: Floats
    fades: NDArray[np.bool_]
    gain_kept: Floats
    shadow_db: Floats
    shadow_kept: Floats


class SignalState(NamedTuple):
    """What is remembered: gains, and shadowing in units of its deviation; None if nothing."""

    gains: Complexes | None
    shadows: Floats | None


def build(parts: Parts[Loss], count: int, tick_s: float, seed: int) -> WeakSignals | None:
    """The path loss of a channel, None if it has none."""
    links, fades = np.zeros((2, count, count), bool)
    range_m, exponent = np.ones((2, count, count))
    gain_kept = np.full((count, count), np.nan)
    shadow_db, shadow_kept = np.zeros((count, count)), np.ones((count, count))
    for _, own, loss in parts:
        if not isinstance(loss, PathLoss):
            continue
        links[own] = True
        range_m[own], exponent[own], shadow_db[own] = loss.range_m, loss.exponent, loss.shadowing_db
        if loss.fading == "rayleigh" and loss.coherence_s > 0.0:
            gain_kept[own] = np.exp(-tick_s / loss.coherence_s)
        elif loss.fading == "rayleigh":
            fades[own] = True
        if loss.shadowing_s is not None:
            shadow_kept[own] = np.exp(-tick_s / loss.shadowing_s)
    if not links.any():
        return None
    return WeakSignals(
        seed, count, links, range_m, exponent, fades, gain_kept, shadow_db, shadow_kept
    )


def first_state(signals: WeakSignals) -> SignalState:
    """Gains and shadowing before the first packet, from their stationary distributions."""
    return SignalState(
        None if np.isnan(signals.gain_kept).all() else _gains(signals, FIRST_STATE_TICK),
        _normals(signals, FIRST_STATE_TICK) if signals.shadow_db.any() else None,
    )


def chances(
    signals: WeakSignals, state: SignalState, tick: int, distances_m: Floats
) -> tuple[SignalState, Floats]:
    """The state at a tick, and (N, N) with which probability each link loses a packet.

    ``state``: that of the tick before; ``distances_m``: (N, N) between the robots. The probability
    is 0 or 1 where the gain is known.
    """
    gains, shadows = state
    if gains is not None:
        gains = _stepped(gains, np.nan_to_num(signals.gain_kept), _gains(signals, tick))
    if shadows is not None and (signals.shadow_kept < 1.0).any():
        shadows = _stepped(shadows, signals.shadow_kept, _normals(signals, tick))
    # What |g|^2 has to be at least.
    needed = (distances_m / signals.range_m) ** signals.exponent
    if shadows is not None:
        needed = needed * 10.0 ** (-signals.shadow_db * shadows / 10.0)
    power = 1.0 if gains is None else np.where(np.isnan(signals.gain_kept), 1.0, _power(gains))
    lost = np.where(signals.fades, -np.expm1(-needed), power < needed)
    return SignalState(gains, shadows), np.where(signals.links, lost, 0.0)


def _stepped(now: Numbers, kept: Floats, new: Numbers) -> Numbers:
    return kept * now + np.sqrt(1.0 - kept**2) * new


def _power(gains: Complexes) -> Floats:
    return gains.real**2 + gains.imag**2


def _gains(signals: WeakSignals, tick: int) -> Complexes:
    """(N, N) complex normal draws with a mean square of 1, the same both ways."""
    magnitude = -np.log1p(-pair_uniforms(signals.seed, Purpose.FADING, tick, signals.robots))
    turns = pair_uniforms(signals.seed, Purpose.FADING_PHASE, tick, signals.robots)
    return np.asarray(np.sqrt(magnitude) * np.exp(2j * np.pi * turns), np.complex128)


def _normals(signals: WeakSignals, tick: int) -> Floats:
    """(N, N) standard normal draws, the same both ways."""
    draws = pair_uniforms(signals.seed, Purpose.SHADOWING, tick, signals.robots)
    return np.asarray(ndtri(np.maximum(draws, DRAW_MIN)), np.float64)
