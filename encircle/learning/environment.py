"""The hunt as a PettingZoo ``ParallelEnv``: the same world, channel, robots and seeds.

An episode is a hunt in memory (``encircle.runner.memory``) whose robots are asked for a decision
here: ``reset`` and ``step`` return what each of them knows, and the next ``step`` takes what each
is to do. Everything else of a robot, its peers, filter, limits and avoidance, is its own brain's;
its packets go through the scenario's channel. So the digest of an episode is that of a run whose
policy decides the same.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Unpack

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from encircle.agents.brain.brain import Perception
from encircle.agents.brain.robot_core import RobotCore
from encircle.agents.policies.decision_check import validated
from encircle.learning.acting import STEP, checked, decision
from encircle.learning.observing import BOUND, Floats, Layout, observation
from encircle.learning.options import RENDER_MODES, Options, settings_of
from encircle.protocol.messages import Observation
from encircle.protocol.plugins import PluginFailed
from encircle.runner.memory import give_answer, joined, next_observations
from encircle.world.arena import engine
from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.fields import SEED_END
from encircle.world.scenario.model import Scenario

RUN = "learning"
Parts = tuple[
    dict[str, Floats],
    dict[str, float],
    dict[str, bool],
    dict[str, bool],
    dict[str, dict[str, Any]],
]


def parallel_env(
    scenario: str | Path | Mapping[str, Any] | Scenario,
    *,
    overrides: Sequence[str] = (),
    **options: Unpack[Options],
) -> "HuntEnv":
    """The hunts of a scenario as an environment.

    ``scenario``, ``overrides``: as for ``encircle.run``. Options: ``agents``: the robots that are
    decided for from outside, all if left out; the others have the scenario's policy. ``payload``:
    how many numbers each tells its peers, 0 if left out. ``scan``: whether the observation has the
    range scan, not if left out. ``searches``: whether a robot that knows nothing of the target
    searches on its own, so if left out. ``reward``: its weights (``Reward``). ``render_mode``:
    ``rgb_array``, or None.

    Raises ``ScenarioError`` for a scenario that cannot be run, or not without a clock, and
    ``ValueError`` for an option that is unknown or makes no sense.
    """
    if isinstance(scenario, Scenario):
        scenario = scenario.model_dump(mode="json", exclude_unset=True)
    return HuntEnv(load(scenario, overrides), **options)


class HuntEnv(ParallelEnv[str, Floats, NDArray[Any]]):  # type: ignore[misc]  # it has no types
    """An environment over one scenario; options and errors are those of ``parallel_env``.

    ``layout``: which number of an observation means what; ``settings``: its options; ``world``: the
    world of the hunt under way, to be looked at; ``seed``: that hunt's.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "encircle_v0",
        "render_modes": list(RENDER_MODES),
        "is_parallelizable": True,
    }

    def __init__(self, scenario: Scenario, **options: Unpack[Options]) -> None:
        if scenario.clock != "lockstep":
            raise ScenarioError(
                f"clock = {scenario.clock!r}: no time passes in an environment; must be 'lockstep'"
            )
        self.scenario = scenario
        self.settings = settings = settings_of(options, scenario.ids)
        self.render_mode = settings.render_mode
        self.possible_agents, self.agents = list(settings.agents), list[str]()
        rays = scenario.sensing.rays if settings.scan else 0
        self.layout = Layout(len(scenario.ids), settings.payload, rays)
        seen, done = (self.layout.size,), (STEP + settings.payload,)
        agents = self.possible_agents
        self.observation_spaces = {a: Box(-BOUND, BOUND, seen, np.float32) for a in agents}
        self.action_spaces = {a: Box(-1.0, 1.0, done, np.float32) for a in agents}
        self.seed = scenario.seed - 1
        self.world: WorldCore | None = None
        self.trail: list[NDArray[np.float64]] = []
        self._cores: dict[str, RobotCore] = {}
        self._asked: list[Observation] = []
        self._perceptions: dict[str, Perception] = {}
        self._potential = 0.0

    def observation_space(self, agent: str) -> Box:
        """The space of a robot's observations, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """The space of a robot's actions, always the same object."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002  # PettingZoo has it
    ) -> tuple[dict[str, Floats], dict[str, dict[str, Any]]]:
        """Begin a hunt; returns observations and infos.

        ``seed``: the world's; without one that of the hunt before plus one, at first the
        scenario's. ``options`` has no effect.
        """
        seed = self.seed + 1 if seed is None else seed
        if not isinstance(seed, int | np.integer) or not 0 <= seed < SEED_END:
            raise ValueError(f"seed = {seed!r}: must be a whole number from 0 to {SEED_END - 1}")
        self.seed = int(seed)
        self.world, self._cores = joined(engine.build(self.scenario, self.seed), RUN, _no_log)
        self.agents, self.trail = list(self.possible_agents), []
        self._go_on(self.world)
        self._potential = self.settings.reward.potential(self.world.arena, self.world.state)
        return self._observations(), {agent: self._info(agent) for agent in self.agents}

    def step(self, actions: Mapping[str, Any]) -> Parts:
        """One tick; returns observations, rewards, terminations, truncations and infos.

        ``actions``: of each agent numbers (2 + payload,) from -1 to 1; those of lost robots do not
        matter. ``ValueError`` names the agent and the value that is wrong; nothing has happened
        then. ``PluginFailed`` if a policy or the target's behaviour fails.
        """
        world = self.world
        if world is None or not self.agents:
            raise ValueError("step: no hunt is under way; call reset first")
        numbers = self._checked(actions)
        # A hunt may be over where it begins.
        if world.ended is None:
            try:
                self._answer(world, numbers)
                self._go_on(world)
            except PluginFailed:
                self.agents = []
                raise
        return self._parts(world)

    def _answer(self, world: WorldCore, numbers: Mapping[str, Sequence[float]]) -> None:
        """Answer for every robot that is asked."""
        for asked in self._asked:
            core = self._cores[asked.robot]
            perception = self._perceptions.get(asked.robot)
            if perception is None:
                action = core.decide(asked)
            else:
                searches = self.settings.searches
                wanted = decision(perception.view, numbers[asked.robot], searches=searches)
                action = core.act(perception, validated((None, wanted))[1])
            give_answer(world, *action)
        world.rounds.commit()

    def _go_on(self, world: WorldCore) -> None:
        """Go on to the next round, or to the end, whose observations nobody answers."""
        observations = next_observations(world, self._cores)
        if world.rounds.plugin_failure is not None:
            raise world.rounds.plugin_failure
        if world.ended is not None:
            observations = engine.observe(world.arena, world.state, world.rounds.lost)
        self._asked = observations
        self._perceptions = {
            asked.robot: self._cores[asked.robot].perceive(asked)
            for asked in observations
            if asked.robot in self.observation_spaces
        }
        if self.render_mode is not None:
            self.trail.append(world.state.positions[: len(self.scenario.ids) + 1].copy())

    def _parts(self, world: WorldCore) -> Parts:
        """What a step returns."""
        agents, captured = self.agents, world.state.captured
        before = self._potential
        self._potential = self.settings.reward.potential(world.arena, world.state)
        parts = self.settings.reward.of_step(captured, before, self._potential)
        infos = {agent: self._info(agent, parts) for agent in agents}
        over = world.ended is not None
        if over:
            self.agents = []
        return (
            self._observations(agents),
            dict.fromkeys(agents, sum(parts.values())),
            dict.fromkeys(agents, captured),
            dict.fromkeys(agents, over and not captured),
            infos,
        )

    def state(self) -> Floats:
        """The truth, for a critic that may know it: float32 (5 N + 4,).

        Of each robot whether it takes part, its place relative to the target over the sensing
        range, and its last step over the longest one; then cosine and sine of the target's heading
        and its place relative to where it began.
        """
        assert self.world is not None, "after reset"
        state, count, team = self.world.state, len(self.scenario.ids), self.scenario.team
        there = np.ones(count) if state.away is None else state.away == 0
        target = state.positions[count]
        rays = (state.positions[:count] - target) / team.sensing_range_m
        steps = state.last_steps / team.step_m_max
        heading = float(state.headings[count])
        moved = (target - np.array(self.scenario.target.position)) / team.sensing_range_m
        robots = np.column_stack([there, rays, steps]).ravel()
        rest = [np.cos(heading), np.sin(heading), *moved]
        return np.concatenate([robots, rest]).astype(np.float32)

    def render(self) -> NDArray[np.uint8] | None:
        """The hunt so far as a picture (800, 640, 3), None without a render mode."""
        if self.render_mode is None:
            return None
        # Imported late: most learners draw nothing.
        from encircle.learning.rendering import picture

        assert self.world is not None, "after reset"
        return picture(self.world, self.trail)

    def close(self) -> None:
        """End the hunt under way."""
        self.world, self.agents = None, []

    def _observations(self, agents: Sequence[str] | None = None) -> dict[str, Floats]:
        payload, scan = self.settings.payload, self.settings.scan
        return {
            agent: observation(self._perceptions[agent].view, payload=payload, scan=scan)
            if agent in self._perceptions
            else np.zeros(self.layout.size, np.float32)
            for agent in (self.agents if agents is None else agents)
        }

    def _info(self, agent: str, reward: Mapping[str, float] | None = None) -> dict[str, Any]:
        """What an agent is told beside: tick, whether it is lost, parts of the reward, the end."""
        assert self.world is not None, "after reset"
        world, lost = self.world, agent not in self._perceptions
        info: dict[str, Any] = {"tick": world.state.tick, "lost": lost}
        if reward is not None:
            info["reward"] = dict(reward)
        if world.ended is not None:
            result = world.rounds.result()
            info |= {"captured": result.captured, "digest": result.digest, "seed": self.seed}
        return info

    def _checked(self, actions: Mapping[str, Any]) -> dict[str, list[float]]:
        """The actions as numbers; ``ValueError`` names agent and value."""
        for agent in actions:
            if agent not in self.agents:
                known = ", ".join(self.agents)
                raise ValueError(f"actions[{agent!r}]: is of no agent; they are: {known}")
        numbers = {}
        for agent in self.agents:
            if agent not in actions:
                raise ValueError(f"actions: lack that of {agent}")
            try:
                numbers[agent] = checked(actions[agent], STEP + self.settings.payload)
            except ValueError as error:
                raise ValueError(f"action of {agent}: {error}") from None
        return numbers


def _no_log(_line: str) -> None:
    """Refusals are counted in the result; a learner has no use for a line on each."""
