"""The robot's brain: a pure function from state and observation to state and action.

One step takes what was sensed and received into the peer table and the target's track, lets the
policy decide on this robot's own view, and limits the decided step to what the robot can do without
a collision. No clock, no connection, no log, no random draw. ``perceive`` and ``act`` are what
comes before and after the decision, for a caller who decides himself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from math import hypot
from typing import Any, NamedTuple

from encircle.agents.brain.received import detections_of, in_order, newest_packets
from encircle.agents.estimation import kalman
from encircle.agents.estimation.kalman import Track
from encircle.agents.estimation.spline import extrapolate
from encircle.agents.planning.collision_avoidance import avoid
from encircle.agents.planning.search import Search, search_goal
from encircle.agents.policies.decision_check import validated
from encircle.agents.policies.interface import Decision, Policy, View
from encircle.agents.teamwork import fusing
from encircle.agents.teamwork import peers as team
from encircle.agents.teamwork.publishing import ReceiverModel, next_receiver_model, should_publish
from encircle.agents.teamwork.relaying import detections_to_relay
from encircle.protocol.messages import Command, Observation, Point, Pose, quantise_m
from encircle.protocol.parameters import Parameters
from encircle.protocol.plugins import STRATEGIES, PluginFailed
from encircle.protocol.wire.payload import NOTHING_SAID, FrozenMap

NOTHING_REFUSED: Mapping[str, int] = FrozenMap()
LATE_DETECTION = "late-detection"
"""What a command counts detections and estimates as that came too late for the filter."""


@dataclass(frozen=True, slots=True)
class RobotConfig:
    """What stays the same for one robot throughout a run. ``name``: the policy's."""

    robot: str
    team: tuple[str, ...]
    tick_s: float
    policy: Policy
    parameters: Parameters
    name: str = ""

    @property
    def own(self) -> int:
        """The robot's index in the team."""
        return indices_of(self.team)[self.robot]


@lru_cache(maxsize=64)
def indices_of(team_ids: tuple[str, ...]) -> dict[str, int]:
    """Each robot's index in the team."""
    return {robot: index for index, robot in enumerate(team_ids)}


class BrainState(NamedTuple):
    """All that a robot remembers from one tick to the next.

    ``packets``: the newest packet heard from each robot, ``memory``: what its policy remembers.
    ``goal``: the encirclement point that it headed for, None if for none; ``receiver_model``: what
    its peers know from its packets, None if it publishes without regard to that; ``lost``: the
    peers that the world reports as lost.
    """

    peers: team.PeerTable
    track: Track
    position: Point | None
    search: Search | None
    goal: Point | None = None
    receiver_model: ReceiverModel | None = None
    lost: team.Lost = ()
    packets: tuple[Pose | None, ...] = ()
    memory: Any = None


class Action(NamedTuple):
    """What one step of the brain gives: a pose packet for the peers and a command for the world.

    ``pose`` is None at a tick at which the robot publishes nothing.
    """

    pose: Pose | None
    command: Command


def initial(config: RobotConfig, first_tick: int = 0) -> BrainState:
    """The state of a robot that knows nothing yet; its first observation is of ``first_tick``."""
    track = kalman.EMPTY_TRACK._replace(first_tick=first_tick)
    nothing = (None,) * len(config.team)
    return BrainState(nothing, track, None, None, packets=nothing)


class Perception(NamedTuple):
    """What a robot knows at a tick, before it decides. ``view``: what its policy gets.

    ``state``: that of the tick before; ``seen``: the robots in sight as ``(index, x, y)``; the
    others are the parts of the state to come.
    """

    state: BrainState
    observation: Observation
    missed_ticks: int
    seen: list[tuple[int, float, float]]
    view: View
    peers: team.PeerTable
    track: Track
    lost: team.Lost
    packets: tuple[Pose | None, ...]
    search: Search | None


def step(
    state: BrainState,
    observation: Observation,
    packets: Sequence[Pose],
    config: RobotConfig,
    refused: Mapping[str, int] = NOTHING_REFUSED,
) -> tuple[BrainState, Action]:
    """One tick.

    ``packets``: the decoded inbox, in any order; senders, and origins of what they relay, are in
    ``config.team``. ``refused``: as in ``act``. Raises ``PluginFailed`` if the policy fails.
    """
    perception = perceive(state, observation, packets, config)
    memory, decision = decide(state.memory, perception.view, config)
    return act(perception, memory, decision, config, refused)


def perceive(
    state: BrainState, observation: Observation, packets: Sequence[Pose], config: RobotConfig
) -> Perception:
    """The first half of a tick: what was sensed and received is taken in; as ``step``."""
    indices = indices_of(config.team)
    state, missed_ticks = _skip_to(state, observation.tick, config)
    received = in_order(packets, indices)
    seen = [(indices[robot], x, y) for robot, x, y in observation.seen]
    tick, own = observation.tick, indices[config.robot]
    peers = team.incorporate(state.peers, received, seen, tick, config.tick_s)
    detections_in = detections_of(observation, own, received, indices)
    if config.parameters.detections in fusing.FUSIONS:
        track = fusing.incorporate(
            state.track, detections_in, received, own, tick, config.tick_s, config.parameters
        )
    else:
        track = kalman.incorporate(
            state.track, detections_in, tick, config.tick_s, config.parameters
        )
    lost = state.lost
    if lost or observation.lost:
        lost = team.update_lost(
            lost, [indices[robot] for robot in observation.lost], received, tick
        )
    present = team.without_lost(peers, lost)
    planned_team = team.planning_team(present, own, observation.position, tick, config.parameters)
    newest = newest_packets(state.packets, received, tick) if received else state.packets
    estimate = track.estimate
    search = searching = None
    if estimate is None:
        search = state.search or Search(*observation.position, tick)
        searching = _search(search, observation, config)
    x, y = observation.position
    before_x, before_y = state.position or observation.position
    ticks = 1 + missed_ticks
    view = View(
        tick,
        config.tick_s,
        config.robot,
        config.team,
        observation.position,
        planned_team.own,
        planned_team.positions,
        estimate,
        partial(extrapolate, track, config.tick_s, config.parameters),
        config.parameters,
        state.goal,
        ((x - before_x) / ticks, (y - before_y) / ticks),
        planned_team.members,
        tuple([packet for _, packet in received]),
        None if estimate is None else tick - track.detected_tick,
        observation.scan,
        observation.seen,
        searching,
        present,
        newest,
    )
    return Perception(
        state, observation, missed_ticks, seen, view, peers, track, lost, newest, search
    )


