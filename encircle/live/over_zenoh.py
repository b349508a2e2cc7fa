"""Looking on at a hunt over Zenoh, on this host or any other, from its start or from now on.

The run's world is asked for scenario, seed and setups; from then on all that is said in the run is
heard, and says what there is to see. Nobody waits for who looks on, so what it cannot take in time
is missed, noticed and told.
"""

import json
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace

from encircle.live.inbox import Inbox
from encircle.live.rounds import Round, RoundCollector
from encircle.live.scene_feed import SceneFeed, names
from encircle.live.updates import RunState, Status, Update
from encircle.protocol.errors import ProtocolError, UnknownKey
from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.protocol.zenoh.onlooker import Onlooker
from encircle.protocol.zenoh.scenario_query import RunDescription
from encircle.scene.stage import Stage
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError
from encircle.world.scenario.model import Scenario

WAIT_S_MAX = 10.0
"""How long a world is waited for that is not there yet, in s."""
ASK_S_MAX, ASK_PERIOD_S = 1.0, 0.2
TOKENS_S_MAX = 1.0
LATE_S_MAX = 0.5
"""How long a round may wait for what is missing of it while later ones are there."""
LAST_S_MAX = 2.0
"""How long what was said last may be on its way after the end was told."""
GONE_S_MAX = 5.0
"""How long a world may be gone: who looks on and was frozen has lost its connection and gets it
back, and whether the world lives is only known then."""
GONE, LOST = "the world is gone", "the world is out of reach: trying again"

Heard = tuple[str, bytes | bool]
"""A key with a message's payload, or with whether its token is there."""


class NothingToSee(Exception):
    """A run that cannot be looked on at; the message says in one line which and why."""


