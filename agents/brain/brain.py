"""The robot's brain: a pure function from state and observation to state and action.

One step folds what was seen and heard into the peer table and the target's track, lets the strategy
choose on this robot's own view, and keeps the choice within what the robot can do and from
collisions. No clock, no link, no log, no random draw.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from math import hypot
from typing import NamedTuple

from encircle.agents.estimation import kalman
from encircle.agents.estimation.kalman import Detection, Track
from encircle.agents.estimation.spline import extrapolate
from encircle.agents.planning.collision_avoidance import avoid
from encircle.agents.planning.search import Search, search_goal
from encircle.agents.policies.decision_check import checked
from encircle.agents.policies.strategies import Choice, Strategy, View
from encircle.agents.teamwork import peers as team
from encircle.agents.teamwork.publishing import Told, is_due, told_after
from encircle.agents.teamwork.relaying import passed_on, to_pass_on
from encircle.protocol.messages import Command, Observation, Point, Pose, quantise_m
from encircle.protocol.parameters import Parameters
from encircle.protocol.plugins import STRATEGIES, PluginFailed


@dataclass(frozen=True, slots=True)
class Role:
    """What stays the same for one robot all through a run. ``name``: the strategy's."""

    robot: str
    team: tuple[str, ...]
    tick_s: float
    strategy: Strategy
    parameters: Parameters
    name: str = ""

    @property
    def own(self) -> int:
        """The robot's place in the team."""
        return places_in(self.team)[self.robot]


@lru_cache(maxsize=64)
def places_in(team_ids: tuple[str, ...]) -> dict[str, int]:
    """Each robot's place in the team."""
    return {robot: place for place, robot in enumerate(team_ids)}


class BrainState(NamedTuple):
    """All that a robot remembers from one tick to the next.

    ``goal``: the encirclement point it headed for, None if for none; ``told``: what its peers have
    from it, None if it speaks without regard to that; ``lost``: the peers that are said to be.
    """

    peers: team.PeerTable
    track: Track
    position: Point | None
    search: Search | None
    goal: Point | None = None
    told: Told | None = None
    lost: team.Lost = ()


class Action(NamedTuple):
    """What one step of the brain gives away: a packet for its peers, a command for its body.

    ``pose`` is None at a tick at which the robot publishes nothing.
    """

    pose: Pose | None
    command: Command


def initial(role: Role, first_tick: int = 0) -> BrainState:
    """The state of a robot that knows nothing yet, and first observes at ``first_tick``."""
    track = kalman.NO_TRACK._replace(first_tick=first_tick)
    return BrainState((None,) * len(role.team), track, None, None)


def step(
    state: BrainState, observation: Observation, packets: Sequence[Pose], role: Role
) -> tuple[BrainState, Action]:
    """One tick.

    ``packets``: the decoded inbox, in any order; senders, and origins of what they relay, are in
    ``role.team``. Raises ``PluginFailed`` if the strategy fails.
    """
    places = places_in(role.team)
    state, passed_ticks = _caught_up(state, observation.tick, role)
    # Arrival order is never information.
    ranked = [(p.tick, places[p.robot], p.sequence, k) for k, p in enumerate(packets)]
    heard = [(place, packets[k]) for _, place, _, k in sorted(ranked)]
    seen = [(places[robot], x, y) for robot, x, y in observation.seen]
    tick, own = observation.tick, places[role.robot]
    peers = team.fold(state.peers, heard, seen, tick, role.tick_s)
    arrived = _detections(observation, own, heard, places)
    track = kalman.fold(state.track, arrived, tick, role.tick_s, role.parameters)
    lost = state.lost
    if lost or observation.lost:
        lost = team.fold_lost(lost, [places[robot] for robot in observation.lost], heard, tick)
    present = team.without(peers, lost)
    mates = team.team_of(present, own, observation.position, tick, role.parameters)
    choice, search = _choose(state, track, mates, observation, role)
    estimate = track.estimate
    x, y = observation.position
    wanted = _limited(choice.step, role.parameters.step_m_max)
    safe = avoid(
        wanted,
        observation.scan,
        [(seen_x - x, seen_y - y) for _, seen_x, seen_y in seen],
        (estimate.x - x, estimate.y - y) if estimate else None,
        role.parameters,
    )
    pose = _packet(state, observation, track, choice, role, passed_ticks)
    command = Command(
        role.robot,
        tick,
        (quantise_m(safe[0]), quantise_m(safe[1])),
        choice.mode,
        choice.xi,
        choice.point,
        (quantise_m(choice.goal[0]), quantise_m(choice.goal[1])),
        (quantise_m(estimate.x), quantise_m(estimate.y)) if estimate else None,
        choice.predictor,
        tuple([role.team[place] for place in mates.members]),
        pose is not None,
    )
    goal = None if choice.point is None else command.goal
    told = told_after(state.told, pose, tick, role.tick_s, role.parameters)
    after = BrainState(peers, track, observation.position, search, goal, told, lost)
    return after, Action(pose, command)


