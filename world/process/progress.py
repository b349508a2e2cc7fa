"""How long a run has been waiting at a tick, and what is to be done about it. Sans I/O and clock.

A lock-step run waits for answers. Unanswered observations are sent again now and then, since a
router that was restarted has lost what was under way; an answer that does not come for too long is
overdue. By the clock nothing is sent again: the clock ends every tick, however long it is. Only the
program that started the world needs a report now and then, as a sign that the world is alive.
"""

from typing import NamedTuple, TypeAlias

RESEND_PERIOD_S = 1.0
LOOK_GAP_S_MAX = 0.5
"""How much of the time between two looks counts as waiting, for this world may have been frozen."""


class NewTick(NamedTuple):
    """The run is at another tick than at the last look."""


class StillWaiting(NamedTuple):
    """The run has waited for a further period. ``answers``: for answers, not for the clock.

    ``ask_again``: whether to send the unanswered observations once more.
    """

    answers: bool
    ask_again: bool


class Overdue(NamedTuple):
    """Answers have not come for ``answer_s_max``."""

    answer_s_max: float


Progress: TypeAlias = NewTick | StillWaiting | Overdue | None
"""What a look at a run has shown; None: nothing to be done."""


class LockStepWatch:
    """Watches a run in lock-step. ``answer_s_max``: how long answers may take.

    ``resumed_tick``: the tick at which a run was resumed, if it was, where robots have all of its
    past to take in before their first answer, which may take ``resumed_s_max``.
    """

    def __init__(
        self,
        answer_s_max: float,
        now_s: float,
        resumed_tick: int | None = None,
        resumed_s_max: float = 0.0,
    ) -> None:
        self._answer_s_max = answer_s_max
        self._resumed_tick = resumed_tick
        self._resumed_s_max = resumed_s_max
        self._wait = _Wait(now_s)

    def look(self, tick: int, now_s: float) -> Progress:
        """What there is to do about a run that is at a tick; times in s of any steady clock."""
        wait, resuming = self._wait, tick == self._resumed_tick
        answer_s_max = self._resumed_s_max if resuming else self._answer_s_max
        if wait.next_tick_at(tick, now_s):
            return NewTick()
        if wait.waited_s > answer_s_max:
            wait.restart()
            return Overdue(answer_s_max)
        return StillWaiting(answers=True, ask_again=not resuming) if wait.take_period() else None

    def rest(self, tick: int, now_s: float) -> bool:
        """Time that passes at a tick for want of nothing; False at the first look at the tick."""
        return self._wait.pass_over(tick, now_s)


class RealTimeWatch:
    """Watches a run by the clock. ``tick_s``: how long each tick is."""

    def __init__(self, tick_s: float, now_s: float) -> None:
        self._tick_s = tick_s
        self._wait = _Wait(now_s)

    def look(self, tick: int, now_s: float) -> Progress:
        """As ``LockStepWatch.look``; nothing is ever overdue."""
        wait = self._wait
        if wait.next_tick_at(tick, now_s):
            return NewTick()
        ticking = wait.waited_s < self._tick_s + RESEND_PERIOD_S
        waits = ticking and wait.take_period()
        return StillWaiting(answers=False, ask_again=False) if waits else None

    def rest(self, tick: int, now_s: float) -> bool:
        """As ``LockStepWatch.rest``; by the clock nothing is held back."""
        return self._wait.pass_over(tick, now_s)


class _Wait:
    """One wait after the other, in s; it begins with each new tick."""

    def __init__(self, now_s: float) -> None:
        self.waited_s = 0.0
        self._tick = -1
        self._again_s = RESEND_PERIOD_S
        self._looked_s = now_s

    def next_tick_at(self, tick: int, now_s: float) -> bool:
        """Look at the run, and begin to wait anew if it is at another tick; whether it is."""
        self.waited_s += min(now_s - self._looked_s, LOOK_GAP_S_MAX)
        self._looked_s = now_s
        if tick == self._tick:
            return False
        self._tick = tick
        self.restart()
        return True

    def pass_over(self, tick: int, now_s: float) -> bool:
        """Let the time since the last look count for nothing; False if it was at another tick."""
        if tick != self._tick:
            return False
        self._looked_s = now_s
        return True

    def restart(self) -> None:
        """Wait anew."""
        self.waited_s, self._again_s = 0.0, RESEND_PERIOD_S

    def take_period(self) -> bool:
        """Take a period of waiting that is over; whether there was one."""
        if self.waited_s <= self._again_s:
            return False
        self._again_s += RESEND_PERIOD_S
        return True
