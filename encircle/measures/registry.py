"""Every measure of a run by name: what a study tabulates.

A measure is a function from a log to one number. Averages are over the ticks of the run (and over
robots, links or packets, where there are several), so that a run counts once however long it took;
NaN stands where there is nothing to average. ``docs/measures.md`` defines each one.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from encircle.measures import belief, choice, motion, radio
from encircle.runlog.runlog import RunLog


@dataclass(frozen=True, slots=True)
class Measure:
    """One measure: the name of its column, its unit (1 for none), what it is, how it is had."""

    name: str
    unit: str
    description: str
    function: Callable[[RunLog], float]


def _table(
    *rows: tuple[Callable[[RunLog], float], str],
) -> Mapping[str, Measure]:
    return {
        function.__name__: Measure(function.__name__, unit, function.__doc__ or "", function)
        for function, unit in rows
    }


MEASURES: Mapping[str, Measure] = _table(
    (motion.captured, "1"),
    (motion.capture_tick, "tick"),
    (motion.capture_s, "s"),
    (motion.ring_tick, "tick"),
    (motion.ring_s, "s"),
    (motion.path_m_mean, "m"),
    (motion.path_m_total, "m"),
    (motion.effort_m2ps_mean, "m^2/s"),
    (motion.separation_robots_m_min, "m"),
    (motion.separation_m_min, "m"),
    (motion.contacts, "1"),
    (motion.collisions, "1"),
    (motion.gap_rad_mean, "rad"),
    (motion.gap_rad_final, "rad"),
    (motion.enclosed_share, "1"),
    (radio.age_ticks_mean, "tick"),
    (radio.age_ticks_p95, "tick"),
    (radio.age_ticks_max, "tick"),
    (radio.age_ticks_mean_worst, "tick"),
    (radio.unheard_share, "1"),
    (radio.delivery_ratio, "1"),
    (radio.delay_ticks_mean, "tick"),
    (radio.delay_s_mean, "s"),
    (radio.messages_sent, "1"),
    (radio.messages_hz_mean, "Hz"),
    (radio.sent_bytes, "B"),
    (radio.sent_bytes_per_s, "B/s"),
    (belief.peer_error_m_mean, "m"),
    (belief.peer_error_m_p95, "m"),
    (belief.peer_error_m_rms, "m"),
    (belief.peer_missing_share, "1"),
    (belief.target_error_m_rms, "m"),
    (belief.estimate_missing_share, "1"),
    (belief.nees_mean, "1"),
    (belief.nees_in_band_share, "1"),
    (choice.conflict_share, "1"),
    (choice.conflict_pairs_mean, "1"),
    (choice.switches, "1"),
    (choice.switch_share, "1"),
    (choice.xi_disagreement_share, "1"),
    (choice.xi_spread_ticks_mean, "tick"),
    (choice.regret_m_mean, "m"),
    (choice.regret_defined_share, "1"),
)


def measure(log: RunLog, names: Iterable[str] | None = None) -> dict[str, float]:
    """The measures of that name, all by default; ``ValueError`` names those that are unknown."""
    wanted = list(MEASURES) if names is None else list(names)
    unknown = [name for name in wanted if name not in MEASURES]
    if unknown:
        raise ValueError(
            f"measures {', '.join(map(repr, unknown))}: unknown; known are: {', '.join(MEASURES)}"
        )
    return {name: MEASURES[name].function(log) for name in wanted}
