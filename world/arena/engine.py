"""The arena's step: a pure function from state and commands to state and observations.

``build`` turns a scenario and a seed into the constants of a run; ``initial`` gives the state at
tick 0, ``observe`` what each robot senses and receives there, ``advance`` the state one tick later.
A robot that is lost is a body that coasts to a stop, sends nothing, receives nothing and counts for
no capture. It still blocks other bodies, and the others still see it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.messages import Observation, Point, State
from encircle.world.arena import collisions, dynamics, localisation, placement, sensing
from encircle.world.arena.capture import is_captured
from encircle.world.arena.dynamics import quantised
from encircle.world.channel import channel as radio
from encircle.world.scenario.channel_events import cut_spans
from encircle.world.scenario.channel_model import Silence
from encircle.world.scenario.model import Event, MoveTarget, Scenario
from encircle.world.targets.behaviours import TargetView, act

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Arena:
    """The constants of a run. Bodies are the N robots, then the target; then O obstacles.

    ``silences``: robot, first tick and the tick after the last of each silence.
    """

    scenario: Scenario
    seed: int
    ids: tuple[str, ...]
    names: tuple[str, ...]
    radii: Floats
    ranges: Floats
    step_m_max: Floats
    channel: radio.Channel
    silences: tuple[tuple[str, int, int], ...]


class ArenaState(NamedTuple):
    """The truth at a tick. ``positions``: (N + 1 + O, 2) in m; ``headings``: (N + 1,) in rad.

    ``away``: (N,) for how many ticks each robot has been lost, 0 if it is not, None while none is;
    ``last_steps``: (N, 2) in m, what each did in its last step before that; ``drift``: (N, 2) in m,
    how far each robot's idea of where it is has drifted off, None without.
    """

    tick: int
    positions: Floats
    headings: Floats
    memory: Any
    channel_state: radio.ChannelState
    packets: dict[int, tuple[bytes | None, ...]]
    geometry: sensing.Geometry
    visible: NDArray[np.bool_]
    scans: Floats
    captured: bool
    contacts: tuple[tuple[int, int], ...]
    away: NDArray[np.int64] | None
    last_steps: Floats
    drift: Floats | None


class Foreseen(NamedTuple):
    """What the radio does at a state's tick if every robot sends: its state then, and fates."""

    channel_state: radio.ChannelState
    fates: radio.Fates


def build(scenario: Scenario, seed: int) -> Arena:
    """The constants of a run of a scenario with a seed."""
    count = len(scenario.ids)
    team, target = scenario.team, scenario.target
    bodies = [scenario.parameters_of(robot) for robot in scenario.ids]
    return Arena(
        scenario,
        seed,
        scenario.ids,
        (*scenario.ids, "target", *(f"obstacle-{k + 1}" for k in range(len(scenario.obstacles)))),
        np.array(
            [team.radius_m] * count + [target.radius_m] + [o.radius_m for o in scenario.obstacles]
        ),
        np.array([body["sensing_range_m"] for body in bodies] + [target.sensing_range_m]),
        np.array([body["step_m_max"] for body in bodies] + [target.step_m_max]),
        radio.build(scenario, seed),
        _silences(scenario),
    )


def with_event(arena: Arena, event: Event) -> Arena:
    """The arena of the same run with one event more, which must be of a later tick than it is."""
    scenario = arena.scenario.with_event(event)
    channel = radio.with_events(arena.channel, scenario)
    return replace(arena, scenario=scenario, channel=channel, silences=_silences(scenario))


def _silences(scenario: Scenario) -> tuple[tuple[str, int, int], ...]:
    return tuple(
        (event.robot, first, after)
        for event, first, after in cut_spans(scenario.events)
        if isinstance(event, Silence)
    )


def initial(arena: Arena) -> ArenaState:
    """The state at tick 0; ``ScenarioError`` if the robots cannot be placed."""
    scenario = arena.scenario
    starts = placement.starts(scenario, arena.seed)
    fixed = [o.position for o in scenario.obstacles]
    positions = quantised(np.array([*starts, scenario.target.position, *fixed]))
    headings = np.zeros(len(arena.ids) + 1)
    headings[-1] = scenario.target.heading_rad
    channel_state, still = radio.initial(arena.channel), np.zeros((len(arena.ids), 2))
    drift = localisation.next_drift(scenario, arena.seed, 0, None)
    return _sensed(arena, 0, positions, headings, None, channel_state, {}, (), None, still, drift)


