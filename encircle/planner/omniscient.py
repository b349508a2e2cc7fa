"""How far a team gets that knows the truth and what the target will do: an omniscient planner.

It plays whole hunts in the world's own step (``encircle.world.arena.engine``), with the target's
very behaviour, and without noise and radio: every robot knows where everybody is at every tick. A
candidate is a law that all robots follow, and an opening: for a time of its own each robot stands
still or walks straight, in a drawn direction, before it follows the law. The first candidates have
no opening, and are the shipped policies themselves, given the truth. The world is deterministic, so
a candidate that captures in the planner's head captures.

Candidates are tried in order, up to a given number. The first that captures is the answer. This is
what such a search *reached*: a bound from below on what the best team can do, and no proof that
nobody can do better. More candidates can only reach more. No robot could do this: it takes the
target's behaviour, and places that nobody has told it.
"""

from functools import partial
from math import cos, hypot, pi, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from encircle.agents.estimation.kalman import Estimate
from encircle.agents.planning.collision_avoidance import avoid
from encircle.agents.policies.closed_ring import closed_ring
from encircle.agents.policies.group_chase import group_chase
from encircle.agents.policies.interface import Policy, View
from encircle.agents.policies.paper import xi_star
from encircle.agents.policies.voronoi import voronoi
from encircle.protocol.messages import Point
from encircle.protocol.parameters import Parameters
from encircle.world.arena import engine
from encircle.world.scenario.channel_model import ChannelModel
from encircle.world.scenario.model import Scenario, Sensing

CANDIDATES = 32
OPENING_TICKS_MAX = 60
STANDING_SHARE = 0.3
"""The share of robots that stand still in an opening."""
LAWS: tuple[Policy, ...] = (
    closed_ring,
    voronoi,
    xi_star,
    group_chase,
    # Outside the range at which a target of the usual senses sees them.
    partial(closed_ring, hold_m=6.5, lead_m=1.0),
    partial(closed_ring, front_share=0.95, behind_share=0.8),
)
OPENED_LAWS: tuple[Policy, ...] = (closed_ring, voronoi)


class Reached(NamedTuple):
    """What the planner found: the tick of the capture, None if there is none, and by which plan."""

    capture_tick: int | None
    candidate: int | None


class Opening(NamedTuple):
    """What a robot does at first: so many ticks of one step in m."""

    ticks: int
    step: Point


class Candidate(NamedTuple):
    """A plan: each robot's opening, and the law that all of them follow afterwards."""

    openings: tuple[Opening, ...]
    law: Policy


def reach(scenario: Scenario, seed: int, candidates: int = CANDIDATES) -> Reached:
    """What the planner reaches from a seed's starts, of so many candidates.

    The same scenario, seed and number give the same answer. Of the scenario's policies, radio and
    sensor noise nothing matters. ``PluginFailed`` if the target's behaviour fails.
    """
    perfect = {"channel": ChannelModel(), "sensing": Sensing(rays=scenario.sensing.rays)}
    arena = engine.build(scenario.model_copy(update=perfect), seed)
    start = engine.initial(arena)
    parameters = tuple(
        Parameters.from_mapping(scenario.parameters_of(robot)) for robot in arena.ids
    )
    for number in range(candidates):
        tick = _play(arena, start, parameters, _candidate(number, seed, parameters))
        if tick is not None:
            return Reached(tick, number)
    return Reached(None, None)


def _candidate(number: int, seed: int, parameters: tuple[Parameters, ...]) -> Candidate:
    """The plan of that number; its draws depend on seed and number alone."""
    if number < len(LAWS):
        return Candidate((Opening(0, (0.0, 0.0)),) * len(parameters), LAWS[number])
    draws = np.random.default_rng((seed, number)).random((len(parameters), 3)).tolist()
    openings = []
    for own, (length, turn, standing) in zip(parameters, draws, strict=True):
        pace = 0.0 if standing < STANDING_SHARE else own.step_m_max
        step = (pace * cos(2.0 * pi * turn), pace * sin(2.0 * pi * turn))
        openings.append(Opening(int(length * OPENING_TICKS_MAX), step))
    return Candidate(tuple(openings), OPENED_LAWS[number % len(OPENED_LAWS)])


def _play(
    arena: engine.Arena,
    state: engine.ArenaState,
    parameters: tuple[Parameters, ...],
    candidate: Candidate,
) -> int | None:
    """The tick at which a candidate captures, None if it does not."""
    count = len(arena.ids)
    memories: list[Any] = [None] * count
    before = state
    silent = (None,) * count
    while not state.captured:
        if state.tick >= arena.scenario.ticks_max:
            return None
        positions = tuple([(x, y) for x, y in state.positions[:count].tolist()])
        estimate = _true_estimate(arena, before, state)
        scans, visible = state.scans.tolist(), state.visible.tolist()
        steps = np.empty((count, 2))
        for own, opening in enumerate(candidate.openings):
            view = _view(arena, before, state, own, positions, estimate, parameters[own])
            memories[own], decision = candidate.law(memories[own], view)
            wanted = opening.step if state.tick < opening.ticks else decision.step
            steps[own] = _safe(wanted, view, scans[own], visible[own])
        before = state
        state, _ = engine.advance(arena, state, steps, silent)
    return state.tick


def _true_estimate(
    arena: engine.Arena, before: engine.ArenaState, state: engine.ArenaState
) -> Estimate:
    (x, y), (old_x, old_y) = (s.positions[len(arena.ids)].tolist() for s in (state, before))
    tick_s = arena.scenario.tick_s
    return Estimate(x, y, (x - old_x) / tick_s, (y - old_y) / tick_s, (0.0, 0.0, 0.0))


def _view(
    arena: engine.Arena,
    before: engine.ArenaState,
    state: engine.ArenaState,
    own: int,
    positions: tuple[Point, ...],
    estimate: Estimate,
    parameters: Parameters,
) -> View:
    """What the robot would see if it knew everything."""
    tick_s = arena.scenario.tick_s

    def predict(xi_grid: tuple[float, ...]) -> tuple[NDArray[np.float64], str]:
        ahead = tick_s * np.array(xi_grid)[:, None]
        return np.array(estimate.position) + ahead * (estimate.vx, estimate.vy), "truth"

    moves = (state.positions - before.positions)[: len(positions)].tolist()
    return View(
        state.tick,
        tick_s,
        arena.ids[own],
        arena.ids,
        positions[own],
        own,
        positions,
        estimate,
        predict,
        parameters,
        last_step=(moves[own][0], moves[own][1]),
        members=tuple(range(len(positions))),
        target_age_ticks=0,
        known=tuple([(state.tick, *p, *m) for p, m in zip(positions, moves, strict=True)]),
        packets=(None,) * len(positions),
    )


def _safe(wanted: Point, view: View, scan: list[float], visible: list[bool]) -> Point:
    """The step that the robot's own collision avoidance makes of what is wanted."""
    x, y = view.position
    length = hypot(*wanted)
    if length > view.parameters.step_m_max:
        share = view.parameters.step_m_max / length
        wanted = (share * wanted[0], share * wanted[1])
    seen = [(px - x, py - y) for k, (px, py) in enumerate(view.positions) if visible[k]]
    assert view.target is not None, "the planner knows where the target is"
    target = (view.target.x - x, view.target.y - y)
    return avoid(wanted, scan, seen, target, view.parameters)
