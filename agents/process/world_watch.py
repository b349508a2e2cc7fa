"""Whether a robot's world is present, and how long the robot waits for it.

A world that has lost its liveliness token is present as long as its messages arrive. A world that
is gone leaves its robot standing: in lock-step nothing moves that was not commanded in the round.
The robot waits a bounded time for a world of that run, which tells it all that it needs.
"""

import asyncio
from collections.abc import Callable
from functools import partial

from encircle.agents.process.robot_runs import RobotRuns

SUSPICION_S = 0.2
"""How long, after its token, a world's messages may still be under way; then how long it may be
silent before it counts as gone."""


class RobotEnd:
    """The end of a robot's process: ``reason`` is set once there is one to end it early.

    ``interrupted``: whether a signal has come.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.interrupted = False
        self.reason: asyncio.Future[str] = self._loop.create_future()

    def interrupt(self, name: str) -> None:
        """End the process because of a signal; called as a signal handler is."""
        self.interrupted = True
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self.stop, f"stopped by {name}")

    def stop(self, reason: str) -> None:
        """End the process. Later reasons are ignored."""
        if not self.reason.done():
            self.reason.set_result(reason)


class WorldWatch:
    """Watches for one robot whether its world is present; ``end`` is told when it waits in vain.

    ``world``: how to call it in lines to ``report``. ``join_s_max``, ``world_s_max``: how long the
    robot waits to be admitted, and for a world that is gone to return, in s.
    """

    def __init__(
        self,
        runs: RobotRuns,
        end: RobotEnd,
        report: Callable[[str], None],
        world: str,
        join_s_max: float,
        world_s_max: float,
    ) -> None:
        self._runs = runs
        self._end = end
        self._report = report
        self._world = world
        self._join_s_max = join_s_max
        self._world_s_max = world_s_max
        self._loop = asyncio.get_running_loop()
        self._admission_timer: asyncio.TimerHandle | None = None
        self._return_timer: asyncio.TimerHandle | None = None
        self._silence_timer: asyncio.TimerHandle | None = None
        self._gone = False

    def await_admission(self) -> None:
        """Give up unless the world sends something acceptable in time."""
        _cancel(self._admission_timer)
        check = partial(self._check_admitted, self._runs.accepted)
        self._admission_timer = self._loop.call_later(self._join_s_max, check)

    def token_changed(self, _key: str, alive: bool) -> None:
        """The world's token came or went; may be called from another thread."""
        self._loop.call_soon_threadsafe(self.world_changed, alive)

    def world_changed(self, alive: bool) -> None:
        """The world's token came or went."""
        _cancel(self._silence_timer)
        if alive and self._gone:
            self._world_returned()
            self.await_admission()
        elif not alive and self._runs.idle:
            self._world_lost()
        elif not alive:
            self._silence_timer = self._loop.call_later(SUSPICION_S, self._check_silence, None)

    def cancel(self) -> None:
        """Wait for nothing any more."""
        _cancel(self._admission_timer)
        _cancel(self._return_timer)
        _cancel(self._silence_timer)

    def _check_silence(self, accepted_before: tuple[int, int] | None) -> None:
        """Without its token a world is present as long as its messages arrive, and gone else.

        ``accepted_before``: what was accepted by the check before; None at the first one.
        """
        if self._runs.core.ended is not None:
            return
        accepted, first = self._runs.accepted, accepted_before is None
        arrives = not first and accepted != accepted_before
        if arrives and self._gone:
            self._world_returned()
        elif not first and not arrives and not self._gone:
            self._world_lost()
        self._silence_timer = self._loop.call_later(SUSPICION_S, self._check_silence, accepted)

    def _world_returned(self) -> None:
        self._gone = False
        _cancel(self._return_timer)
        self._report(f"{self._world} is back")

    def _world_lost(self) -> None:
        if self._runs.idle or self._runs.rejoins:
            self._end.stop(f"{self._world} is gone")
            return
        self._gone = True
        if self._runs.core.config is None:
            # Not taken in yet, it waits for that alone, as long as it would have.
            self._report(f"{self._world} is gone: waiting for one to take this robot in")
            return
        self._report(
            f"{self._world} is gone: standing still, waiting up to {self._world_s_max:g} s for it"
        )
        _cancel(self._admission_timer)
        self._return_timer = self._loop.call_later(self._world_s_max, self._give_up_world)

    def _give_up_world(self) -> None:
        in_time = f"was not back within {self._world_s_max:g} s"
        self._end.stop(f"{self._world} is gone, and {in_time}")

    def _check_admitted(self, accepted_before: tuple[int, int]) -> None:
        mismatch = self._other_version()
        if mismatch is not None:
            self._end.stop(mismatch)
        elif self._runs.accepted == accepted_before and not self._runs.idle:
            self._end.stop(
                f"{self._world} did not take this robot in within {self._join_s_max:g} s:"
                " is there one, and does it say why?"
            )

    def _other_version(self) -> str | None:
        """That the world speaks another version, if the robot was not set up because of that."""
        core = self._runs.core
        if core.config is not None or core.version_mismatch is None:
            return None
        return f"{self._world} speaks another version: {core.version_mismatch}"


def _cancel(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()
