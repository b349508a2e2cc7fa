"""The messages, as frozen values. Units: metres, seconds, radians; velocities in m/s.

Every position and step that crosses the wire is a whole multiple of ``QUANTUM_M`` (2**-20 m, about
a micron). That is finer than any sensor and coarser than floating-point noise, so that a last-bit
difference between two machines' mathematical libraries does not grow into a different run.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

Point: TypeAlias = tuple[float, float]
Timing: TypeAlias = tuple[int, int, tuple[tuple[str, int, int], ...]]

QUANTA_PER_M = float(2**20)
QUANTUM_M = 1.0 / QUANTA_PER_M
RELAYED_MAX = 16
HEARD_MAX = 256
RAYS_MIN, RAYS_MAX = 8, 360
REASON_MAX = 200
ENDS = ("captured", "ticks")
FAILED_PREFIX = "failed: "
"""What the reason of a run that failed begins with."""
CAUSE_CODE_MAX = 10
"""Codes of causes of loss go from 1 to this."""
RADIOS = ("world", "direct")
FAILED = "failed"
"""Mode of the command of a robot whose own code has failed: it cannot go on, nor can the run."""


def quantise_m(length_m: float) -> float:
    """Round a length in m to the nearest multiple of ``QUANTUM_M`` (ties to even)."""
    return round(length_m * QUANTA_PER_M) / QUANTA_PER_M


@dataclass(frozen=True, slots=True)
class Setup:
    """World to robot, at joining: all that a robot needs to know besides its own id.

    ``team`` lists every robot's id in robot order, the order in which all ties break. A robot that
    gets a setup forgets what it knew: ``first_tick`` is the tick of its first observation, and
    observations before ``answer_tick`` are only remembered, not answered (they bring a robot up to
    date that joins a run again which a new world has taken up). ``radio`` is who carries poses:
    ``world`` (they come in the observation's inbox) or ``direct`` (robots hear each other).
    """

    robot: str
    team: tuple[str, ...]
    tick_s: float
    strategy: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    radio: str = "world"
    first_tick: int = 0
    answer_tick: int = 0


@dataclass(frozen=True, slots=True)
class Observation:
    """World to robot, once per tick: what its sensors and its radio give it.

    ``scan[m]`` is the distance in m from the robot's centre to the nearest surface along the ray
    with bearing ``2 pi m / len(scan)`` in the world frame, or the sensing range if there is none.
    ``seen`` holds the robots in range and in sight as ``(id, x, y)``. ``inbox`` holds the pose
    packets that the radio delivers at this tick, as their senders encoded them. ``lost`` names the
    robots whose liveliness tokens are gone. ``sent_us`` is the sender's clock (Unix time in us) in
    real time, None in lock-step, where no clock may show. ``admitted`` is the inbox by reference,
    where robots hear each other: the packets ``(sender, sequence)`` that the modelled radio lets
    through at this tick, None if it lets everything through. ``answered`` is the tick of this
    robot's newest command that has reached the world, in real time; None if there is none.
    """

    robot: str
    tick: int
    position: Point
    heading_rad: float
    target: Point | None
    scan: tuple[float, ...]
    seen: tuple[tuple[str, float, float], ...]
    inbox: tuple[bytes, ...]
    lost: tuple[str, ...] = ()
    sent_us: int | None = None
    admitted: tuple[tuple[str, int], ...] | None = None
    answered: int | None = None


@dataclass(frozen=True, slots=True)
class Pose:
    """Robot to its peers, by radio: where it is, what it saw of the target, what it is up to.

    ``detection`` is the sender's own, of this tick. ``relayed`` passes on what others detected
    earlier, each as ``(origin, tick, x, y)``, at most ``RELAYED_MAX``, so that a detection can take
    a way round a bad link. ``sent_us``: as in ``Observation``.
    """

    robot: str
    tick: int
    sequence: int
    position: Point
    velocity: Point
    detection: Point | None
    mode: str
    xi: float | None
    point: int | None
    relayed: tuple[tuple[str, int, float, float], ...] = ()
    sent_us: int | None = None


@dataclass(frozen=True, slots=True)
class Command:
    """Robot to world, once per tick: the step it wants to make, and for the record why.

    ``estimate`` is its estimate of the target's position, ``goal`` the point it heads for, ``team``
    the robots it planned with, ``predictor`` what made the prediction (``spline``, ``velocity`` or
    ``hold``), ``refused`` how many messages it has refused so far by cause, and under
    ``late-detection`` how many detections came too late for its filter. ``published`` tells whether
    the robot sends its peers a pose at this tick; if not, the command alone is its answer.
    ``timing`` is None in lock-step, and in real time what the robot's clock said: when the
    observation came, when this was sent, and what came before, oldest first, as ``(sender, number,
    us)``: poses heard directly, and observations (``encircle.protocol.real_time``).
    """

    robot: str
    tick: int
    step: Point
    mode: str
    xi: float | None
    point: int | None
    goal: Point | None
    estimate: Point | None
    predictor: str | None
    team: tuple[str, ...]
    published: bool = True
    refused: Mapping[str, int] = field(default_factory=dict)
    timing: Timing | None = None


@dataclass(frozen=True, slots=True)
class End:
    """World to robot: the run is over. ``reason`` is ``captured``, ``ticks`` or ``failed: ...``."""

    robot: str
    tick: int
    reason: str


@dataclass(frozen=True, slots=True)
class State:
    """World to anyone who looks on: the truth at a tick.

    ``robots``: N positions in robot order. ``headings_rad``: the directions in which they last set
    out. ``contacts``: pairs of body names whose motion was cut short by touching since the last
    tick.
    """

    tick: int
    robots: tuple[Point, ...]
    headings_rad: tuple[float, ...]
    target: Point
    captured: bool
    contacts: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Radio:
    """World to recorders: the fate of each packet sent at a tick.

    ``fates[sender][receiver]`` is the tick at which the packet will be delivered, or minus a cause
    code (``encircle.world.channel.channel.CAUSES``) if it is lost; 0 where there was no packet.
    ``copies``, likewise, are the ticks at which duplicates made by the radio will be delivered;
    empty if there are none.
    """

    tick: int
    fates: tuple[tuple[int, ...], ...]
    copies: tuple[tuple[int, ...], ...] = ()
