"""The messages that a world sends: to robots setups, observations and the end, and its own record.

Each function makes messages ``(key, payload)`` from what they are to say.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from encircle.protocol.codec import encode, encode_any_length
from encircle.protocol.envelopes import (
    OBSERVATIONS,
    OBSERVATIONS_BYTES_MAX,
    Enclosed,
    sealed,
    with_inbox,
)
from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.messages import End, Observation, PoseCarrier, Radio, Setup
from encircle.protocol.wire.limits import REASON_MAX
from encircle.world.arena.engine import Arena
from encircle.world.channel.channel import Fates

INBOX_APART_MIN = 8
"""From so many packets on, an observation in an envelope shares them with the others there."""

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
        self._lean: dict[str, bytes] = {}
        self._whole: dict[str, tuple[str, bytes]] = {}

    @cached_property
    def messages(self) -> Outgoing:
        """Setups and observations, in the order in which they are sent; encoded when first used."""
        return [*self.setups, *map(self._message, self.observations)]

    def messages_by(self, hosts: Mapping[str, str]) -> Outgoing:
        """The messages as they are sent: those of robots that share a process, in envelopes.

        ``hosts``: of robots that are asked by envelopes, the robot on whose key that is done. A
        robot that is set up anew is told by itself.
        """
        shared: dict[str, list[Observation]] = {}
        for observation in self.observations:
            host = hosts.get(observation.robot)
            if host is not None and observation.robot not in self.returned:
                shared.setdefault(host, []).append(observation)
        several = {host: asked for host, asked in shared.items() if len(asked) > 1}
        if not several:
            return self.messages
        enclosed = {asked.robot for together in several.values() for asked in together}
        outgoing = [*self.setups]
        outgoing += [self._message(o) for o in self.observations if o.robot not in enclosed]
        for host, asked in several.items():
            key = robot_key(self._run, host, OBSERVATIONS)
            contents = [self._enclosed(observation) for observation in asked]
            envelopes = sealed(contents, self._run, OBSERVATIONS_BYTES_MAX)
            outgoing += [(key, envelope) for envelope in envelopes]
        return outgoing

    def _enclosed(self, observation: Observation) -> Enclosed:
        robot = observation.robot
        if len(observation.inbox) < INBOX_APART_MIN:
            message = self._whole[robot] = observation_message(self._run, observation)
            return Enclosed(robot, "observation", message[1])
        lean = encode_any_length(observation, self._run, inbox=())
        self._lean[robot] = lean
        return Enclosed(robot, "observation", lean, observation.inbox)

    def _message(self, observation: Observation) -> tuple[str, bytes]:
        if (message := self._whole.get(observation.robot)) is not None:
            return message
        lean = self._lean.get(observation.robot)
        if lean is None:
            return observation_message(self._run, observation)
        key = robot_key(self._run, observation.robot, "observation")
        return key, with_inbox(lean, observation.inbox) if observation.inbox else lean

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