def observe(arena: Arena, state: ArenaState, lost: Sequence[str] = ()) -> list[Observation]:
    """What each robot senses, and what its radio delivers, at the state's tick; in robot order.

    Robots that are ``lost`` (in robot order) get none; the others' observations name them.
    """
    count = len(arena.ids)
    tick = state.tick
    inboxes: list[list[bytes]] = [[] for _ in arena.ids]
    for sent_tick, links in radio.deliver(state.channel_state, tick)[1]:
        packets = state.packets[sent_tick]
        for inbox, arrives in zip(inboxes, links.T.tolist(), strict=True):
            inbox += compress(packets, arrives)  # type: ignore[arg-type]  # None never flies
    noise_m_std = arena.scenario.sensing.noise_m_std
    targets = sensing.detected(state.positions[count], noise_m_std, arena.seed, tick, count)
    positions: list[Point] = [tuple(p) for p in state.positions[:count].tolist()]
    told = [positions] * count
    errors = localisation.errors(arena.scenario, arena.seed, tick, state.drift)
    if errors is not None:
        targets, told = localisation.shifted(targets, positions, errors)
    visible = state.visible[:count].tolist()
    scans = state.scans.tolist()
    headings = state.headings.tolist()
    # Without errors all see a robot where it is, and what they see of it is made once.
    sights = [[(k, *p) for k, p in zip(arena.ids, told[0], strict=True)]] * count
    if errors is not None:
        sights = [[(k, *p) for k, p in zip(arena.ids, by, strict=True)] for by in told]
    return [
        Observation(
            robot,
            tick,
            told[i][i],
            headings[i],
            targets[i] if visible[i][count] else None,
            tuple(scans[i]),
            tuple(compress(sights[i], visible[i])),
            tuple(inboxes[i]),
            tuple(lost),
        )
        for i, robot in enumerate(arena.ids)
        if robot not in lost
    ]


def foresee(arena: Arena, state: ArenaState) -> Foreseen | None:
    """What does not depend on the robots' answers, for ``advance``; None if it does.

    For a caller who has time while he waits for them. Where a link's rate counts, the size of each
    packet does.
    """
    if arena.channel.rated:
        return None
    return Foreseen(*_transmitted(arena, state, None, None))


def advance(
    arena: Arena,
    state: ArenaState,
    steps: Floats,
    packets: Sequence[bytes | None],
    name_bytes: int = 0,
    lost: NDArray[np.bool_] | None = None,
    foreseen: Foreseen | None = None,
) -> tuple[ArenaState, radio.Fates]:
    """The state one tick later, and the fates of this tick's packets.

    ``steps``: (N, 2) commanded steps in m; ``packets``: each robot's encoded pose, robot order,
    None from a robot that sends none; ``name_bytes``: how many bytes of each are the run's name,
    which do not count: how a run is called must not change its course. ``lost``: (N,) the robots
    that nobody commands, whose steps do not matter and whose packets must be None. ``foreseen``: of
    the same arena and state; it holds if every robot sends, and else is not used.
    """
    tick, count = state.tick, len(arena.ids)
    sizes_matter = arena.channel.rated or None in packets
    if foreseen is not None and lost is None and not sizes_matter:
        channel_state, fates = foreseen
    else:
        # A packet without a byte of its own would count as none.
        sizes = [0 if packet is None else max(1, len(packet) - name_bytes) for packet in packets]
        sent = np.array(sizes) if sizes_matter else None
        channel_state, fates = _transmitted(arena, state, sent, lost)
    memory, target_step = _target_step(arena, state)
    away = None
    if lost is not None:
        away = np.where(lost, 1 if state.away is None else state.away + 1, 0)
        steps = np.where(lost[:, None], dynamics.coasting(state.last_steps, away), steps)
    wanted = np.empty((count + 1, 2))
    wanted[:count], wanted[count] = steps, target_step
    wanted = dynamics.limited(wanted, arena.step_m_max)
    headings = _turned(arena, state, wanted, lost)
    pairs = collisions.pairs_in_reach(wanted, state.geometry.gaps)
    moved, contacts = collisions.moved(state.positions, arena.radii, wanted, pairs)
    positions = state.positions.copy()
    positions[: count + 1] = quantised(moved)
    if pairs:
        positions = collisions.kept_apart(state.positions, positions, arena.radii, count + 1)
    for event in arena.scenario.events:
        if isinstance(event, MoveTarget) and event.tick == tick + 1:
            positions[count] = placement.nearest_free(positions, arena.radii, count, event.position)
    kept = {
        sent: state.packets[sent]
        for flights in channel_state.flights.values()
        for sent, _ in flights
        if sent != tick
    }
    kept[tick] = tuple(packets)
    last_steps = positions[:count] - state.positions[:count]
    if lost is not None:
        last_steps = np.where(lost[:, None], state.last_steps, last_steps)
    after = _sensed(
        *(arena, tick + 1, positions, headings, memory, channel_state, kept, tuple(contacts)),
        *(away, last_steps),
        localisation.next_drift(arena.scenario, arena.seed, tick + 1, state.drift),
    )
    return after, fates


