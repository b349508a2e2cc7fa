"""Occupied angles: which headings of a faster target the robots cut off, and is the ring closed.

A target at the origin runs straight ahead at speed v for ever. A robot at distance d, bearing
beta, runs at speed lambda v, knows the heading at once and captures within r_c. It meets a target
whose heading is alpha off its bearing if, at some time t >= 0, the target has come within reach:

    |(d, 0) - v t (cos alpha, sin alpha)| <= lambda v t + r_c.

Squared, with s = v t, this is a condition on a parabola in s,

    (1 - lambda^2) s^2 - 2 s (d cos alpha + lambda r_c) + d^2 - r_c^2 <= 0.

For lambda < 1 and d > r_c it opens upwards and is positive at s = 0, so that it is met for an
s > 0 if and only if its vertex lies at s > 0 and not above zero:

    d cos alpha + lambda r_c >= sqrt(1 - lambda^2) sqrt(d^2 - r_c^2).

Write lambda = sin(phi) and r_c / d = sin(psi); the right side is d cos(phi) cos(psi), and

    cos alpha >= cos(phi) cos(psi) - sin(phi) sin(psi) = cos(phi + psi).

The robot therefore *occupies* the headings within **asin(lambda) + asin(r_c / d)** of its bearing,
neither more nor less. With r_c = 0 this is the tangent to the Apollonius circle of the two
(Ramana, Kothari, "Pursuit-Evasion Games of High Speed Evader", J. Intell. Robot. Syst. 85, 2017;
Fang, Wang, Xie, Chen, "Cooperative Pursuit with Multi-Pursuer and One Faster Free-moving Evader",
arXiv 2001.04731). With lambda = 1 the bound itself is left out: who flees at a right angle is
followed for ever. With lambda > 1, or d <= r_c, all headings are occupied.

The ring is *closed* if every heading is occupied. It takes pi / asin(lambda) robots at r_c = 0.
What this leaves out: a target that turns, obstacles, the arena's edges, bodies that block, ticks.
A closed ring is thus no promise of a capture; an open one shows the target a way out.
"""

from collections.abc import Sequence
from math import asin, pi
from typing import NamedTuple


class Slack(NamedTuple):
    """The gap between two neighbours in angle, counter-clockwise from one to the other.

    ``after`` and ``before``: indices of the robots at its two ends (one and the same in a team of
    one); ``slack_rad``: by how much in rad the occupied angles overlap in it, or, if negative,
    how wide the range of free headings is.
    """

    after: int
    before: int
    slack_rad: float


def half_angle(speed_ratio: float, capture_m: float, distance_m: float) -> float:
    """Half the angle in rad that a robot occupies about its bearing, from 0 to pi.

    ``speed_ratio``: lambda, the robot's highest speed over the target's, 0 or more (``inf`` for a
    target that stands); ``capture_m``: the distance r_c at which a robot captures, 0 or more;
    ``distance_m``: that of their centres.
    """
    if speed_ratio > 1.0 or distance_m <= capture_m:
        return pi
    return asin(speed_ratio) + asin(capture_m / distance_m)


def slacks(bearings: Sequence[float], half_angles: Sequence[float]) -> tuple[Slack, ...]:
    """The N gaps between N robots, counter-clockwise from the least bearing; () of no robot.

    ``bearings``: (N,) of the robots seen from the target in rad, any multiple of 2 pi more or
    less; ``half_angles``: (N,) in rad. Between neighbours i and j the slack is

        h_i + h_j - (beta_j - beta_i),

    unless the angle of a robot farther round reaches into the gap past theirs, as that of a near
    one does past a far one's: then that one's reach counts. All headings are occupied if and only
    if no slack is negative. Of equal bearings the first comes first.
    """
    order = sorted(range(len(bearings)), key=lambda robot: bearings[robot] % (2.0 * pi))
    turned = [bearings[robot] % (2.0 * pi) for robot in order]
    halves = [half_angles[robot] for robot in order]
    upwards = _reaches(turned, halves)
    downwards = _reaches([-bearing for bearing in reversed(turned)], halves[::-1])[::-1]
    count = len(order)
    gaps = []
    for here, robot in enumerate(order):
        there = (here + 1) % count
        gap_rad = turned[there] - turned[here] + (2.0 * pi if there <= here else 0.0)
        slack_rad = upwards[here] + downwards[there] - gap_rad
        gaps.append(Slack(robot, order[there], slack_rad))
    return tuple(gaps)


def _reaches(bearings: Sequence[float], halves: Sequence[float]) -> list[float]:
    """(N,) how far in rad beyond each robot its own angle, or that of one behind it, reaches.

    ``bearings`` ascend within one turn. The second time round, those behind are all known.
    """
    reaches = [0.0] * len(bearings)
    farthest = -pi
    for turn in (0.0, 2.0 * pi):
        for robot, (bearing, half) in enumerate(zip(bearings, halves, strict=True)):
            farthest = max(farthest, bearing + turn + half)
            reaches[robot] = farthest - (bearing + turn)
    return reaches


def least_slack(bearings: Sequence[float], half_angles: Sequence[float]) -> float:
    """The least of the slacks in rad, -2 pi without a robot: all headings are free."""
    return min((slack.slack_rad for slack in slacks(bearings, half_angles)), default=-2.0 * pi)


def is_closed(bearings: Sequence[float], half_angles: Sequence[float]) -> bool:
    """Whether the robots occupy every heading."""
    return least_slack(bearings, half_angles) >= 0.0