def _caught_up(state: BrainState, tick: int, role: Role) -> tuple[BrainState, int]:
    """The state as of the tick before, and how many ticks have passed without an observation.

    In lock-step none has; by the clock a robot leaves out what comes late or never.
    """
    next_tick = state.track.first_tick + len(state.track.entries)
    if tick == next_tick:
        return state, 0
    parameters, told = role.parameters, state.told
    track = kalman.up_to(state.track, tick, role.tick_s, parameters)
    if track.first_tick == tick:
        told = None
    for passed in range(next_tick, tick) if told else ():
        told = told_after(told, None, passed, role.tick_s, parameters)
    return state._replace(track=track, told=told), tick - next_tick


def _detections(
    observation: Observation,
    own: int,
    heard: Sequence[tuple[int, Pose]],
    places: Mapping[str, int],
) -> list[Detection]:
    """Every detection that reached this robot at this tick, its own included."""
    tick = observation.tick
    found, relaying = [], []
    for place, packet in heard:
        if packet.detection is not None and packet.tick < tick:
            found.append((packet.tick, place, *packet.detection))
        if packet.relayed:
            relaying.append(packet)
    if relaying:
        # Of one origin and tick the last counts: what a robot says itself, not what is said of it.
        found = passed_on(relaying, tick, own, places) + found
    if observation.target is not None:
        found.append((tick, own, *observation.target))
    return found


def _packet(
    state: BrainState,
    observation: Observation,
    track: Track,
    choice: Choice,
    role: Role,
    passed_ticks: int,
) -> Pose | None:
    """What to tell the peers at this tick, None if nothing."""
    parameters, tick = role.parameters, observation.tick
    position, detection = observation.position, observation.target
    if not is_due(state.told, tick, position, detection, role.tick_s, parameters):
        return None
    x, y = state.position or position
    since_s = role.tick_s * (1 + passed_ticks)
    return Pose(
        role.robot,
        tick,
        tick,
        position,
        ((position[0] - x) / since_s, (position[1] - y) / since_s),
        detection,
        choice.mode,
        choice.xi,
        choice.point,
        to_pass_on(track, tick, role.own, role.team, parameters.relay_age_ticks_max)
        if parameters.detections == "relay"
        else (),
    )


def _choose(
    state: BrainState, track: Track, mates: team.Team, observation: Observation, role: Role
) -> tuple[Choice, Search | None]:
    """The strategy's choice, or the search's, and the search if one is under way.

    ``PluginFailed`` if the strategy raises, or chooses what cannot be.
    """
    parameters, tick = role.parameters, observation.tick
    estimate = track.estimate
    if estimate is None:
        x, y = observation.position
        search = state.search or Search(x, y, tick)
        goal = search_goal(search, tick, role.own, len(role.team), parameters)
        return Choice("search", (goal[0] - x, goal[1] - y), goal), search
    predict = partial(extrapolate, track, role.tick_s, parameters)
    target = (estimate.x, estimate.y)
    view = View(mates.own, mates.positions, target, predict, parameters, state.goal)
    try:
        return checked(role.strategy(view)), None
    except (Exception, SystemExit) as error:
        raise PluginFailed(STRATEGIES, role.name, role.robot, tick, error) from error


def _limited(step: Point, length_m_max: float) -> Point:
    """A step shortened to the longest that the robot can make."""
    length = hypot(*step)
    if length <= length_m_max:
        return step
    scale = length_m_max / length
    return step[0] * scale, step[1] * scale