def _turned(
    arena: Arena, state: ArenaState, wanted: Floats, lost: NDArray[np.bool_] | None
) -> Floats:
    """(N + 1,) headings of those that move as ``wanted`` (N + 1, 2), which becomes what they can.

    A lost robot does not steer.
    """
    count, headings = len(arena.ids), state.headings
    if arena.scenario.team.motion == "holonomic":
        turned = dynamics.holonomic_headings(headings, wanted)
        if lost is not None:
            turned[:count][lost] = headings[:count][lost]
        return turned
    turned, rolled = dynamics.unicycle(
        headings[:count], wanted[:count], arena.scenario.team.turn_rad_max
    )
    if lost is not None:
        turned[lost], rolled[lost] = headings[:count][lost], wanted[:count][lost]
    wanted[:count] = rolled
    return np.append(turned, dynamics.holonomic_headings(headings[count:], wanted[count:]))


def truth(arena: Arena, state: ArenaState) -> State:
    """The state as the message that viewers and recorders get."""
    positions = [tuple(p) for p in state.positions[: len(arena.ids) + 1].tolist()]
    return State(
        state.tick,
        tuple(positions[:-1]),
        tuple(state.headings[:-1].tolist()),
        positions[-1],
        state.captured,
        tuple([(arena.names[i], arena.names[k]) for i, k in state.contacts]),
    )


def _sensed(
    arena: Arena,
    tick: int,
    positions: Floats,
    headings: Floats,
    memory: Any,
    channel_state: radio.ChannelState,
    packets: dict[int, tuple[bytes | None, ...]],
    contacts: tuple[tuple[int, int], ...],
    away: NDArray[np.int64] | None,
    last_steps: Floats,
    drift: Floats | None,
) -> ArenaState:
    """A state with everything that follows from the positions."""
    count = len(arena.ids)
    needed = arena.scenario.capture_count
    geometry = sensing.geometry(positions, arena.radii, count + 1)
    rays = -(positions[count] - positions[:count])
    if away is not None:
        # A body that nobody commands blocks, but it is no hunter.
        rays = rays[away == 0]
        needed = min(needed, len(rays))
    return ArenaState(
        tick,
        positions,
        headings,
        memory,
        channel_state,
        packets,
        geometry,
        sensing.in_sight(geometry, arena.ranges, arena.radii),
        quantised(sensing.scan(geometry, arena.ranges, arena.radii, arena.scenario.sensing.rays)),
        is_captured(rays, arena.scenario.capture.stop_distance_m, needed),
        contacts,
        away,
        last_steps,
        drift,
    )


def _target_step(arena: Arena, state: ArenaState) -> tuple[Any, Point]:
    count = len(arena.ids)
    positions = state.positions[: count + 1].tolist()
    x, y = positions[count]
    visible = state.visible[count].tolist()
    view = TargetView(
        state.tick,
        (x, y),
        float(state.headings[count]),
        [tuple(positions[k]) for k in range(count) if visible[k]],
        state.scans[count].tolist(),
        arena.scenario.target.step_m_max,
        arena.scenario.target.radius_m,
    )
    target = arena.scenario.target
    memory, step = act(target.behaviour, state.memory, view, target.parameters)
    return memory, step


def _transmitted(
    arena: Arena,
    state: ArenaState,
    sizes_bytes: NDArray[np.int64] | None,
    lost: NDArray[np.bool_] | None,
) -> tuple[radio.ChannelState, radio.Fates]:
    """The radio after a tick's packets, and their fates. ``sizes_bytes``: as in ``Sending``."""
    count = len(arena.ids)
    sending = radio.Sending(
        state.tick,
        sizes_bytes,
        state.geometry.distances[:count, :count],
        _silent(arena, state.tick, lost),
    )
    before, _ = radio.deliver(state.channel_state, state.tick)
    return radio.transmit(arena.channel, before, sending)


def _silent(arena: Arena, tick: int, lost: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
    """(N,) which radios are off at a tick, those of lost robots among them, None if none is."""
    off = {robot for robot, first, after in arena.silences if first <= tick < after}
    if not off:
        return lost
    silent = np.array([robot in off for robot in arena.ids])
    return silent if lost is None else silent | lost
