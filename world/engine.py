"""The arena's step: a pure function from state and commands to state and observations.

``build`` turns a scenario and a seed into the constants of a run; ``initial`` gives the state at
tick 0, ``observe`` what each robot senses and receives there, ``advance`` the state one tick later.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import compress
from math import atan2, ceil, cos, pi, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from protocol.messages import QUANTA_PER_M, Observation, Point, State
from world import channel as radio
from world import collisions, dynamics, sensing
from world.draws import Purpose, uniforms
from world.scenario import MoveTarget, Scenario, ScenarioError, Silence
from world.targets import Behaviour, TargetView, behaviour_named

Floats = NDArray[np.float64]
PLACEMENT_TRIES_MAX = 10_000
FREE_SPACING_M = 0.08
FREE_RINGS_MAX = 2_000


@dataclass(frozen=True, slots=True)
class Arena:
    """The constants of a run. Bodies are the N robots, then the target; then O obstacles."""

    scenario: Scenario
    seed: int
    ids: tuple[str, ...]
    names: tuple[str, ...]
    radii: Floats
    ranges: Floats
    step_m_max: Floats
    behaviour: Behaviour
    channel: radio.Channel


class ArenaState(NamedTuple):
    """The truth at a tick. ``positions``: (N + 1 + O, 2) in m; ``headings``: (N + 1,) in rad."""

    tick: int
    positions: Floats
    headings: Floats
    memory: Any
    air: radio.ChannelState
    packets: dict[int, tuple[bytes | None, ...]]
    geometry: sensing.Geometry
    visible: NDArray[np.bool_]
    scans: Floats
    captured: bool
    contacts: tuple[tuple[int, int], ...]


def build(scenario: Scenario, seed: int) -> Arena:
    """The constants of a run of a scenario with a seed."""
    count = len(scenario.ids)
    team, target = scenario.team, scenario.target
    return Arena(
        scenario,
        seed,
        scenario.ids,
        (*scenario.ids, "target", *(f"obstacle-{k + 1}" for k in range(len(scenario.obstacles)))),
        np.array(
            [team.radius_m] * count + [target.radius_m] + [o.radius_m for o in scenario.obstacles]
        ),
        np.array([team.sensing_range_m] * count + [target.sensing_range_m]),
        np.array([team.step_m_max] * count + [target.step_m_max]),
        behaviour_named(target.behaviour),
        radio.build(scenario, seed),
    )


def initial(arena: Arena) -> ArenaState:
    """The state at tick 0; ``ScenarioError`` if the robots cannot be placed."""
    scenario = arena.scenario
    robots = scenario.team.positions or _placed(arena)
    fixed = [o.position for o in scenario.obstacles]
    positions = quantised(np.array([*robots, scenario.target.position, *fixed]))
    headings = np.zeros(len(arena.ids) + 1)
    headings[-1] = scenario.target.heading_rad
    return _sensed(arena, 0, positions, headings, None, radio.initial(arena.channel), {}, ())


def observe(arena: Arena, state: ArenaState) -> list[Observation]:
    """What each robot senses, and what its radio delivers, at the state's tick; in robot order."""
    count = len(arena.ids)
    tick = state.tick
    inboxes: list[list[bytes]] = [[] for _ in arena.ids]
    for sent_tick, links in radio.deliver(state.air, tick)[1]:
        packets = state.packets[sent_tick]
        for inbox, arrives in zip(inboxes, links.T.tolist(), strict=True):
            inbox += compress(packets, arrives)  # type: ignore[arg-type]  # None never flies
    places = [tuple(p) for p in state.positions[:count].tolist()]
    targets = _detected(arena, state)
    visible = state.visible[:count].tolist()
    scans = state.scans.tolist()
    headings = state.headings.tolist()
    return [
        Observation(
            robot,
            tick,
            places[i],
            headings[i],
            targets[i] if visible[i][count] else None,
            tuple(scans[i]),
            tuple([(arena.ids[k], *places[k]) for k in range(count) if visible[i][k]]),
            tuple(inboxes[i]),
        )
        for i, robot in enumerate(arena.ids)
    ]


