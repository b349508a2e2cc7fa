"""Looking on at a hunt in the memory of this process: the same updates as over Zenoh.

The hunt's thread hands each message over as it records it, and never waits. Frames are made in the
thread of whoever looks on; if that is too slow, rounds are missed as they are over Zenoh.
"""

import threading
from collections.abc import Iterable

from encircle.live.inbox import Inbox
from encircle.live.rounds import Message, Round
from encircle.live.scene_feed import SceneFeed
from encircle.live.updates import RunState, Status, Update
from encircle.protocol.codec import decode
from encircle.protocol.messages import End
from encircle.scene.stage import Stage
from encircle.world.scenario.model import Scenario


class MemoryFeed:
    """A ``encircle.live.updates.Feed`` of a hunt in this process.

    ``so_far``: what is recorded of a hunt that is gone on with, (tick, key, payload).
    """

    def __init__(
        self, scenario: Scenario, run: str, beliefs: bool = True, so_far: Iterable[Message] = ()
    ) -> None:
        self.run = run
        self.scenario = scenario
        self.seed = scenario.seed
        self._scene = SceneFeed(scenario, scenario.seed, run, beliefs)
        self._inbox: Inbox[Round] = Inbox(lambda heard: sum(len(m[2]) for m in heard.messages))
        self._next_tick = -1
        self._missed = 0
        self._round: list[Message] = []
        self._reason = ""
        self._over = threading.Event()
        for message in so_far:
            self.hear(*message)

    @property
    def stage(self) -> Stage:
        """The hunt's constants."""
        return self._scene.stage

    def hear(self, tick: int, key: str, payload: bytes) -> None:
        """Take in a message, in the order of the recording."""
        if self._round and tick != self._round[0][0]:
            self._hand_over()
        topic = key.split("/", 2)[2]
        self._round.append((tick, topic, payload))
        if topic.endswith("/end"):
            self._reason = decode(End, payload, self.run).reason

    def end(self) -> None:
        """There is nothing more to hear."""
        self._hand_over()
        self._over.set()
        self._inbox.close()

    def take(self, wait_s: float) -> Update:
        """What is new, as ``encircle.live.updates.Feed.take``."""
        over = self._over.is_set()
        rounds = self._inbox.take(wait_s)
        for heard in rounds:
            if heard.tick > self._next_tick >= 0:
                self._missed += heard.tick - self._next_tick
            self._next_tick = heard.tick + 1
        messages, frames = self._scene.take(rounds)
        if over:
            frames += self._scene.finish()
        return Update(tuple(messages), tuple(frames), self._status(over))

    def close(self) -> None:
        """Look on no longer; may be called twice, and from any thread."""
        self._inbox.close()

    def _hand_over(self) -> None:
        if self._round:
            self._inbox.put(Round(self._round[0][0], tuple(self._round), whole=True))
            self._round = []

    def _status(self, over: bool) -> Status:
        state = RunState.RUNNING if self._next_tick > 0 else RunState.WAITING
        return self._scene.status(RunState.ENDED if over else state, self._reason, self._missed)
