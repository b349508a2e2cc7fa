"""What is worth knowing of a scenario before it is run, although it can be run as it is.

A contradiction is refused (``encircle.world.loading.consistency``). A remark is not: a team that
can never capture is useful to study tracking. Whoever starts a run
shows its remarks first, a line each: the commands on standard error, the Python API as a
``ScenarioRemark``.
"""

from math import exp

from encircle.protocol.parameters import Parameters
from encircle.world.arena.capture import ROBOTS_MIN, robots_within_max
from encircle.world.scenario.channel_events import DelayChange, RangeChange
from encircle.world.scenario.channel_model import VULNERABLE_PACKETS, Crash, delay_parts
from encircle.world.scenario.delay_models import ConstantDelay
from encircle.world.scenario.model import Scenario

PASSING_MIN = 0.5


class ScenarioRemark(UserWarning):
    """The warning of ``encircle.run`` for a scenario that may not be what was meant."""


def remarks_on(scenario: Scenario) -> list[str]:
    """Plain sentences on a valid scenario, key and value first; empty if there are none."""
    parts = (_who_can_capture, _radios, _delays, _contention, _changes)
    return [line for remarks in parts for line in remarks(scenario)]


def _who_can_capture(scenario: Scenario) -> list[str]:
    team, count = scenario.team, len(scenario.ids)
    if count < ROBOTS_MIN:
        robots = "team.robots.count" if team.overrides else "team.robots"
        key = f"{robots} = {count}" if team.positions is None else "team.positions"
        who = "one robot" if count == 1 else f"{count} robots"
        return [
            f"{key}: {who} can never capture: it takes {ROBOTS_MIN} at least to leave no gap"
            " of pi or more around the target"
        ]
    return [*_room(scenario), *_lost_for_good(scenario)]


def _room(scenario: Scenario) -> list[str]:
    """A capture that takes more robots than fit around the target."""
    stop_m, needed = scenario.capture.stop_distance_m, max(ROBOTS_MIN, scenario.capture_count)
    most = robots_within_max(stop_m, scenario.team.radius_m, scenario.target.radius_m)
    if needed > most:
        return [
            f"capture.stop_distance_m = {stop_m:g}: no more than {most} robots of radius"
            f" {scenario.team.radius_m:g} m have room so near the target, and a capture takes"
            f" {needed}: a team that loses no robot can never capture"
        ]
    if scenario.capture_count > scenario.fits_around:
        return [
            f"capture.count = {scenario.capture_count}: only {scenario.fits_around} robots fit"
            f" around the target at capture.stop_distance_m = {stop_m:g} with half a body's width"
            " between neighbours: hunts may never end in a capture"
        ]
    return []


def _lost_for_good(scenario: Scenario) -> list[str]:
    """Crashes that leave too few robots, with none of them back before the run ends."""
    end = scenario.ticks_max
    ticks = sorted(
        event.tick
        for event in scenario.events
        if isinstance(event, Crash)
        and event.tick <= end
        and (event.ticks is None or event.tick + event.ticks > end)
    )
    count, spare = len(scenario.ids), len(scenario.ids) - ROBOTS_MIN
    if len(ticks) <= spare:
        return []
    return [
        f"events: from tick {ticks[spare]} on crashes leave {ROBOTS_MIN - 1} of {count} robots or"
        f" fewer for good: they can never capture, which takes {ROBOTS_MIN}"
    ]


def _radios(scenario: Scenario) -> list[str]:
    """Radios that reach nobody, since bodies keep them apart."""
    nearest_m = 2.0 * scenario.team.radius_m
    return [
        f"team.robots.{robot}.radio_range_m = {own.radio_range_m:g}: two robots of radius"
        f" {scenario.team.radius_m:g} m are never so near: {robot} neither sends nor receives"
        for robot, own in scenario.team.overrides.items()
        if own.radio_range_m is not None and own.radio_range_m < nearest_m
    ]


def _delays(scenario: Scenario) -> list[str]:
    """Delays that ticks make much longer, and what will come of them; and absurdly long ones."""
    parts = delay_parts(scenario.channel, scenario.ids)
    delayed = [
        (key, delay) for key, links, delay in parts if links.any() and delay != ConstantDelay()
    ]
    if not delayed:
        return []
    # It brings scipy, for which a command without delays need not wait.
    from encircle.world.channel.delay_means import delivered_s_mean, mean_s

    tick_s, remarks = scenario.tick_s, []
    for key, delay in delayed:
        asked_s = mean_s(delay)
        if 0.0 < asked_s <= tick_s / 2.0:
            remarks.append(
                f"{key}: {asked_s:.3g} s on average ({delay.model}) is at most half a tick of"
                f" {tick_s:g} s; packets arrive at ticks, at the next one at the earliest, so that"
                f" the mean delay will be about {delivered_s_mean(delay, tick_s):.3g} s (with a"
                " smaller tick_s less)"
            )
        elif too_long := _too_long(scenario, asked_s):
            remarks.append(f"{key}: {asked_s:.3g} s on average ({delay.model}) is {too_long}")
    return remarks


def _contention(scenario: Scenario) -> list[str]:
    """Contention that loses most of what a whole team sends in one tick."""
    contention, others = scenario.channel.contention, len(scenario.ids) - 1
    if contention is None or others < 1:
        return []
    load = others * contention.packet_s / scenario.tick_s
    passing = exp(-VULNERABLE_PACKETS[contention.access] * load)
    if passing >= PASSING_MIN:
        return []
    return [
        f"channel.contention.packet_s = {contention.packet_s:g}: when all {others + 1} robots send"
        f" in a tick of {scenario.tick_s:g} s and hear each other, no more than {passing:.1%} of"
        f" packets pass ({contention.access}, G = {load:.3g})"
    ]


def _changes(scenario: Scenario) -> list[str]:
    """Events that put a range within which nobody can be, or a delay that ticks make longer."""
    nearest_m, tick_s, remarks = 2.0 * scenario.team.radius_m, scenario.tick_s, []
    for k, event in enumerate(scenario.events):
        if isinstance(event, RangeChange) and (event.range_m or nearest_m) < nearest_m:
            remarks.append(
                f"events.{k}.range_m = {event.range_m:g}: two robots of radius"
                f" {scenario.team.radius_m:g} m are never so near: nothing arrives"
            )
        elif isinstance(event, DelayChange) and 0.0 < (event.delay_s or 0.0) <= tick_s / 2.0:
            remarks.append(
                f"events.{k}.delay_s = {event.delay_s:g}: is at most half a tick of {tick_s:g} s;"
                f" packets arrive at ticks, at the next one at the earliest, after {tick_s:g} s"
            )
    return remarks


def _too_long(scenario: Scenario, asked_s: float) -> str:
    """Longer than what, and what that means; empty for a delay that a hunt can bear."""
    tick_s, ticks = scenario.tick_s, scenario.ticks_max
    age_ticks = Parameters.from_mapping(scenario.parameters).peer_age_ticks_max
    if asked_s >= ticks * tick_s:
        return (
            f"as long as the whole run or longer ({ticks * tick_s:g} s: ticks_max = {ticks} ticks"
            f" of {tick_s:g} s): hardly a packet will ever arrive"
        )
    if asked_s > age_ticks * tick_s:
        return (
            f"more than robot.peer_age_ticks_max = {age_ticks} ticks of {tick_s:g} s: what arrives"
            " is too old to count, and robots plan as if alone"
        )
    return ""
