"""Real views: short hunts in memory by the policy itself, in which all that it is asked is kept.

The scenes are those in which readers' policies break: bad radio, a target that nobody sees, a robot
that is lost and begins anew, a robot without peers, a large team.
"""

import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from types import FrameType
from typing import Any, NamedTuple

from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.policies.decision_check import validated
from encircle.agents.policies.interface import Decision, Policy, View
from encircle.conformance.canonical import canonical, digest_of
from encircle.protocol.codec import encode
from encircle.protocol.keys import parse_key
from encircle.protocol.plugins import PluginFailed
from encircle.world.arena.engine import build
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load
from encircle.world.scenario.model import Scenario

RUN = "check-policy"
ANSWER_S_MAX = 10.0
"""A decision that takes longer is given up; the default policy's takes less than a millisecond."""
LARGE_TEAM = 10
BAD_RADIO = {
    "loss": {"model": "bernoulli", "rate": 0.4},
    "delay": {"model": "uniform", "low_s": 0.0, "high_s": 0.5},
    "duplication": {"rate": 0.2},
}
FAR_AWAY = {"distance_m_min": 40.0, "distance_m_max": 60.0}
LOST = {"kind": "crash", "robot": "r2", "tick": 12, "ticks": 8}
SCENES: Mapping[str, Mapping[str, Any]] = {
    "plain": {"team": {"robots": 4}, "ticks_max": 40},
    "bad radio": {"team": {"robots": 4}, "ticks_max": 40, "channel": BAD_RADIO},
    "nothing seen": {"team": {"robots": 4, "placement": FAR_AWAY}, "ticks_max": 12},
    "a lost robot": {"team": {"robots": 3}, "ticks_max": 32, "events": [LOST]},
    "alone": {"team": {"robots": 1}, "ticks_max": 15},
    "large team": {"team": {"robots": LARGE_TEAM}, "ticks_max": 16},
}


class Answer(NamedTuple):
    """What a policy has answered, as digests: what it remembers, and what it decided."""

    memory: str
    decision: str


@dataclass
class Participation:
    """All that one robot was asked in a scene, from one setup to the next, and what it answered.

    ``decisions`` are as the brain takes them, what is said frozen. ``changed``: the ticks at which
    it changed what it was given, and whether that was its ``memory`` or its ``view``.
    """

    scene: str
    robot: str
    views: list[View] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    changed: list[tuple[int, str]] = field(default_factory=list)

    def place(self, view: View) -> str:
        """Who was asked, and when, for people."""
        return f"{self.robot} at tick {view.tick} ({self.scene})"


class Failure(NamedTuple):
    """A decision that a policy could not make, in a scene."""

    scene: str
    robot: str
    view: View
    memory: Any
    error: BaseException


class Recorded(NamedTuple):
    """What came of the scenes. ``failures``: at most one of each scene, which has ended it."""

    participations: list[Participation]
    failures: list[Failure]


class TooSlow(BaseException):
    """A decision that was given up; no ``Exception``, so that no policy catches it."""


def scenarios(name: str, own: Sequence[str], large_team: int) -> dict[str, Scenario]:
    """The scenes as scenarios; ``ScenarioError`` if an own parameter is not as it must be.

    ``own``: the policy's own parameters, as ``NAME=VALUE``.
    """
    changes = [f"team.policy_parameters.{setting}" for setting in own]
    found = {}
    for scene, tree in SCENES.items():
        team = {**tree["team"], "strategy": name}
        if scene == "large team":
            team["robots"] = large_team
        found[scene] = load({**tree, "team": team}, changes)
    return found


def record(scenes: Mapping[str, Scenario]) -> Recorded:
    """Hunt in every scene, and keep what each robot was asked."""
    recorded = Recorded([], [])
    for scene, scenario in scenes.items():
        _hunt(scene, scenario, recorded)
        if any(isinstance(failure.error, TooSlow) for failure in recorded.failures):
            # In the others it would take as long.
            break
    return recorded


