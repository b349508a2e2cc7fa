"""Parameters of how a robot hunts. Defaults are the paper's where it gives a value.

The others were chosen by measurement; ``docs/paper.md`` has the tables. The world sends the
parameters in ``setup``; a robot refuses names it does not know.

Each parameter is declared once, as a field of ``Parameters``: its type carries range or choices and
the unit, the docstring below it the meaning. Checks, refusals and the table in ``docs/scenario.md``
follow from that.
"""

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from math import pi
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from encircle.protocol.errors import did_you_mean

XI_MAX = 100.0
XI_COUNT_MAX = 64
AGE_TICKS_MAX = 100_000
NUMBER_MAX = 1e12


class Problems(ValueError):
    """Several things that are wrong; ``lines`` has a sentence for each."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("; ".join(lines))
        self.lines = tuple(lines)


@dataclass(frozen=True, slots=True)
class Unit:
    """In a field's type: the unit of its value, as text. A field without one is a plain number."""

    symbol: str


@dataclass(frozen=True, slots=True)
class Range:
    """In a field's type: the smallest and the largest value."""

    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Meaning:
    """In the type of a plug-in's own parameter: what it means, in a sentence."""

    text: str


Body = Annotated[float, Range(1e-3, 100.0), Unit("m")]
Length = Annotated[float, Range(1e-3, 1e4), Unit("m")]
LengthOrZero = Annotated[float, Range(0.0, 1e4), Unit("m")]
Angle = Annotated[float, Range(0.0, pi), Unit("rad")]
Age = Annotated[int, Range(1, AGE_TICKS_MAX), Unit("ticks")]


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters of one robot's brain; lengths in m, angles in rad, ages in ticks."""

    radius_m: Body = 0.5
    """Radius of the robots' bodies."""
    target_radius_m: Body = 0.5
    """Radius of the target's body."""
    step_m_max: Body = 0.3
    """The longest step that a robot makes in a tick."""
    sensing_range_m: Length = 6.0
    """How far a robot detects the target, obstacles and other robots."""
    ring_radius_m: Length = 4.0
    """rho, the radius of the ring of encirclement (Eq. 1)."""
    stop_distance_m: Length = 1.3
    """D_stop: a robot this close to the target goes no further."""
    xi_grid: tuple[float, ...] = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    """Prediction steps to choose from (Eq. 3), ascending: 1 to 64 of them, from 0 to 100."""
    xi_weight: Annotated[float, Range(0.0, 10.0)] = 0.05
    """k in f(xi) = exp(k xi) (Eq. 3)."""
    near_factor: Annotated[float, Range(0.1, 100.0)] = 1.5
    """k1: robots within k1 rho are in the target's vicinity."""
    deviation_gain: Annotated[float, Range(0.0, 100.0)] = 2.0
    """k2 (Eq. 6)."""
    enclosure_rad: Annotated[float, Range(0.0, 2 * pi), Unit("rad")] = 1.1 * pi
    """theta_th, the threshold of the enclosure test."""
    enclosure: Literal["printed", "span", "gap"] = "gap"
    """Reading of the enclosure test: ``gap``, ``span`` or ``printed`` (``planning.shrink``)."""
    allowance_rad: Angle = pi / 12
    """w, half the width of the allowance interval around 360/N degrees (Eq. 6)."""
    deviation_rad_max: Angle = pi / 3
    """Cap on the magnitude of beta (Eq. 6)."""
    spline_samples: Annotated[int, Range(2, 50)] = 4
    """K, how many samples the spline is fitted to; they must fit into ``window_ticks``."""
    spline_spacing_ticks: Annotated[int, Range(1, 50), Unit("ticks")] = 3
    """Time between two samples of the spline."""
    spline_ends: Literal["natural", "not-a-knot"] = "natural"
    """End condition of the spline."""
    measurement_m_std: Annotated[float, Range(1e-4, 100.0), Unit("m")] = 0.05
    """Standard deviation that the filter ascribes to a detection, per axis."""
    acceleration_mps2_std: Annotated[float, Range(1e-4, 1e4), Unit("m/s^2")] = 10.0
    """Standard deviation of the target's acceleration in the filter's motion model."""
    velocity_mps_std: Annotated[float, Range(1e-4, 1e4), Unit("m/s")] = 3.0
    """Standard deviation of the target's velocity before anything is known of it."""
    window_ticks: Annotated[int, Range(2, 500), Unit("ticks")] = 30
    """How old a late detection may be and still enter the filter at its own tick."""
    track_age_ticks_max: Age = 30
    """A target that nobody has detected for longer is lost, and the search begins again."""
    late_detections: Literal["refilter", "ignore"] = "refilter"
    """Detections that would have come earlier without delay: ``refilter`` the window with each at
    its own tick, or ``ignore`` them."""
    detections: Literal["own", "relay", "fuse", "fuse-naive"] = "own"
    """What packets tell of the target: the sender's ``own`` detections, or also (``relay``) those
    of others; or its estimate instead, which receivers ``fuse`` with theirs by covariance
    intersection, or (``fuse-naive``) as if the two were independent, to be compared with."""
    relay_age_ticks_max: Annotated[int, Range(1, 500), Unit("ticks")] = 10
    """Detections older than this, or than the window, are not relayed."""
    publish: Literal["always", "event"] = "always"
    """When a robot publishes, at ticks at which it may: ``always``, or only on an ``event``, when
    its silence would mislead its peers (``encircle.agents.teamwork.publishing``)."""
    publish_every_ticks: Age = 1
    """A robot may publish at ticks divisible by this."""
    publish_error_m: LengthOrZero = 0.3
    """An error of the peers' belief about robot or target that is above this is an event."""
    publish_age_ticks_max: Age = 10
    """It is an event too that the robot's newest packet is this old."""
    peer_policy: Literal["hold", "extrapolate"] = "extrapolate"
    """Where a peer with an old pose is taken to be: ``hold`` its position, or ``extrapolate`` it
    with its velocity."""
    extrapolate_ticks_max: Annotated[int, Range(0, AGE_TICKS_MAX), Unit("ticks")] = AGE_TICKS_MAX
    """A peer is extrapolated over this time at most, and held from there on."""
    peer_age_ticks_max: Age = 50
    """Peers with an older pose are left out of the team."""
    assignment: Literal["shortest", "cyclic"] = "shortest"
    """Who goes to which point, in the paper's policies: the ``shortest`` way in total (Algorithm
    1), or in ``cyclic`` order of bearings, which is a little longer and far cheaper with many."""
    switch_gain_m: LengthOrZero = 0.0
    """A robot keeps its encirclement point unless a change shortens the team's way by more."""
    search: Literal["hold", "spiral"] = "spiral"
    """Before anything is known of the target: ``hold`` still or ``spiral`` outwards."""
    silence_ticks_max: Age = 10
    """In real time, a robot without observations for so long stops and sends no more."""
    clearance_m: Annotated[float, Range(0.0, 10.0), Unit("m")] = 0.08
    """Distance between bodies, beyond touching, that avoidance keeps."""

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> "Parameters":
        """Parameters with some values replaced.

        Raises ``Problems`` naming every unknown key and every value that makes no sense.
        """
        known = declared()
        problems = [
            f"{name} = {shown(values[name])}: unknown parameter{did_you_mean(name, known)}"
            for name in values
            if name not in known
        ]
        given: dict[str, Any] = {}
        for name, value in values.items():
            if name in known:
                try:
                    given[name] = _converted(known[name], value)
                except ValueError as error:
                    problems.append(f"{name} = {shown(value)}: {error}")
        parameters = cls(**given)
        problems += parameters.problems()
        if problems:
            raise Problems(problems)
        return parameters

    def problems(self) -> list[str]:
        """What is wrong with the values; empty if nothing is."""
        lines = []
        for name, parameter in declared().items():
            value = getattr(self, name)
            if parameter.choices and value not in parameter.choices:
                lines.append(f"{name} = {shown(value)}: {_one_of(parameter.choices, value)}")
            elif parameter.range and not parameter.range.low <= value <= parameter.range.high:
                low, high = parameter.range.low, parameter.range.high
                lines.append(f"{name} = {shown(value)}: must be from {low:g} to {high:g}")
        grid = self.xi_grid
        if (
            not 1 <= len(grid) <= XI_COUNT_MAX
            or list(grid) != sorted(set(grid))
            or not 0 <= grid[0] <= grid[-1] <= XI_MAX
        ):
            lines.append(
                f"xi_grid = {list(grid)}: must be 1 to {XI_COUNT_MAX} ascending steps"
                f" from 0 to {XI_MAX:g}"
            )
        if self.detections.startswith("fuse") and self.publish == "event":
            lines.append(
                f"publish = 'event': must be always where detections = {self.detections!r}:"
                " what peers know of an estimate that each fuses with its own cannot be worked out"
            )
        if (self.spline_samples - 1) * self.spline_spacing_ticks >= self.window_ticks:
            lines.append(
                f"spline_samples = {self.spline_samples} every {self.spline_spacing_ticks} ticks:"
                f" must fit into window_ticks = {self.window_ticks}"
            )
        return lines