def act(
    perception: Perception,
    memory: Any,
    decision: Decision,
    config: RobotConfig,
    refused: Mapping[str, int] = NOTHING_REFUSED,
) -> tuple[BrainState, Action]:
    """The second half: what a decision, one that ``validated`` has returned, comes to.

    ``memory``: what the policy remembers. ``refused``: how many messages the robot has refused so
    far, by cause; the command tells it, with what came too late for the filter.
    """
    state, observation, missed_ticks, seen, view, peers, track, lost, newest, search = perception
    (x, y), estimate, tick = observation.position, view.target, observation.tick
    wanted = _limit_step(decision.step, config.parameters.step_m_max)
    safe = avoid(
        wanted,
        observation.scan,
        [(seen_x - x, seen_y - y) for _, seen_x, seen_y in seen],
        (estimate.x - x, estimate.y - y) if estimate else None,
        config.parameters,
    )
    pose = _packet(state, observation, track, decision, config, missed_ticks)
    command = Command(
        config.robot,
        tick,
        (quantise_m(safe[0]), quantise_m(safe[1])),
        decision.mode,
        decision.xi,
        decision.point,
        (quantise_m(decision.goal[0]), quantise_m(decision.goal[1])),
        (quantise_m(estimate.x), quantise_m(estimate.y)) if estimate else None,
        decision.predictor,
        config.team
        if len(view.members) == len(config.team)
        else tuple([config.team[index] for index in view.members]),
        pose is not None,
        {**refused, LATE_DETECTION: track.dropped} if track.dropped else refused,
    )
    goal = None if decision.point is None else command.goal
    receiver_model = next_receiver_model(
        state.receiver_model, pose, tick, config.tick_s, config.parameters
    )
    after = BrainState(
        *(peers, track, observation.position, search, goal, receiver_model, lost),
        *(newest, memory),
    )
    return after, Action(pose, command)


def _skip_to(state: BrainState, tick: int, config: RobotConfig) -> tuple[BrainState, int]:
    """The state as of the tick before, and how many ticks have passed without an observation.

    In lock-step none has; by the clock a robot leaves out what comes late or never.
    """
    next_tick = state.track.first_tick + len(state.track.entries)
    if tick == next_tick:
        return state, 0
    parameters, receiver_model = config.parameters, state.receiver_model
    track = kalman.coast_to(state.track, tick, config.tick_s, parameters)
    if track.first_tick == tick:
        receiver_model = None
    for passed in range(next_tick, tick) if receiver_model else ():
        receiver_model = next_receiver_model(
            receiver_model, None, passed, config.tick_s, parameters
        )
    return state._replace(track=track, receiver_model=receiver_model), tick - next_tick


def _packet(
    state: BrainState,
    observation: Observation,
    track: Track,
    decision: Decision,
    config: RobotConfig,
    missed_ticks: int,
) -> Pose | None:
    """The pose to publish at this tick, None if there is none."""
    parameters, tick = config.parameters, observation.tick
    position, detection = observation.position, observation.target
    if not should_publish(
        state.receiver_model, tick, position, detection, config.tick_s, parameters
    ):
        return None
    fuses = parameters.detections in fusing.FUSIONS
    x, y = state.position or position
    since_s = config.tick_s * (1 + missed_ticks)
    return Pose(
        config.robot,
        tick,
        tick,
        position,
        ((position[0] - x) / since_s, (position[1] - y) / since_s),
        None if fuses else detection,
        decision.mode,
        decision.xi,
        decision.point,
        detections_to_relay(track, tick, config.own, config.team, parameters.relay_age_ticks_max)
        if parameters.detections == "relay"
        else (),
        None,
        decision.say if isinstance(decision.say, FrozenMap) else NOTHING_SAID,
        fusing.estimate_to_tell(track) if fuses else None,
    )


def _search(search: Search, observation: Observation, config: RobotConfig) -> Decision:
    """What the default search does at a tick."""
    x, y = observation.position
    goal = search_goal(search, observation.tick, config.own, len(config.team), config.parameters)
    return Decision("search", (goal[0] - x, goal[1] - y), goal)


def decide(memory: Any, view: View, config: RobotConfig) -> tuple[Any, Decision]:
    """What the policy remembers and decides.

    ``PluginFailed`` if the policy raises, or its decision is impossible.
    """
    try:
        return validated(config.policy(memory, view))
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise PluginFailed(STRATEGIES, config.name, config.robot, view.tick, error) from error


def _limit_step(step: Point, length_m_max: float) -> Point:
    """A step shortened to the longest that the robot can make."""
    length = hypot(*step)
    if length <= length_m_max:
        return step
    scale = length_m_max / length
    return step[0] * scale, step[1] * scale