class _Witness:
    """A policy that keeps what it is asked, and what it answers."""

    def __init__(self, policy: Policy, participation: Participation, recorded: Recorded) -> None:
        self.policy, self.participation, self.recorded = policy, participation, recorded

    def __call__(self, memory: Any, view: View) -> tuple[Any, Decision]:
        part = self.participation
        before = snapshot(memory), snapshot(view)
        try:
            with time_limit(ANSWER_S_MAX):
                answer = self.policy(memory, view)
            remembered, decision = validated(answer)
            seen = Answer(digest_of(remembered), digest_of(decision))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self.recorded.failures.append(Failure(part.scene, part.robot, view, memory, error))
            raise
        after = snapshot(memory), snapshot(view)
        for name, then, now in zip(("memory", "view"), before, after, strict=True):
            if then != now:
                part.changed.append((view.tick, name))
        part.views.append(view)
        part.answers.append(seen)
        part.decisions.append(decision)
        return remembered, decision


def _hunt(scene: str, scenario: Scenario, recorded: Recorded) -> None:
    """A hunt as in ``encircle.runner.memory``, whose robots are witnessed."""
    world = WorldCore(build(scenario, scenario.seed), RUN)
    cores = {robot: RobotCore(robot, RUN) for robot in scenario.ids}
    joined = [message for robot in cores for message in world.join(robot)]
    _set_up(scene, cores, joined, recorded)
    try:
        while world.ended is None:
            observations = world.ask()
            _set_up(scene, cores, world.rounds.open_round.setups, recorded)
            for observation in observations:
                pose, command = cores[observation.robot].decide(observation)
                packet = b"" if pose is None else encode(pose, RUN)
                world.answer(pose, packet, command, encode(command, RUN))
    except (PluginFailed, TooSlow):
        assert recorded.failures, "a witness has seen it"


def _set_up(
    scene: str,
    cores: Mapping[str, RobotCore],
    setups: Sequence[tuple[str, bytes]],
    recorded: Recorded,
) -> None:
    for key, payload in setups:
        core = cores[parse_key(key).robot or ""]
        core.receive(key, payload)
        assert core.config is not None, "this world's own setup"
        participation = Participation(scene, core.robot)
        witness = _Witness(core.config.policy, participation, recorded)
        core.config = replace(core.config, policy=witness)
        recorded.participations.append(participation)


def snapshot(value: Any) -> bytes | str:
    """What is the same before and after as long as nobody has changed the value."""
    try:
        return pickle.dumps(value)
    except Exception:
        # The check of memory says so.
        return canonical(value)


@contextmanager
def time_limit(s_max: float) -> Iterator[None]:
    """Raise ``TooSlow`` in what takes longer; no limit outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, _give_up)
    signal.setitimer(signal.ITIMER_REAL, s_max)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _give_up(_number: int, _frame: FrameType | None) -> None:
    raise TooSlow


def answers_of(
    policy: Policy, views: Sequence[View], between: Callable[[Any], Any] = lambda memory: memory
) -> list[Answer]:
    """What a policy answers when it is asked these views one after the other, from no memory on.

    ``between``: what is done to its memory after each.
    """
    memory, answers = None, []
    for view in views:
        memory, decision = validated(policy(memory, view))
        answers.append(Answer(digest_of(memory), digest_of(decision)))
        memory = between(memory)
    return answers


def answers_by_tick(
    policy: Policy, scenes: Sequence[Sequence[Sequence[View]]]
) -> list[list[Answer]]:
    """What a policy answers to each participation of each scene, asked tick by tick as in a hunt.

    ``scenes``: of each scene, of each participation its views.
    """
    answers: list[list[Answer]] = []
    for scene in scenes:
        of_scene: list[list[Answer]] = [[] for _ in scene]
        memories: list[Any] = [None] * len(scene)
        turns = [
            (v.tick, v.team.index(v.robot), k, v) for k, views in enumerate(scene) for v in views
        ]
        for _, _, k, view in sorted(turns, key=lambda turn: turn[:3]):
            memories[k], decision = validated(policy(memories[k], view))
            of_scene[k].append(Answer(digest_of(memories[k]), digest_of(decision)))
        answers += of_scene
    return answers