class ZenohFeed:
    """A ``encircle.live.updates.Feed`` of a run over Zenoh.

    ``beliefs``: whether to work out what robots believe, which takes as long as they take to
    decide. ``wait_s_max``: how long to wait for the run's world. ``so_far``: what is recorded of a
    run that is gone on with, (tick, key, payload). Raises ``ConnectionFailed``, and
    ``NothingToSee`` if no such world answers or its scenario cannot be understood here.
    """

    def __init__(
        self,
        endpoints: Endpoints,
        run: str,
        beliefs: bool = True,
        wait_s_max: float = WAIT_S_MAX,
        so_far: Iterable[tuple[int, str, bytes]] = (),
    ) -> None:
        self.run = run
        self._where = endpoints
        self._inbox: Inbox[Heard] = Inbox(_size)
        self._onlooker = Onlooker(
            endpoints,
            run,
            lambda key, payload: self._inbox.put((key, payload)),
            lambda key, alive: self._inbox.put((key, alive)),
        )
        try:
            described = self._described(wait_s_max)
            self.scenario = self._scenario(described)
        except BaseException:
            self.close()
            raise
        self.seed = described.seed
        self._scene = SceneFeed(self.scenario, self.seed, run, beliefs)
        by_clock = self.scenario.clock == "wall"
        robots = self.scenario.ids
        self._rounds = RoundCollector(run, robots, self.scenario.ticks_max, by_clock)
        for robot, setup in zip(robots, described.setups, strict=False):
            # They may have been sent before anybody looked on.
            self._rounds.take(robot_key(run, robot, "setup"), setup)
        self._recorded = [r for _, key, said in so_far for r in self._rounds.take(key, said)]
        self._there: set[str] = set()
        self._heard_s = time.monotonic()
        self._ended_s: float | None = None
        self._gone_s: float | None = None
        self._reason = ""
        self._over = False

    @property
    def stage(self) -> Stage:
        """The hunt's constants."""
        return self._scene.stage

    def take(self, wait_s: float) -> Update:
        """What is new, as ``encircle.live.updates.Feed.take``."""
        rounds, self._recorded = self._recorded, []
        for key, what in [] if self._over else self._inbox.take(0.0 if rounds else wait_s):
            if isinstance(what, bool):
                self._see(key, what)
            else:
                rounds += self._rounds.take(key, what)
        rounds += self._given_up(rounds)
        if not self._over:
            self._look_for_end()
        if self._over:
            rounds += self._rounds.flush()
        messages, frames = self._scene.take(rounds)
        if self._over:
            frames += self._scene.finish()
        return Update(tuple(messages), tuple(frames), self._status())

    def close(self) -> None:
        """Look on no longer; may be called twice, and from any thread."""
        self._inbox.close()
        self._onlooker.close()

    def _given_up(self, rounds: list[Round]) -> list[Round]:
        """The rounds that go on without what has not come for too long."""
        now_s = time.monotonic()
        if rounds:
            self._heard_s = now_s
        elif now_s - self._heard_s > LATE_S_MAX:
            return self._rounds.give_up()
        return []

    def _described(self, wait_s_max: float) -> RunDescription:
        """What the world says of its run; waits for it to come."""
        until_s = time.monotonic() + wait_s_max
        while True:
            try:
                described = self._onlooker.description(ASK_S_MAX)
            except ProtocolError as error:
                raise NothingToSee(f"the world of run {self.run}: {error}") from None
            if described is not None:
                return described
            if time.monotonic() >= until_s:
                raise NothingToSee(self._why_nothing(wait_s_max))
            time.sleep(ASK_PERIOD_S)

    def _why_nothing(self, waited_s: float) -> str:
        until_s = time.monotonic() + TOKENS_S_MAX
        while not (runs := self._onlooker.runs(TOKENS_S_MAX)) and time.monotonic() < until_s:
            time.sleep(ASK_PERIOD_S)
        if self.run in runs:
            return (
                f"the world of run {self.run} does not tell its scenario:"
                " it is of an earlier version, or not of this program"
            )
        there = f"the runs there are {names(runs)}" if runs else "no run is there"
        return f"no world of run {self.run} answers at {self._where} for {waited_s:g} s; {there}"

    def _scenario(self, described: RunDescription) -> Scenario:
        try:
            tree = json.loads(described.scenario)
            if type(tree) is not dict:
                raise ValueError("its scenario is not a table")
            return load(tree)
        except (ScenarioError, ValueError, RecursionError) as error:
            # As of a policy or target behaviour that is not installed here.
            text = " ".join(str(error).split())
            raise NothingToSee(f"run {self.run} cannot be understood here: {text}") from None

    def _see(self, key: str, alive: bool) -> None:
        """A token came or went."""
        if key == world_key(self.run, "alive"):
            self._gone_s = None if alive else time.monotonic()
            return
        with suppress(UnknownKey):
            robot = parse_key(key).robot or ""
            (self._there.add if alive else self._there.discard)(robot)

    def _look_for_end(self) -> None:
        end, now_s = self._rounds.end, time.monotonic()
        if end is not None and self._ended_s is None:
            self._ended_s = now_s
        has_last = end is not None and (self._rounds.first_to_come or 0) > end.tick
        is_late = self._ended_s is not None and now_s - self._ended_s > LAST_S_MAX
        is_gone = self._gone_s is not None and now_s - self._gone_s > GONE_S_MAX
        if has_last or is_late or is_gone:
            self._over = True
            self._reason = GONE if end is None else end.reason

    def _status(self) -> Status:
        scene, missed = self._scene, self._rounds.missed_ticks
        if self._over:
            return scene.status(RunState.ENDED, self._reason, missed)
        if scene.joined_tick is None:
            return Status(RunState.WAITING, self._waiting_text())
        status = scene.status(RunState.RUNNING, "", missed)
        if self._gone_s is None:
            return status
        return replace(status, text=f"{LOST}; {status.text}" if status.text else LOST)

    def _waiting_text(self) -> str:
        absent = [robot for robot in self.scenario.ids if robot not in self._there]
        return f"waiting for {names(absent)}" if absent else "every robot is there"


def _size(heard: Heard) -> int:
    key, what = heard
    return len(key) + (len(what) if isinstance(what, bytes) else 0)
