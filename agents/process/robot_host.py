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
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial

from encircle.agents.process.robot_runs import RobotRuns
from encircle.protocol.connections import Connection, Handler
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.keys import robot_key

MAIL_MAX = 4096
"""How many messages may wait for a robot with a thread of its own; the others wait for room."""
LOOK_S = 0.2
"""How often who waits there looks whether the connection is closed."""

Finish = Callable[[BaseException | None], None]
"""Is told, in whatever thread, that a robot answers no more, and of the error if there is one."""


class RobotHost:
    """The robots of one process. ``finish``: by robot, who is told that it answers no more.

    ``deciding``: the robot whose message is being taken in, None if none is.
    """

    def __init__(
        self, robots: Mapping[str, RobotRuns], connection: Connection, finish: Mapping[str, Finish]
    ) -> None:
        self.deciding: str | None = None
        self._connection = connection
        self._finish = finish
        self._alone = len(robots) == 1
        self._living = dict(robots)
        self._prefixes = {
            robot_key(runs.core.run, robot, ""): robot for robot, runs in robots.items()
        }
        self._own_threads: dict[str, _OwnConnection] = {}
        self._lock = threading.Lock()

    def answer(self) -> None:
        """Answer until no robot is left or the connection is closed."""
        # What was imported stays for good: collecting garbage need not look at it again and again.
        gc.freeze()
        error: BaseException | None = None
        try:
            if self._alone:
                for runs in self._living.values():
                    runs.answer(self._connection)
            else:
                self._answer_several()
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

    def _answer_several(self) -> None:
        while self._living:
            key, payload = self._connection.receive()
            robot = self._prefixes.get(key[: key.rfind("/") + 1])
            runs = self._living.get(robot or "")
            if robot is None or runs is None:
                continue
            if robot in self._own_threads:
                self._own_threads[robot].put(key, payload)
            elif runs.goes_by_clock(key, payload):
                self._start_thread(robot, runs, (key, payload))
            else:
                self._take(robot, runs, key, payload)

    def _take(self, robot: str, runs: RobotRuns, key: str, payload: bytes) -> None:
        self.deciding = robot
        try:
            messages = runs.take(key, payload)
        except BaseException as error:  # ours; a policy's are told by its robot's command
            self.drop(robot, error)
            return
        finally:
            self.deciding = None
        for message in messages:
            self._connection.send(*message)
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
