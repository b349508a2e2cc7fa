"""A running hunt for the eyes of ROS 2: each state that the world shows, on the topics of a scene.

The bridge looks on as any viewer does: it takes what it gets, and the run waits for nothing here.
What comes faster than it can be sent on is passed over, the oldest first, and counted. States go
out as they come; what is said and meant at a tick is known a tick later (``Feed``), and waits until
no state does. It ends when the world has ended.
"""

import queue
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum

from encircle.protocol.codec import decode
from encircle.protocol.errors import ConnectionClosed, ProtocolError
from encircle.protocol.keys import world_key
from encircle.protocol.messages import State
from encircle.protocol.zenoh.raw_session import RawSession
from encircle.ros2.message_types import MessageTypes
from encircle.ros2.node import RosNode
from encircle.ros2.plane_messages import NS_PER_S
from encircle.ros2.scene_messages import SceneMessages
from encircle.scene.frame import Frame
from encircle.scene.stage import Stage

WORLD_S_MAX = 30.0
"""How long to wait for the world of the run, in s."""
STATES_MAX = 64
"""States that may wait to be sent on."""
STEP_S = 0.2
LINGER_S = 1.0
"""How long the last states may still be under way when the world's token has gone, in s."""


class TimeSource(StrEnum):
    """Where the time of messages comes from: the run's ticks, told on ``/clock``, or this clock."""

    SIMULATED = "sim"
    WALL = "wall"


def usual_time(stage: Stage) -> TimeSource:
    """That of the run: in lock-step its ticks, by the clock the clock."""
    return TimeSource.WALL if stage.clock == "wall" else TimeSource.SIMULATED


@dataclass(slots=True)
class BridgeReport:
    """What a bridge has done: states sent on, passed over, and refused, and why it ended.

    ``traffic``: of how many ticks it has shown what was said.
    """

    sent: int = 0
    traffic: int = 0
    passed_over: int = 0
    refused: int = 0
    ended: str = ""
    failed: bool = False


@dataclass(slots=True)
class _Mail:
    """What comes from Zenoh's threads, and from a signal."""

    states: "queue.Queue[bytes]" = field(default_factory=lambda: queue.Queue(STATES_MAX))
    alive: bool = False
    was_alive: bool = False
    interrupted: str = ""
    passed_over: int = 0

    def put(self, _key: str, payload: bytes) -> None:
        while True:
            try:
                self.states.put_nowait(payload)
                return
            except queue.Full:
                self.passed_over += self._drop_oldest()

    def _drop_oldest(self) -> int:
        try:
            self.states.get_nowait()
        except queue.Empty:
            return 0
        return 1

    def token_changed(self, _key: str, alive: bool) -> None:
        self.alive, self.was_alive = alive, True


class Bridge:
    """Puts the states of one run on ROS 2's topics.

    ``hunt``: the session on which the run is; ``node``: this bridge to ROS 2, perhaps on the same.
    ``frames``: returns those that are whole by now and were not given before. ``log``: gets a line
    on each state that is refused.
    """

    def __init__(
        self,
        hunt: RawSession,
        run: str,
        stage: Stage,
        frames: Callable[[], Iterable[Frame]],
        node: RosNode,
        types: MessageTypes,
        time_source: TimeSource,
        log: Callable[[str], None],
    ) -> None:
        self._run, self._node, self._types = run, node, types
        self._stage, self._time_source, self._log = stage, time_source, log
        self._frames = frames
        self._messages = SceneMessages(types, stage)
        self._before: State | None = None
        self._newest: Frame | None = None
        self._mail = _Mail()
        self.report = BridgeReport()
        node.advertise(self._messages.topics.all(time_source == TimeSource.SIMULATED))
        hunt.subscribe(world_key(run, "state"), self._mail.put)
        hunt.watch(world_key(run, "alive"), self._mail.token_changed)

    def interrupt(self, name: str) -> None:
        """End, because of a signal."""
        self._mail.interrupted = name

    def forward(self, world_s_max: float = WORLD_S_MAX) -> BridgeReport:
        """Send states on until the run is over; ``world_s_max``: how long to wait for its world."""
        mail, report, began_s, gone_s = self._mail, self.report, time.monotonic(), None
        while not report.ended:
            now_s = time.monotonic()
            if mail.interrupted:
                report.ended, report.failed = f"stopped by {mail.interrupted}", False
            elif not mail.was_alive and now_s - began_s > world_s_max:
                report.ended = f"no world of run {self._run} came within {world_s_max:g} s"
                report.failed = True
            gone_s = None if mail.alive or not mail.was_alive else gone_s or now_s
            if gone_s is not None and now_s - gone_s > LINGER_S and mail.states.empty():
                report.ended = "the world has ended"
            try:
                with suppress(queue.Empty):
                    self._take(mail.states.get(timeout=STEP_S))
                if mail.states.empty():
                    self._show_traffic()
            except ConnectionClosed as error:
                report.ended, report.failed = f"the connection is closed: {error}", True
        if not report.failed:
            with suppress(ConnectionClosed):
                self._show_end()
        report.passed_over = mail.passed_over
        return report

    def _take(self, payload: bytes) -> None:
        try:
            state = decode(State, payload, self._run)
        except ProtocolError as error:
            self._refuse(str(error))
            return
        robots = len(self._stage.robots)
        if len(state.robots) != robots:
            self._refuse(f"it is of {len(state.robots)} robots, the run has {robots}")
            return
        self._send(state)

    def _send(self, state: State) -> None:
        before, self._before = self._before, state
        self.report.sent += 1
        with_clock = self._time_source == TimeSource.SIMULATED
        made = self._messages.of(state, before, self._stamp_ns(state.tick), with_clock)
        for topic, message in made:
            self._node.publish(topic, self._types.encoded(message))

    def _show_traffic(self) -> None:
        for frame in self._frames():
            self._newest = frame
            topic, message = self._messages.traffic(frame, self._stamp_ns(frame.tick))
            self._node.publish(topic, self._types.encoded(message))
            self.report.traffic += 1

    def _show_end(self) -> None:
        """The last state of a run shows how it ended; it may have been missed."""
        newest, before = self._newest, self._before
        if newest is not None and (before is None or before.tick < newest.tick):
            self._send(_state_of(newest))
            time.sleep(STEP_S)  # a session that closes at once may take it along

    def _stamp_ns(self, tick: int) -> int:
        if self._time_source == TimeSource.WALL:
            return time.time_ns()
        return round(tick * self._stage.tick_s * NS_PER_S)

    def _refuse(self, why: str) -> None:
        self.report.refused += 1
        self._log(f"ros2: refused a state: {why}")


def _state_of(frame: Frame) -> State:
    """The truth in a frame."""
    return State(
        frame.tick,
        frame.robots,
        frame.headings_rad,
        frame.target,
        frame.captured,
        frame.contacts,
    )