BODIES = ("radius_m", "target_radius_m", "step_m_max", "sensing_range_m", "stop_distance_m")
"""Parameters that every setup holds: they follow from the scenario's team, target and capture."""
SET_BY_ROBOT_KEYS = tuple(f.name for f in fields(Parameters) if f.name not in BODIES)
"""Those that a scenario sets under ``robot``."""


class Parameter(NamedTuple):
    """One parameter as it is declared; ``range`` and ``choices`` where there are any."""

    name: str
    type: type
    default: Any
    range: Range | None
    choices: tuple[str, ...]
    unit: str


@cache
def declared() -> Mapping[str, Parameter]:
    """All parameters by name, read off the fields of ``Parameters``."""
    hints = get_type_hints(Parameters, include_extras=True)
    return {
        field.name: _declared(field.name, hints[field.name], field.default)
        for field in fields(Parameters)
    }


def _declared(name: str, annotation: Any, default: Any) -> Parameter:
    marks = annotation.__metadata__ if get_origin(annotation) is Annotated else ()
    return Parameter(
        name,
        type(default),
        default,
        next((mark for mark in marks if isinstance(mark, Range)), None),
        get_args(annotation) if get_origin(annotation) is Literal else (),
        next((mark.symbol for mark in marks if isinstance(mark, Unit)), ""),
    )


shown = reprlib.repr
"""A value as refusals show it: neither deep nor long, whatever a stranger sends."""


def _converted(parameter: Parameter, value: Any) -> Any:
    """A value as the parameter's type; ``ValueError`` says what it must be."""
    if parameter.type is tuple:
        if not (isinstance(value, list | tuple | range) and all(map(_is_number, value))):
            raise ValueError("must be a list of numbers")
        return tuple(float(v) for v in value)
    if parameter.choices:
        if not isinstance(value, str):
            raise ValueError(_one_of(parameter.choices, value))
        return value
    if not _is_number(value):
        raise ValueError("must be a number")
    if parameter.type is int and value != int(value):
        raise ValueError("must be a whole number")
    return parameter.type(value)


def _one_of(choices: Sequence[str], value: object) -> str:
    return f"must be one of {', '.join(choices)}{did_you_mean(value, choices)}"


def _is_number(value: object) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < NUMBER_MAX
    )