def advance(
    arena: Arena,
    state: ArenaState,
    steps: Floats,
    packets: Sequence[bytes | None],
    name_bytes: int = 0,
) -> tuple[ArenaState, radio.Fates]:
    """The state one tick later, and the fates of this tick's packets.

    ``steps``: (N, 2) commanded steps in m; ``packets``: each robot's encoded pose, robot order,
    None from a robot that sends none; ``name_bytes``: how many bytes of each are the run's name,
    which do not count: how a run is called must not change its course.
    """
    tick, count = state.tick, len(arena.ids)
    air, _ = radio.deliver(state.air, tick)
    air, fates = radio.transmit(arena.channel, air, _sending(arena, state, packets, name_bytes))
    memory, target_step = _target_step(arena, state)
    wanted = dynamics.limited(np.vstack([steps, target_step]), arena.step_m_max)
    headings = state.headings
    if arena.scenario.team.motion == "unicycle":
        turned, wanted[:count] = dynamics.unicycle(
            headings[:count], wanted[:count], arena.scenario.team.turn_rad_max
        )
        headings = np.append(turned, dynamics.holonomic_headings(headings[count:], wanted[count:]))
    else:
        headings = dynamics.holonomic_headings(headings, wanted)
    gaps = state.geometry.gaps
    moved, contacts = collisions.move(state.positions, arena.radii, wanted, gaps)
    positions = state.positions.copy()
    positions[: count + 1] = quantised(moved)
    if gaps.min() < 2.0 * arena.step_m_max.max() + collisions.SKIN_M:
        positions = collisions.kept_apart(state.positions, positions, arena.radii, count + 1)
    for event in arena.scenario.events:
        if isinstance(event, MoveTarget) and event.tick == tick + 1:
            positions[count] = _nearest_free(arena, positions, event.position)
    kept = {
        sent: state.packets[sent]
        for flights in air.flights.values()
        for sent, _ in flights
        if sent != tick
    }
    kept[tick] = tuple(packets)
    after = _sensed(arena, tick + 1, positions, headings, memory, air, kept, tuple(contacts))
    return after, fates


def quantised(positions: Floats) -> Floats:
    """Positions rounded to whole multiples of ``QUANTUM_M``."""
    return np.rint(positions * QUANTA_PER_M) / QUANTA_PER_M


def is_captured(rays: Floats, stop_distance_m: float, count: int) -> bool:
    """Whether the target is captured: enough robots close, and no gap of pi or more between them.

    ``rays``: (N, 2) from the target to each robot, in m.
    """
    close = rays[(rays * rays).sum(axis=1) <= stop_distance_m**2]
    if len(close) < count:
        return False
    bearings = sorted(atan2(y, x) for x, y in close.tolist())
    gaps = [b - a for a, b in zip(bearings, [*bearings[1:], bearings[0] + 2 * pi], strict=True)]
    return max(gaps) < pi


def truth(arena: Arena, state: ArenaState) -> State:
    """The state as the message that viewers and recorders get."""
    places = [tuple(p) for p in state.positions[: len(arena.ids) + 1].tolist()]
    return State(
        state.tick,
        tuple(places[:-1]),
        tuple(state.headings[:-1].tolist()),
        places[-1],
        state.captured,
        tuple([(arena.names[i], arena.names[k]) for i, k in state.contacts]),
    )


def _sensed(
    arena: Arena,
    tick: int,
    positions: Floats,
    headings: Floats,
    memory: Any,
    air: radio.ChannelState,
    packets: dict[int, tuple[bytes | None, ...]],
    contacts: tuple[tuple[int, int], ...],
) -> ArenaState:
    """A state with everything that follows from the positions."""
    count = len(arena.ids)
    geometry = sensing.geometry(positions, arena.radii, count + 1)
    rays = np.stack([-geometry.x[:count, count], -geometry.y[:count, count]], axis=1)
    return ArenaState(
        tick,
        positions,
        headings,
        memory,
        air,
        packets,
        geometry,
        sensing.in_sight(geometry, arena.ranges, arena.radii),
        quantised(sensing.scan(geometry, arena.ranges, arena.radii, arena.scenario.sensing.rays)),
        is_captured(rays, arena.scenario.capture.stop_distance_m, arena.scenario.capture_count),
        contacts,
    )


def _detected(arena: Arena, state: ArenaState) -> list[Point]:
    """Where each robot takes the target to be, noise included, were it to detect it."""
    count = len(arena.ids)
    exact = state.positions[count]
    std = arena.scenario.sensing.noise_m_std
    if std == 0.0:
        return [tuple(exact.tolist())] * count
    draws = uniforms(arena.seed, Purpose.DETECTION_NOISE, state.tick, 2 * count)
    noise = std * ndtri(np.maximum(draws, 2.0**-53)).reshape(count, 2)
    return [tuple(p) for p in quantised(exact + noise).tolist()]


