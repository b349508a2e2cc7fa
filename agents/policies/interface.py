"""What a policy is: from what a robot remembers and sees to where it wants to step.

A policy is any callable of the form of ``Policy``: a function

    def policy(memory, view, *, own_parameter=default): return memory, Decision(...)

It is pure: same memory, same view, same answer. What it wants to remember it returns and is given
back at the next tick. Keyword-only arguments are its own parameters, set in the scenario under
``team.policy_parameters``. What it says (``Decision.say``) travels to its peers in the robot's
pose packet, through the same channel. The brain shortens the step to what the robot can do and
keeps it from collisions.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

from numpy import float64
from numpy.typing import NDArray

from encircle.agents.estimation.kalman import Estimate
from encircle.agents.teamwork.peers import PeerTable
from encircle.protocol.messages import Point, Pose
from encircle.protocol.parameters import Parameters

Predict: TypeAlias = Callable[[tuple[float, ...]], tuple[NDArray[float64], str]]


class Decision(NamedTuple):
    """What a policy wants, and the reasons, for peers and for the record."""

    mode: str
    """A word for what it is up to: told to the peers, shown and recorded."""
    step: Point
    """The displacement it wants, in m; the brain shortens it and keeps it from collisions."""
    goal: Point
    """The point it heads for, in m."""
    xi: float | None = None
    """The prediction step it chose, in ticks."""
    point: int | None = None
    """Which encirclement point it heads for, from 0."""
    predictor: str | None = None
    """What predicted the target, as ``View.predict`` says."""
    say: Mapping[str, Any] | None = None
    """What its peers are to hear: texts as keys, and numbers that are finite, texts, bytes, truth
    values, None, lists and maps of these, at most 1,024 bytes as msgpack."""


class Peer(NamedTuple):
    """A peer as this robot believes it to be now, from what was last known of it."""

    robot: str
    """Its id."""
    position: Point
    """Where it is believed to be now, (x, y) in m."""
    velocity: Point
    """Its velocity as last known, in m/s."""
    age_ticks: int
    """The age of what was last known of it."""
    packet: Pose | None
    """The newest packet of it that was heard, with its intent (``mode``, ``xi``, ``point``) and
    what its policy said (``say``); None if it was only seen."""


class View(NamedTuple):
    """What a policy decides on: one robot's own, possibly stale, view of the hunt."""

    tick: int
    """The number of this tick; time is ``tick * tick_s``."""
    tick_s: float
    """Length of a tick, in s."""
    robot: str
    """Its own id."""
    team: tuple[str, ...]
    """The ids of all robots, in robot order."""
    position: Point
    """Its own position, in m, as it believes."""
    own: int
    """Its own index among ``positions``."""
    positions: tuple[Point, ...]
    """Where those that it plans with are believed to be now, itself included, in robot order, in
    m."""
    target: Estimate | None
    """The estimate of the target: ``x``, ``y`` in m, ``vx``, ``vy`` in m/s, ``covariance`` (p00,
    p01, p11) of position and velocity along each axis, ``position``; None if nothing is known."""
    predict: Predict
    """From a tuple of G prediction steps in ticks to the target's predicted positions (G, 2) in m,
    and what predicted them; not to be called without a target."""
    parameters: Parameters
    """The robot's parameters."""
    previous_goal: Point | None = None
    """The encirclement point it headed for at the tick before, in m, None if for none."""
    last_step: Point = (0.0, 0.0)
    """What it did since the tick before, in m; per tick, where by the clock some were left out."""
    members: tuple[int, ...] = ()
    """Who ``positions`` are of, as indices into ``team``."""
    heard: tuple[Pose, ...] = ()
    """The packets delivered at this tick, by tick, sender and sequence."""
    target_age_ticks: int | None = None
    """The age of the newest detection in the estimate; None without one."""
    scan: tuple[float, ...] = ()
    """Distances in m to the nearest surface along equally spaced rays, the first along +x."""
    seen: tuple[tuple[str, float, float], ...] = ()
    """The robots in sight: id, x, y in m."""
    search: Decision | None = None
    """What the default search does while nothing is known of the target, for a policy to answer or
    to replace; else None."""
    known: PeerTable = ()
    """What is known of each member of the team, by its index; ``peers`` is made of it."""
    packets: tuple[Pose | None, ...] = ()
    """The newest packet heard from each member of the team, by its index."""

    @property
    def peers(self) -> tuple[Peer, ...]:
        """The peers that are planned with, in robot order."""
        peers = []
        for index, position in zip(self.members, self.positions, strict=True):
            entry = self.known[index]
            if self.team[index] != self.robot and entry is not None:
                tick, _, _, vx, vy = entry
                velocity = (vx / self.tick_s, vy / self.tick_s)
                packet = self.packets[index]
                peers.append(Peer(self.team[index], position, velocity, self.tick - tick, packet))
        return tuple(peers)


Policy: TypeAlias = Callable[..., tuple[Any, Decision]]
"""``(memory, view, **own parameters) -> (memory, decision)``: what it remembers (None at first) and
sees to what it will remember (anything that can be pickled) and what it wants."""
