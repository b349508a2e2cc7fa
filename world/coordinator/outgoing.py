"""The messages that a world sends: to robots setups, observations and the end, and its own record.

Each function makes messages ``(key, payload)`` from what they are to say.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.codec import encode
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import End, Observation, PoseCarrier, Radio, Setup
from encircle.protocol.wire.limits import REASON_MAX
from encircle.world.arena.engine import Arena
from encircle.world.channel.channel import Fates

Outgoing = list[tuple[str, bytes]]


def setup_message(
    arena: Arena, run: str, robot: str, tick: int, policy_source: str
) -> tuple[str, bytes]:
    """A robot's setup; it observes and answers from ``tick`` on.

    ``policy_source``: the SHA-256 of the file that its policy is in, "" for any.
    """
    scenario = arena.scenario
    setup = Setup(
        robot,
        arena.ids,
        scenario.tick_s,
        scenario.strategy_of(robot),
        scenario.parameters_of(robot),
        PoseCarrier(scenario.radio),
        tick,
        tick,
        scenario.policy_parameters_of(robot),
        policy_source,
    )
    return robot_key(run, robot, "setup"), encode(setup, run)


def observation_message(run: str, observation: Observation) -> tuple[str, bytes]:
    """An observation to the robot that it is for."""
    return robot_key(run, observation.robot, "observation"), encode(observation, run)


def end_messages(robots: Sequence[str], run: str, tick: int, reason: str) -> Outgoing:
    """The end of the run, to every robot of the team."""
    return [
        (robot_key(run, robot, "end"), encode(End(robot, tick, reason[:REASON_MAX]), run))
        for robot in robots
    ]


def radio_of(tick: int, fates: Fates) -> Radio:
    """The fates that the channel has drawn for the packets of a tick."""
    return Radio(tick, _rows(fates.due), _rows(fates.copies))


def radio_message(run: str, tick: int, fates: Fates) -> tuple[str, bytes]:
    """As ``radio_of``, as a message."""
    return world_key(run, "radio"), encode(radio_of(tick, fates), run)


def _rows(table: NDArray[np.int64] | None) -> tuple[tuple[int, ...], ...]:
    return () if table is None else tuple(map(tuple, table.tolist()))


class OpenRound:
    """What the world has sent at the beginning of a round.

    ``setups`` go to the robots that are back, ``returned``, before all ``observations``.
    """

    def __init__(
        self,
        run: str,
        returned: Sequence[str] = (),
        setups: Sequence[tuple[str, bytes]] = (),
        observations: Sequence[Observation] = (),
    ) -> None:
        self.returned = tuple(returned)
        self.setups = list(setups)
        self.observations = list(observations)
        self._run = run

    @cached_property
    def messages(self) -> Outgoing:
        """Setups and observations, in the order in which they are sent; encoded when first used."""
        return [*self.setups, *(observation_message(self._run, o) for o in self.observations)]

    def messages_to(self, robots: Collection[str]) -> Outgoing:
        """Those of the messages that go to any of these robots."""
        keys = {
            robot_key(self._run, robot, channel)
            for robot in robots
            for channel in ("setup", "observation")
        }
        return [message for message in self.messages if message[0] in keys]

    def observation_of_beginner(self, robot: str) -> Outgoing:
        """The observation of a robot that begins anew, if it was asked: it has answered nothing."""
        return [
            observation_message(self._run, replace(observation, answered=None))
            for observation in self.observations
            if observation.robot == robot
        ]