def _target_step(arena: Arena, state: ArenaState) -> tuple[Any, Floats]:
    count = len(arena.ids)
    places = state.positions[: count + 1].tolist()
    x, y = places[count]
    visible = state.visible[count].tolist()
    view = TargetView(
        state.tick,
        (x, y),
        float(state.headings[count]),
        [tuple(places[k]) for k in range(count) if visible[k]],
        state.scans[count].tolist(),
        arena.scenario.target.step_m_max,
        arena.scenario.target.radius_m,
    )
    memory, step = arena.behaviour(state.memory, view, **arena.scenario.target.parameters)
    return memory, np.array([step])


def _sending(
    arena: Arena, state: ArenaState, packets: Sequence[bytes | None], name_bytes: int
) -> radio.Sending:
    """What the radio is given at a tick."""
    count = len(arena.ids)
    sizes = [0 if packet is None else len(packet) - name_bytes for packet in packets]
    return radio.Sending(
        state.tick,
        np.array(sizes) if None in packets or arena.channel.rated else None,
        state.geometry.distances[:count, :count],
        _silent(arena, state.tick),
    )


def _silent(arena: Arena, tick: int) -> NDArray[np.bool_] | None:
    """(N,) which radios are off at a tick, None if no event ever silences one."""
    events = [e for e in arena.scenario.events if isinstance(e, Silence)]
    if not events:
        return None
    off = {e.robot for e in events if e.tick <= tick < e.tick + e.ticks}
    return np.array([robot in off for robot in arena.ids])


def _placed(arena: Arena) -> list[Point]:
    """Random starts in the annulus around the target, apart from each other and from obstacles."""
    scenario, placement = arena.scenario, arena.scenario.team.placement
    low, high = placement.distance_m_min**2, placement.distance_m_max**2
    tx, ty = scenario.target.position
    free = [(o.position, o.radius_m + scenario.team.radius_m) for o in scenario.obstacles]
    free.append(((tx, ty), scenario.target.radius_m + scenario.team.radius_m))
    placed: list[Point] = []
    for robot in range(len(arena.ids)):
        for u, v in _tries(arena.seed, robot):
            distance = (low + u * (high - low)) ** 0.5
            x, y = tx + distance * cos(2 * pi * v), ty + distance * sin(2 * pi * v)
            if all((x - ox) ** 2 + (y - oy) ** 2 > (1.05 * apart) ** 2 for (ox, oy), apart in free):
                placed.append((x, y))
                free.append(((x, y), 2 * scenario.team.radius_m))
                break
        else:
            raise ScenarioError(
                f"team.placement: no room for {arena.ids[robot]} between"
                f" {placement.distance_m_min} and {placement.distance_m_max} m from the target"
            )
    return placed


def _tries(seed: int, robot: int) -> Iterator[tuple[float, float]]:
    """Pairs of draws, one stream per robot: the first N starts are any larger team's too."""
    for count in (16, PLACEMENT_TRIES_MAX):
        # A stream's first draws are the same however many are taken.
        pairs = uniforms(seed, Purpose.PLACEMENT, robot, 2 * count).reshape(count, 2)
        yield from (tuple(pair) for pair in pairs[0 if count == 16 else 16 :].tolist())


def _nearest_free(arena: Arena, positions: Floats, wanted: Point) -> Floats:
    """The wanted position of the target, or the nearest place around it where it fits."""
    count = len(arena.ids)
    others = np.delete(positions, count, axis=0)
    apart = np.delete(arena.radii, count) + arena.radii[count] + 2 * collisions.SKIN_M
    for ring in range(FREE_RINGS_MAX):
        radius = ring * FREE_SPACING_M
        places = max(1, ceil(2 * pi * ring))
        angles = np.arange(places) * (2 * pi / places)
        tried = quantised(
            np.array(wanted) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        )
        away = others - tried[:, None]
        free = ((away * away).sum(axis=2) > apart**2).all(axis=1)
        if free.any():
            place: Floats = tried[free.argmax()]
            return place
    staying: Floats = positions[count]
    return staying
