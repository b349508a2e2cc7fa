"""The robots of one process, and the thread that answers for them.

In lock-step one thread answers for all: it hands each message to the robot that it is for. A robot
whose run goes by the clock gets a thread and a queue of its own, since it decides when it is time,
and not when a message comes; if it is the only one, it takes the connection over.

What is wrong with one robot ends that robot alone. But a policy that never answers keeps the others
of its process waiting, in lock-step.
"""

import gc
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial

from encircle.agents.process.robot_runs import RobotRuns
from encircle.protocol.connections import Connection, Handler
from encircle.protocol.envelopes import (
    ANSWERS,
    ANSWERS_BYTES_MAX,
    OBSERVATIONS,
    Enclosed,
    opened,
    sealed,
)
from encircle.protocol.errors import ConnectionClosed, ProtocolError
from encircle.protocol.keys import parse_key, robot_key

MAIL_MAX = 4096
"""How many messages may wait for a robot with a thread of its own; the others wait for room."""
TOGETHER_S_MAX = 0.1
"""How long a robot's answer may wait for those of others that share its process."""
LOOK_S = 0.2
"""How often who waits there looks whether the connection is closed."""

Finish = Callable[[BaseException | None], None]
"""Is told, in whatever thread, that a robot answers no more, and of the error if there is one."""


class RobotHost:
    """The robots of one process. ``finish``: by robot, who is told that it answers no more.

    ``deciding``: the robot whose message is being taken in, None if none is. ``encloses``: whether
    the world is known to open envelopes; answers in lock-step then go in one.
    """

    def __init__(
        self, robots: Mapping[str, RobotRuns], connection: Connection, finish: Mapping[str, Finish]
    ) -> None:
        self.deciding: str | None = None
        self.encloses = False
        self._run = next(iter(robots.values())).core.run
        self._answers_key = robot_key(self._run, next(iter(robots)), ANSWERS)
        self._observations_key = robot_key(self._run, next(iter(robots)), OBSERVATIONS)
        self._connection = connection
        self._finish = finish
        self._alone = len(robots) == 1
        self._living = dict(robots)
        self._prefixes = {robot_key(self._run, robot, ""): robot for robot in robots}
        self._own_threads: dict[str, _OwnConnection] = {}
        self._lock = threading.Lock()

    def answer(self) -> None:
        """Answer until no robot is left or the connection is closed."""
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        error: BaseException | None = None
        try:
            while self._living:
                self._take(*self._connection.receive())
        except ConnectionClosed:
            pass
        except BaseException as raised:
            error = raised
        for robot in list(self._living):
            self.drop(robot, error)

    def drop(self, robot: str, error: BaseException | None = None) -> None:
        """A robot answers no more."""
        with self._lock:
            runs = self._living.pop(robot, None)
        if runs is not None:
            if robot in self._own_threads:
                self._own_threads[robot].close()
            runs.leave()
            self._finish[robot](error)

    def _take(self, key: str, payload: bytes) -> None:
        """Take in a message, or those of an envelope, and send the answers."""
        answers: list[tuple[str, bytes]] = []
        if key == self._observations_key:
            began_s = time.monotonic()
            try:
                for message in opened(OBSERVATIONS, payload, self._run):
                    answers += self._answers_to(*message)
                    if time.monotonic() - began_s > TOGETHER_S_MAX:
                        # Whom the world waits for long it asks again.
                        self._send(answers)
                        answers, began_s = [], time.monotonic()
            except ProtocolError as error:
                # The first robot counts it: it is on its key.
                for runs in list(self._living.values())[:1]:
                    runs.core.refuse(key, error)
        else:
            answers += self._answers_to(key, payload)
        self._send(answers)

    def _send(self, answers: list[tuple[str, bytes]]) -> None:
        for message in self._enclosed(answers) if self.encloses else answers:
            self._connection.send(*message)

    def _answers_to(self, key: str, payload: bytes) -> list[tuple[str, bytes]]:
        robot = self._prefixes.get(key[: key.rfind("/") + 1])
        runs = self._living.get(robot or "")
        if robot is None or runs is None:
            return []
        if robot in self._own_threads:
            self._own_threads[robot].put(key, payload)
            return []
        if runs.goes_by_clock(key, payload):
            self._answer_by_clock(robot, runs, (key, payload))
            return []
        self.deciding = robot
        try:
            answers = runs.take(key, payload)
        except BaseException as error:  # ours; a policy's are told by its robot's command
            self.drop(robot, error)
            return []
        finally:
            self.deciding = None
        if runs.over:
            self.drop(robot)
        return answers

    def _enclosed(self, answers: Sequence[tuple[str, bytes]]) -> Iterator[tuple[str, bytes]]:
        enclosed = []
        for key, payload in answers:
            _, robot, channel = parse_key(key)
            enclosed.append(Enclosed(robot or "", channel, payload))
        for envelope in sealed(enclosed, self._run, ANSWERS_BYTES_MAX):
            yield self._answers_key, envelope

    def _answer_by_clock(self, robot: str, runs: RobotRuns, first: tuple[str, bytes]) -> None:
        if not self._alone:
            self._start_thread(robot, runs, first)
            return
        self.deciding = robot
        runs.answer_by_clock(self._connection, first)
        self.deciding = None
        if runs.over:
            self.drop(robot)

    def _start_thread(self, robot: str, runs: RobotRuns, first: tuple[str, bytes]) -> None:
        self._connection.drop_when_congested()
        own = self._own_threads[robot] = _OwnConnection(self._connection)
        work = partial(self._answer_alone, robot, runs, own, first)
        threading.Thread(target=work, name=f"rounds-{robot}", daemon=True).start()

    def _answer_alone(
        self, robot: str, runs: RobotRuns, own: "_OwnConnection", first: tuple[str, bytes]
    ) -> None:
        try:
            runs.answer_by_clock(own, first)
            runs.answer(own)
        except ConnectionClosed:
            self.drop(robot)
        except BaseException as error:
            self.drop(robot, error)
        else:
            self.drop(robot)


class _OwnConnection:
    """One robot's part of a connection: it sends there, and receives what is put in here."""

    def __init__(self, shared: Connection) -> None:
        self._shared = shared
        self._messages: queue.Queue[tuple[str, bytes]] = queue.Queue(MAIL_MAX)
        self._closed = threading.Event()

    def put(self, key: str, payload: bytes) -> None:
        """A message has come for this robot; waits for room as long as there is somebody."""
        while not self._closed.is_set():
            with suppress(queue.Full):
                self._messages.put((key, payload), timeout=LOOK_S)
                return

    def send(self, key: str, payload: bytes) -> None:
        """As of the shared one."""
        self._shared.send(key, payload)

    def receive(self) -> tuple[str, bytes]:
        """The next message; ``ConnectionClosed`` when closed."""
        while not self._closed.is_set():
            with suppress(queue.Empty):
                return self._messages.get(timeout=LOOK_S)
        raise ConnectionClosed("this connection is closed")

    def subscribe(self, expression: str, handler: Handler) -> Callable[[], None]:
        """As of the shared one."""
        return self._shared.subscribe(expression, handler)

    def drop_when_congested(self) -> None:
        """It has been done for the shared one."""

    def close(self) -> None:
        """Nobody receives here any more."""
        self._closed.set()
