"""What there is to see at one tick: the truth, decisions, packets, beliefs, values, events.

Robots are in robot order everywhere, and an index of a robot counts from 0 in that order. Lengths
are in m, angles in rad. What is not known, or does not exist at a tick, is None.
"""

from dataclasses import dataclass
from typing import NamedTuple

from encircle.protocol.messages import Point


class Packet(NamedTuple):
    """A packet sent at the frame's tick, on one link.

    ``due``: the tick at which it arrives (the next one: on time), or minus the code of the cause of
    its loss (``Stage.causes``); ``copy_due``: when a second copy arrives, 0 if there is none.
    """

    sender: int
    receiver: int
    due: int
    copy_due: int


class PeerBelief(NamedTuple):
    """Where a robot assumes a peer to be now.

    ``age_ticks``: how old the newest thing is that it knows of the peer; ``planned_with``: whether
    the peer is in the team that it plans with.
    """

    robot: int
    x: float
    y: float
    age_ticks: int
    planned_with: bool


class Belief(NamedTuple):
    """The world as one robot believes it when it decides.

    ``position``: its own, with its localisation error; ``peers``: those that it knows of;
    ``estimate``: the target's x, y in m and vx, vy in m/s; ``covariance``: of each axis, p00 in
    m^2, p01 in m^2/s, p11 in m^2/s^2; ``prediction``: where the target will be after
    ``PREDICTED_TICKS``, () while nothing is known of it.
    """

    position: Point
    peers: tuple[PeerBelief, ...]
    estimate: tuple[float, float, float, float] | None
    covariance: tuple[float, float, float] | None
    prediction: tuple[Point, ...]


PREDICTED_TICKS = (2.0, 4.0, 6.0, 8.0, 10.0)
"""How many ticks ahead a belief shows the predicted target."""


@dataclass(frozen=True, slots=True)
class Values:
    """Numbers of one tick.

    ``distances_m``: from each robot's centre to the target's; ``gap_rad``: the largest angle about
    the target between neighbouring robots, 2 pi for one or none; ``slack_rad``: the least slack of
    the occupied angles (``encircle.agents.planning.occupied_angles``), None while all robots are
    lost; ``age_ticks_mean``: mean age of information over the links between robots that take part,
    None where there is none (``encircle.measures.radio``); ``conflicts``: pairs of robots that hold
    one encirclement point (``encircle.measures.choice``); ``delivery``: the share delivered of the
    packets sent in the last ``DELIVERY_TICKS`` ticks, None if none was sent.
    """

    distances_m: tuple[float, ...]
    gap_rad: float
    slack_rad: float | None
    age_ticks_mean: float | None
    conflicts: int
    delivery: float | None


DELIVERY_TICKS = 20
"""Over how many ticks ``Values.delivery`` is taken, the frame's own included."""


class Event(NamedTuple):
    """Something that happens at a tick: its kind, a short sentence, and the robots it is about."""

    kind: str
    text: str
    robots: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Frame:
    """One tick. The frame of the last tick has no decisions, no packets and no beliefs.

    ``target``: position; ``contacts``: pairs of names that touched since the tick before; ``lost``:
    who was not asked; ``silent``: whose radio is off by the scenario, and is not lost. ``modes``,
    ``xi``, ``points``, ``goals``: from each robot's command, None without one. ``ages``:
    ``ages[receiver][sender]`` of the newest packet that has arrived by now, in ticks since it was
    sent; -1 if none has, 0 for a robot itself. ``beliefs``: None of a robot that did not decide;
    ``beliefs_unsure``: the robots of which it cannot be worked out what they believe.
    """

    tick: int
    robots: tuple[Point, ...]
    headings_rad: tuple[float, ...]
    target: Point
    captured: bool
    contacts: tuple[tuple[str, str], ...]
    lost: tuple[bool, ...]
    silent: tuple[bool, ...]
    modes: tuple[str | None, ...]
    xi: tuple[float | None, ...]
    points: tuple[int | None, ...]
    goals: tuple[Point | None, ...]
    packets: tuple[Packet, ...]
    ages: tuple[tuple[int, ...], ...]
    beliefs: tuple[Belief | None, ...]
    beliefs_unsure: tuple[str, ...]
    values: Values
    events: tuple[Event, ...]
