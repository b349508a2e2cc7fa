"""What a robot can be told about how to hunt. Defaults are the paper's where it gives a value.

The others were chosen by measurement; ``docs/paper.md`` has the tables. The world sends the
parameters in ``setup``; a robot refuses names it does not know.
"""

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import pi
from typing import Any

from encircle.protocol.suggestions import did_you_mean

XI_MAX = 100.0
BODIES = ("radius_m", "target_radius_m", "step_m_max", "sensing_range_m", "stop_distance_m")
"""What every setup tells."""


class Problems(ValueError):
    """Several things that are wrong; ``lines`` has a sentence for each."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("; ".join(lines))
        self.lines = tuple(lines)


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters of one robot's brain; lengths in m, angles in rad, ages in ticks."""

    radius_m: float = 0.5
    target_radius_m: float = 0.5
    step_m_max: float = 0.3
    sensing_range_m: float = 6.0
    ring_radius_m: float = 4.0
    """rho, the radius of the ring of encirclement (Eq. 1)."""
    stop_distance_m: float = 1.3
    """D_stop: a robot this close to the target goes no further."""
    xi_grid: tuple[float, ...] = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    """Prediction steps to choose from (Eq. 3), ascending."""
    xi_weight: float = 0.05
    """k in f(xi) = exp(k xi) (Eq. 3)."""
    near_factor: float = 1.5
    """k1: robots within k1 rho are in the target's vicinity."""
    deviation_gain: float = 2.0
    """k2 (Eq. 6)."""
    enclosure_rad: float = 1.1 * pi
    """theta_th, the threshold of the enclosure test."""
    enclosure: str = "gap"
    """Reading of the enclosure test: ``gap``, ``span`` or ``printed`` (``planning.shrink``)."""
    allowance_rad: float = pi / 12
    """w, half the width of the allowance interval around 360/N degrees (Eq. 6)."""
    deviation_rad_max: float = pi / 3
    """Cap on the magnitude of beta (Eq. 6)."""
    spline_samples: int = 4
    """K, how many samples the spline is fitted to."""
    spline_spacing_ticks: int = 3
    """Ticks between two samples of the spline."""
    spline_ends: str = "natural"
    """End condition of the spline: ``natural`` or ``not-a-knot``."""
    measurement_m_std: float = 0.05
    """Standard deviation that the filter ascribes to a detection, per axis."""
    acceleration_mps2_std: float = 10.0
    """Standard deviation of the target's acceleration in the filter's motion model."""
    velocity_mps_std: float = 3.0
    """Standard deviation of the target's velocity before anything is known of it."""
    window_ticks: int = 30
    """How far back a late detection may lie and still be put in its place."""
    track_age_ticks_max: int = 30
    """A target not detected by anyone for longer is lost; the search begins again."""
    late_detections: str = "refilter"
    """Detections that an undelayed link would have brought earlier: ``refilter`` the window with
    them in their place, or ``ignore`` them."""
    detections: str = "own"
    """What packets tell of the target: the sender's ``own`` detection, or ``relay`` what others
    detected too."""
    relay_age_ticks_max: int = 10
    """Detections older than this, or than the window, are not passed on."""
    publish: str = "always"
    """At ticks at which a robot may publish: do so ``always``, or only on an ``event``, when its
    silence would mislead its peers (``encircle.agents.teamwork.publishing``)."""
    publish_every_ticks: int = 1
    """A robot may publish at ticks divisible by this."""
    publish_error_m: float = 0.3
    """How wrong peers may be about robot or target before that is an event."""
    publish_age_ticks_max: int = 10
    """A last packet this old is an event too."""
    peer_policy: str = "extrapolate"
    """What to do with a stale peer: ``hold`` its position or ``extrapolate`` its velocity."""
    extrapolate_ticks_max: int = 100_000
    """A peer is extrapolated by no more than this and held from there on."""
    peer_age_ticks_max: int = 50
    """Peers not heard of for longer are left out of the team."""
    switch_gain_m: float = 0.0
    """A robot keeps its encirclement point unless changing shortens the team's way by more."""
    search: str = "spiral"
    """Before anything is known of the target: ``hold`` still or ``spiral`` outwards."""
    silence_ticks_max: int = 10
    """In real time, a robot that has had no observation for so long stops and says no more."""
    clearance_m: float = 0.08
    """Distance kept between bodies by avoidance, beyond touching."""

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> "Parameters":
        """Parameters with some values replaced.

        Raises ``Problems`` naming every unknown key and every value that makes no sense.
        """
        known: dict[str, Any] = {f.name: f.default for f in fields(cls)}
        problems = [
            f"{name} = {shown(values[name])}: unknown parameter{did_you_mean(name, known)}"
            for name in values
            if name not in known
        ]
        given: dict[str, Any] = {}
        for name, value in values.items():
            default = known.get(name)
            if isinstance(default, tuple):
                if isinstance(value, list | tuple | range) and all(map(_is_number, value)):
                    given[name] = tuple(float(v) for v in value)
                else:
                    problems.append(f"{name} = {shown(value)}: must be a list of numbers")
            elif isinstance(default, str):
                if isinstance(value, str):
                    given[name] = value
                else:
                    problems.append(f"{name} = {shown(value)}: {_one_of(name, value)}")
            elif default is not None and not _is_number(value):
                problems.append(f"{name} = {shown(value)}: must be a number")
            elif isinstance(default, int) and value != int(value):
                problems.append(f"{name} = {shown(value)}: must be a whole number")
            elif default is not None:
                given[name] = type(default)(value)
        parameters = cls(**given)
        problems += parameters.problems()
        if problems:
            raise Problems(problems)
        return parameters

    def problems(self) -> list[str]:
        """What is wrong with the values; empty if nothing is."""
        lines = []
        for name, low, high in _RANGES:
            value = getattr(self, name)
            if not low <= value <= high:
                lines.append(f"{name} = {shown(value)}: must be from {low:g} to {high:g}")
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                value = getattr(self, name)
                lines.append(f"{name} = {shown(value)}: {_one_of(name, value)}")
        grid = self.xi_grid
        if (
            not 1 <= len(grid) <= 64
            or list(grid) != sorted(set(grid))
            or not 0 <= grid[0] <= grid[-1] <= XI_MAX
        ):
            lines.append(
                f"xi_grid = {list(grid)}: must be 1 to 64 ascending steps from 0 to {XI_MAX:g}"
            )
        if (self.spline_samples - 1) * self.spline_spacing_ticks >= self.window_ticks:
            lines.append(
                f"spline_samples = {self.spline_samples} every {self.spline_spacing_ticks} ticks:"
                f" must fit into window_ticks = {self.window_ticks}"
            )
        return lines


