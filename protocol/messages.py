"""The messages, as frozen values: each field with its type, unit and meaning, declared here alone.

Checks, the order on the wire, the JSON schemas in recordings and the tables of docs/protocol.md
follow from these classes (``encircle.protocol.wire.declaration``). Units: metres, seconds, radians;
velocities in m/s. Links in a meaning lead to sections of docs/protocol.md.

Every position and step that crosses the wire is a whole multiple of ``QUANTUM_M`` (2**-20 m, about
a micron). That is finer than any sensor and coarser than floating-point noise, so that a last-bit
difference between two machines' mathematical libraries does not grow into a different run.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, Any

from encircle.protocol.endings import Reason
from encircle.protocol.real_time import Timing
from encircle.protocol.wire import checks
from encircle.protocol.wire.declaration import Field
from encircle.protocol.wire.field_types import (
    Angle,
    Boolean,
    CheckedBy,
    Count,
    Duration,
    FieldType,
    Integer,
    Items,
    Length,
    Packets,
    Payload,
    PlainMap,
    Real,
    Robots,
    Team,
    Text,
)
from encircle.protocol.wire.field_types import (
    Point as Point,
)
from encircle.protocol.wire.limits import RAYS_MAX, RAYS_MIN, RELAYED_MAX
from encircle.protocol.wire.payload import NOTHING_SAID
from encircle.protocol.wire.target_estimate import TargetEstimate

QUANTA_PER_M = float(2**20)
QUANTUM_M = 1.0 / QUANTA_PER_M
CAUSE_CODE_MAX = 12
"""Codes of causes of loss go from 1 to this."""


class PoseCarrier(StrEnum):
    """Who carries poses: the world, in the inboxes of observations, or the network directly."""

    WORLD = "world"
    DIRECT = "direct"


class CommandMode(StrEnum):
    """Modes of commands that no policy has chosen.

    ``FAILED``: the robot's own code has failed; it cannot go on, nor can the run. ``STOP``: in real
    time, unasked, when no observation comes: the robot stands still. ``STEERED``: somebody outside
    has decided, by ROS 2; what is in the run's messages does not say why.
    """

    FAILED = "failed"
    STOP = "stop"
    STEERED = "ros2"


def quantise_m(length_m: float) -> float:
    """Round a length in m to the nearest multiple of ``QUANTUM_M`` (ties to even)."""
    return round(length_m * QUANTA_PER_M) / QUANTA_PER_M


def _check_carrier(value: Any) -> PoseCarrier:
    if type(value) is str and (carrier := _CARRIERS.get(value)) is not None:
        return carrier
    raise ValueError(f"one of {', '.join(PoseCarrier)}")


_CARRIERS = {carrier.value: carrier for carrier in PoseCarrier}
_CARRIER = FieldType("text", "texts", {"type": "string", "enum": list(_CARRIERS)}, _check_carrier)


@dataclass(frozen=True, slots=True)
class Setup:
    """World to robot, at joining: all that a robot needs to know besides its own id.

    A robot that gets a setup forgets what it knew. Observations before ``answer_tick`` are only
    remembered, not answered: they bring a robot up to date that joins a run again which a new world
    has taken up.
    """

    robot: Annotated[Text, Field("the robot this is for")]
    team: Annotated[Team, Field("all robots, each once, in robot order, in which all ties break")]
    tick_s: Annotated[Duration, Field("length of a tick", "s")]
    strategy: Annotated[
        Text,
        Field("the name of its policy: one of [five names](#the-hunt), or that of a plug-in"),
    ]
    parameters: Annotated[PlainMap, Field("what the scenario sets, see below")] = field(
        default_factory=dict
    )
    radio: Annotated[
        PoseCarrier,
        _CARRIER,
        Field(
            "who carries poses: `world` (they come in the inbox) or `direct` (robots hear each"
            " other)"
        ),
    ] = PoseCarrier.WORLD
    first_tick: Annotated[Count, Field("the tick of the first observation that follows")] = 0
    answer_tick: Annotated[
        Count,
        Field(
            "the first tick to be answered; see [Leaving and coming back](#leaving-and-coming-back)"
        ),
    ] = 0
    policy_parameters: Annotated[
        PlainMap,
        Field("the policy's own parameters, by name", may_be_left_out=True),
    ] = NOTHING_SAID
    policy_source: Annotated[
        Text,
        Field(
            "SHA-256 of the file that the policy is in, as the world has it, if the policy is not a"
            " shipped one: a robot whose file is another refuses this setup",
            may_be_left_out=True,
        ),
    ] = ""


@dataclass(frozen=True, slots=True)
class Observation:
    """World to robot, once per tick: what its sensors and its radio give it."""

    robot: Annotated[Text, Field("the robot this is for")]
    tick: Annotated[Count, Field("0 at first, then one more each time")]
    position: Annotated[
        Point, Field("its own position, with the scenario's localisation error", "m")
    ]
    heading_rad: Annotated[
        Angle,
        Field(
            "direction it faces or, if it can move any way at once, in which it last set out;"
            " 0 at first",
            "rad",
        ),
    ]
    target: Annotated[
        Point | None,
        Field(
            "its own detection of the target, with the scenario's noise and the error of"
            " `position`; null if out of range or sight",
            "m",
        ),
    ]
    scan: Annotated[
        tuple[Length, ...],
        Items(RAYS_MAX, RAYS_MIN),
        CheckedBy(checks.scan),
        Field(
            "`scan[m]`: distance from the robot's centre along bearing `2 pi m / M`, in the world"
            " frame, to the nearest surface, from 0 to the sensing range, which also stands for"
            " nothing there; M is 8 to 360, 24 by default",
            "m",
        ),
    ]
    seen: Annotated[
        tuple[tuple[Text, Real, Real], ...],
        CheckedBy(checks.sightings),
        Field(
            "other robots in range and in sight: id, x, y, with the error of `position`, each once,"
            " in robot order",
            "m",
        ),
    ]
    inbox: Annotated[
        Packets,
        Field(
            "the pose packets that the radio delivers at this tick, as their senders encoded them"
        ),
    ]
    lost: Annotated[
        Robots,
        Field(
            "the other robots that have [left](#leaving-and-coming-back) and are not back, each"
            " once, in robot order"
        ),
    ] = ()
    sent_us: Annotated[
        Count | None,
        Field(
            "the world's clock as it sent this, Unix time in us; null in lock-step, where no clock"
            " may show",
            "us",
        ),
    ] = None
    admitted: Annotated[
        tuple[tuple[Text, Count], ...] | None,
        Field(
            "where robots hear each other: the packets, by sender and sequence, that the modelled"
            " radio lets through at this tick; null if it lets everything through, and in lock-step"
        ),
    ] = None
    answered: Annotated[
        Count | None,
        Field(
            "by the clock: the tick of this robot's newest command that has come since its setup,"
            " null if none has; in lock-step null"
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class Pose:
    """Robot to its peers, by radio: where it is, what it saw of the target, what it is up to."""

    robot: Annotated[Text, Field("the sender")]
    tick: Annotated[Count, Field("the tick that is being answered")]
    sequence: Annotated[
        Count,
        Field(
            "the sender's own numbering; the tick, in this code, so that a silent tick leaves a"
            " gap; [by the clock](#by-the-clock) one by one"
        ),
    ]
    position: Annotated[Point, Field("where it is", "m")]
    velocity: Annotated[
        Point, Field("here the last step divided by `tick_s`, zero at tick 0", "m/s")
    ]
    detection: Annotated[
        Point | None, Field("where it detected the target *at this tick, itself*", "m")
    ]
    mode: Annotated[
        Text, Field("what it is up to: here `search`, `encircle`, `shrink` or `pursue`")
    ]
    xi: Annotated[Real | None, Field("the prediction step it chose", "ticks")]
    point: Annotated[
        Count | None,
        Field(
            "which encirclement point of its ring it heads for, from 0, [which](#the-hunt) lies"
            " where the robot farthest from the target is"
        ),
    ]
    relayed: Annotated[
        tuple[tuple[Text, Count, Real, Real], ...],
        Items(RELAYED_MAX),
        CheckedBy(checks.relayed),
        Field(
            "where others detected the target at earlier ticks, so that a detection can take a way"
            " round a bad link: origin, tick, x, y",
            "m",
        ),
    ] = ()
    sent_us: Annotated[
        Count | None,
        Field("the sender's clock as it sent this, Unix time in us; null in lock-step", "us"),
    ] = None
    say: Annotated[
        Payload,
        Field(
            "what its policy says to its peers, see [What policies say](#what-policies-say)",
            may_be_left_out=True,
        ),
    ] = NOTHING_SAID
    estimate: Annotated[
        TargetEstimate | None,
        Field(
            "where it believes the target to be at this tick, [told](#estimates) instead of"
            " detections: tick of the newest detection in it, x, y, vx, vy, and per axis the"
            " covariance p00, p01, p11",
            "m, s",
            may_be_left_out=True,
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class Command:
    """Robot to world, once per tick: the step it wants to make, and for the record why."""

    robot: Annotated[Text, Field("the sender")]
    tick: Annotated[Count, Field("the tick that is being answered")]
    step: Annotated[Point, Field("the displacement it wants to make until the next tick", "m")]
    mode: Annotated[
        Text,
        Field(
            "as in Pose, for the record, as all that follows; but a command with mode `failed`,"
            " without a pose, says that the robot's own code has failed: it counts for nothing"
            " else, and the world ends the run as failed; `ros2` if [ROS 2](ros2.md) has decided"
        ),
    ]
    xi: Annotated[Real | None, Field("as in Pose", "ticks")]
    point: Annotated[Count | None, Field("as in Pose")]
    goal: Annotated[Point | None, Field("the point it heads for", "m")]
    estimate: Annotated[Point | None, Field("where it believes the target to be", "m")]
    predictor: Annotated[
        Text | None, Field("what predicted the target: here `spline`, `velocity` or `hold`")
    ]
    team: Annotated[Robots, Field("the robots it planned with")]
    published: Annotated[
        Boolean,
        Field("whether it sends a pose at this tick; if not, [this is the whole answer](#a-round)"),
    ] = True
    refused: Annotated[
        Mapping[Text, Count],
        Field(
            "how many messages it has refused so far, by [cause](#what-is-refused); under"
            " `late-detection`, how many detections or estimates came too late for its filter"
        ),
    ] = field(default_factory=dict)
    timing: Annotated[
        Timing | None,
        Field(
            "null in lock-step; else when, by the robot's clock in us, the observation came, when"
            " this was sent, and [what it has heard when](#by-the-clock): sender, number, us",
            "us",
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class End:
    """World to robot: the run is over."""

    robot: Annotated[Text, Field("the robot this is for")]
    tick: Annotated[Count, Field("the last tick")]
    reason: Annotated[
        Reason,
        Field(
            "`captured`, `ticks` (the scenario's limit is reached), or `failed: ` and why; at most"
            " 200 characters in all"
        ),
    ]


@dataclass(frozen=True, slots=True)
class State:
    """World to anyone who looks on: the truth at a tick."""

    tick: Annotated[Count, Field("the tick")]
    robots: Annotated[tuple[Point, ...], Field("positions in robot order", "m")]
    headings_rad: Annotated[
        tuple[Angle, ...], Field("the directions in which they last set out, likewise", "rad")
    ]
    target: Annotated[Point, Field("position", "m")]
    captured: Annotated[Boolean, Field("whether the hunt ended here in a capture")]
    contacts: Annotated[
        tuple[tuple[Text, Text], ...],
        Field("bodies that touched since the last tick: `r1`..., `target`, `obstacle-1`..."),
    ]


@dataclass(frozen=True, slots=True)
class Intervention:
    """World to recorders and anyone who looks on: an event that was given while the run goes on."""

    tick: Annotated[Count, Field("the tick at which it was given")]
    event: Annotated[
        PlainMap,
        Field(
            "the event as a scenario has it under `events`, with the `tick` at which it takes"
            " effect, without keys that have their defaults"
        ),
    ]


@dataclass(frozen=True, slots=True)
class Radio:
    """World to anyone who looks on: the fate of each packet sent at a tick."""

    tick: Annotated[Count, Field("when they were sent")]
    fates: Annotated[
        tuple[tuple[Integer, ...], ...],
        Field(
            "N x N, `fates[sender][receiver]`: the tick of delivery, or minus the code of the cause"
            " of loss, or 0 where there was no packet: on the diagonal, and in the row of a robot"
            " that kept silent"
        ),
    ]
    copies: Annotated[
        tuple[tuple[Integer, ...], ...],
        Field(
            "N x N, `copies[sender][receiver]`: the tick at which a second copy of the packet is"
            " delivered that the radio made, or 0 if it made none; an empty list if the scenario's"
            " radio makes no copies"
        ),
    ] = ()
