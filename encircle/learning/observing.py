"""What a learner sees: a robot's view as an array of fixed size.

``Layout`` says which number means what. All numbers but masks are parts of a named scale, which is
a parameter of the robot; all lie between -``BOUND`` and ``BOUND``. What is not known is 0, and its
mask is 0. Places are relative to the robot's own, along the axes of the arena. The peers stand in
robot order, beginning with the one after the robot itself, so that one policy can be every robot's.

The environment and a policy that is deployed call this same function. Only sums, products,
quotients and square roots are taken, which are the same to the last bit on every machine.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.agents.policies.interface import View
from encircle.learning.acting import spoken
from encircle.protocol.messages import Pose

Floats = NDArray[np.float32]
BOUND = 10.0
"""No number of an observation is larger."""
MASK = "mask"
FULL_SPEED = "step_m_max / tick_s"


class Field(NamedTuple):
    """One number of an observation. ``scale``: what its value is divided by, or ``MASK``."""

    name: str
    scale: str
    meaning: str


OWN = (
    Field("present", MASK, "1; 0 of a robot that is lost, all of whose numbers are 0"),
    Field("step_x", "step_m_max", "its own last step along x"),
    Field("step_y", "step_m_max", "the same along y"),
)
TARGET = (
    Field("target_known", MASK, "1 if there is an estimate of the target"),
    Field(
        "target_x",
        "sensing_range_m",
        "where the target is estimated to be, relative to the robot, along x",
    ),
    Field("target_y", "sensing_range_m", "the same along y"),
    Field("target_vx", FULL_SPEED, "the estimated velocity of the target along x"),
    Field("target_vy", FULL_SPEED, "the same along y"),
    Field("target_age", "track_age_ticks_max", "age of the newest detection in the estimate"),
    Field("target_std", "sensing_range_m", "standard deviation of its position, per axis"),
    Field("target_v_std", FULL_SPEED, "standard deviation of its velocity, per axis"),
    Field("target_correlation", "1", "correlation of position and velocity, per axis"),
)
PEER = (
    Field("known", MASK, "1 if the peer is planned with"),
    Field(
        "x",
        "sensing_range_m",
        "where the peer is believed to be now, relative to the robot, along x",
    ),
    Field("y", "sensing_range_m", "the same along y"),
    Field("vx", FULL_SPEED, "its velocity as last known, along x"),
    Field("vy", FULL_SPEED, "the same along y"),
    Field("age", "peer_age_ticks_max", "age of what was last known of it"),
    Field("seen", MASK, "1 if it is in sight"),
)
SAID = (
    Field("said", MASK, "1 if a payload of it was heard"),
    Field("said_age", "peer_age_ticks_max", "age of that payload"),
)
TOLD = Field("told{}", "1", "a number that it told, from 0 on")
RAY = Field("ray{}", "sensing_range_m", "distance to the nearest surface along it, from 0 on")


@dataclass(frozen=True, slots=True)
class Layout:
    """Which number of an observation means what.

    ``robots``: the size N of the team; ``payload``: how many numbers robots tell each other;
    ``rays``: those of the range scan, 0 if it is left out.
    """

    robots: int
    payload: int = 0
    rays: int = 0

    @property
    def size(self) -> int:
        """How many numbers an observation has."""
        return len(OWN) + len(TARGET) + (self.robots - 1) * self.peer_size + self.rays

    @property
    def peer_size(self) -> int:
        """How many numbers there are of each peer."""
        return len(PEER) + (len(SAID) + self.payload if self.payload else 0)

    @property
    def first_peer(self) -> int:
        """Where the numbers of the first peer begin; those of the next follow at once."""
        return len(OWN) + len(TARGET)

    def fields(self) -> Iterator[Field]:
        """The fields in order; ``peer1_x`` is of the next robot after one's own."""
        yield from OWN
        yield from TARGET
        of_peer = list(PEER)
        if self.payload:
            of_peer += [*SAID, *(_numbered(TOLD, k) for k in range(self.payload))]
        for peer in range(1, self.robots):
            yield from (field._replace(name=f"peer{peer}_{field.name}") for field in of_peer)
        yield from (_numbered(RAY, k) for k in range(self.rays))


def observation(view: View, *, payload: int = 0, scan: bool = False) -> Floats:
    """The numbers of a view as float32 (S,), as ``Layout`` has them.

    ``payload``: how many numbers the robots tell each other; ``scan``: with the range scan, whose R
    rays come last. Both as in ``parallel_env``.
    """
    parameters = view.parameters
    length_m, step_m = parameters.sensing_range_m, parameters.step_m_max
    speed_mps = step_m / view.tick_s
    x, y = view.position
    numbers = [1.0, view.last_step[0] / step_m, view.last_step[1] / step_m]
    target = view.target
    if target is None:
        numbers += [0.0] * len(TARGET)
    else:
        p00, p01, p11 = target.covariance
        spread = sqrt(p00 * p11) if p00 > 0.0 < p11 else 0.0
        numbers += (
            1.0,
            (target.x - x) / length_m,
            (target.y - y) / length_m,
            target.vx / speed_mps,
            target.vy / speed_mps,
            (view.target_age_ticks or 0) / parameters.track_age_ticks_max,
            sqrt(max(0.0, p00)) / length_m,
            sqrt(max(0.0, p11)) / speed_mps,
            p01 / spread if spread else 0.0,
        )
    seen = {robot for robot, _, _ in view.seen}
    places = dict(zip(view.members, view.positions, strict=True))
    for index in others_of(view.robot, view.team):
        place, known = places.get(index), view.known[index]
        if place is None or known is None:
            numbers += [0.0] * len(PEER)
        else:
            numbers += (
                1.0,
                (place[0] - x) / length_m,
                (place[1] - y) / length_m,
                known[3] / step_m,
                known[4] / step_m,
                (view.tick - known[0]) / parameters.peer_age_ticks_max,
                float(view.team[index] in seen),
            )
        if payload:
            numbers += _told(view.packets[index], view, payload)
    if scan:
        numbers += [distance / length_m for distance in view.scan]
    return np.array(numbers).clip(-BOUND, BOUND).astype(np.float32)


def _told(packet: Pose | None, view: View, payload: int) -> list[float]:
    """What a peer told last: its mask, age and numbers."""
    told = None if packet is None else spoken(packet.say, payload)
    if packet is None or told is None:
        return [0.0] * (len(SAID) + payload)
    return [1.0, (view.tick - packet.tick) / view.parameters.peer_age_ticks_max, *told]


def _numbered(field: Field, number: int) -> Field:
    return field._replace(name=field.name.format(number))


@lru_cache(maxsize=1024)
def others_of(robot: str, team: tuple[str, ...]) -> tuple[int, ...]:
    """The indices of the others in the team, beginning with the one after ``robot``."""
    own = team.index(robot)
    return (*range(own + 1, len(team)), *range(own))