shown = reprlib.repr  # neither deep nor far, whatever a stranger sends


def _one_of(name: str, value: object) -> str:
    choices = _CHOICES[name]
    return f"must be one of {', '.join(choices)}{did_you_mean(value, choices)}"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12


_RANGES = (
    ("radius_m", 1e-3, 100.0),
    ("target_radius_m", 1e-3, 100.0),
    ("step_m_max", 1e-3, 100.0),
    ("sensing_range_m", 1e-3, 1e4),
    ("ring_radius_m", 1e-3, 1e4),
    ("stop_distance_m", 1e-3, 1e4),
    ("xi_weight", 0.0, 10.0),
    ("near_factor", 0.1, 100.0),
    ("deviation_gain", 0.0, 100.0),
    ("enclosure_rad", 0.0, 2 * pi),
    ("allowance_rad", 0.0, pi),
    ("deviation_rad_max", 0.0, pi),
    ("spline_samples", 2, 50),
    ("spline_spacing_ticks", 1, 50),
    ("measurement_m_std", 1e-4, 100.0),
    ("acceleration_mps2_std", 1e-4, 1e4),
    ("velocity_mps_std", 1e-4, 1e4),
    ("window_ticks", 2, 500),
    ("track_age_ticks_max", 1, 100_000),
    ("relay_age_ticks_max", 1, 500),
    ("publish_every_ticks", 1, 100_000),
    ("publish_error_m", 0.0, 1e4),
    ("publish_age_ticks_max", 1, 100_000),
    ("extrapolate_ticks_max", 0, 100_000),
    ("peer_age_ticks_max", 1, 100_000),
    ("switch_gain_m", 0.0, 1e4),
    ("silence_ticks_max", 1, 100_000),
    ("clearance_m", 0.0, 10.0),
)
_CHOICES = {
    "spline_ends": ("natural", "not-a-knot"),
    "enclosure": ("printed", "span", "gap"),
    "late_detections": ("refilter", "ignore"),
    "detections": ("own", "relay"),
    "publish": ("always", "event"),
    "peer_policy": ("hold", "extrapolate"),
    "search": ("hold", "spiral"),
}
