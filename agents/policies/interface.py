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
    """What a policy wants, and the reasons, for peers and for the record.

    ``step``: the displacement it wants, in m; ``goal``: the point it heads for, in m; ``mode``: a
    word for what it is up to; ``xi``: the prediction step it chose, in ticks, and ``predictor``
    what predicted; ``point``: which encirclement point it heads for, from 0. ``say``: what its
    peers are to hear, at most 1,024 bytes as msgpack: text keys, and numbers that are finite, text,
    bytes, booleans, None, or lists and maps of these.
    """

    mode: str
    step: Point
    goal: Point
    xi: float | None = None
    point: int | None = None
    predictor: str | None = None
    say: Mapping[str, Any] | None = None


class Peer(NamedTuple):
    """A peer as this robot believes it to be now.

    ``position`` in m and ``velocity`` in m/s, as believed now from what was last known of it,
    ``age_ticks`` ago. ``packet``: the newest packet of it that was heard, with its intent
    (``mode``, ``xi``, ``point``) and what its policy said (``say``); None if it was only seen.
    """

    robot: str
    position: Point
    velocity: Point
    age_ticks: int
    packet: Pose | None


class View(NamedTuple):
    """What a policy decides on: one robot's own, possibly stale, view of the hunt.

    ``robot``: its id; ``team``: all ids, in robot order. ``position``: its own, and ``last_step``
    what it did since the tick before, in m. ``positions``: where those that it plans with are
    believed to be now, in m, in robot order and itself included; ``own``: which of them it is;
    ``members``: who they are, as indices into ``team``. ``heard``: the packets delivered at this
    tick, by tick, sender and sequence. ``target``: its estimate, None while nothing is known;
    ``target_age_ticks``: the age of the newest detection in it. ``predict``: from a tuple of G
    prediction steps in ticks to predicted target positions (G, 2) in m, and what predicted them;
    not to be called without a target. ``scan``: distances in m to the nearest surface along equally
    spaced rays, the first along +x; ``seen``: id, x, y of robots in sight, in m. ``parameters``:
    the robot's. ``previous_goal``: the encirclement point it headed for at the tick before, None if
    for none. ``search``: what to do without a target, which a policy may answer then.
    """

    tick: int
    tick_s: float
    robot: str
    team: tuple[str, ...]
    position: Point
    own: int
    positions: tuple[Point, ...]
    target: Estimate | None
    predict: Predict
    parameters: Parameters
    previous_goal: Point | None = None
    last_step: Point = (0.0, 0.0)
    members: tuple[int, ...] = ()
    heard: tuple[Pose, ...] = ()
    target_age_ticks: int | None = None
    scan: tuple[float, ...] = ()
    seen: tuple[tuple[str, float, float], ...] = ()
    search: Decision | None = None
    known: PeerTable = ()
    """What is known of each member of the team, by its index (``Peer`` is made of it)."""
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
