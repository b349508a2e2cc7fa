"""Looks at a run again and again: reports its progress, and acts when an answer does not come."""

import asyncio
import time
from functools import partial

from encircle.world.coordinator.failure_detector import FailureDetector
from encircle.world.coordinator.round_engine import RoundEngine
from encircle.world.process.core_access import CoreAccess
from encircle.world.process.departure_reports import DepartureReports
from encircle.world.process.pace import Pace
from encircle.world.process.progress import (
    RESEND_PERIOD_S,
    LockStepWatch,
    NewTick,
    Overdue,
    RealTimeWatch,
    StillWaiting,
)
from encircle.world.process.reports import Reporter

WATCH_PERIOD_S = 0.1
ANSWERS_PAUSE_S = 0.5
"""Nobody is asked again before no answer has come for so long."""


class RunWatch:
    """The watch over the rounds of one run. ``watch`` decides what a look at it means.

    ``pace``: what holds ticks back, if anything does.
    """

    def __init__(
        self,
        rounds: RoundEngine,
        access: CoreAccess,
        failure_detector: FailureDetector,
        watch: LockStepWatch | RealTimeWatch,
        departures: DepartureReports,
        report: Reporter,
        pace: Pace | None = None,
    ) -> None:
        self._rounds = rounds
        self._access = access
        self._failure_detector = failure_detector
        self._watch = watch
        self._departures = departures
        self._report = report
        self._pace = pace
        self._waiting = 0
        self._answered_s = time.monotonic()

    def _answers_come(self, now_s: float) -> bool:
        """Whether answers have come a moment ago: who has many robots to answer for takes long."""
        waiting = len(self._rounds.table.waiting())
        if waiting != self._waiting:
            self._waiting, self._answered_s = waiting, now_s
        return now_s - self._answered_s < ANSWERS_PAUSE_S

    async def run(self) -> None:
        """Watch until cancelled."""
        reminded_s = time.monotonic()
        while True:
            now_s = time.monotonic()
            self._departures.update()
            if now_s - reminded_s > RESEND_PERIOD_S:
                reminded_s = now_s
                self._access.change(self._failure_detector.reminders)
            self._look(now_s)
            await asyncio.sleep(WATCH_PERIOD_S)

    def _look(self, now_s: float) -> None:
        tick, table = self._rounds.state.tick, self._rounds.table
        answers_come = self._answers_come(now_s)
        if self._pace is not None and self._pace.holds and self._watch.rest(tick, now_s):
            # Nobody is waited for: the answers are there, or on their way.
            self._report({"waiting": []})
            return
        match self._watch.look(tick, now_s):
            case NewTick():
                self._report_tick()
            case StillWaiting(answers, ask_again):
                self._report({"waiting": table.waiting() if answers else []})
                if ask_again and not answers_come:
                    self._access.change(self._rounds.unanswered)
            case Overdue(answer_s_max):
                detector = self._failure_detector
                self._access.change(partial(detector.answer_overdue, tick, answer_s_max))

    def _report_tick(self) -> None:
        state, team = self._rounds.state, len(self._rounds.arena.ids)
        self._report(
            {
                "tick": state.tick,
                "distances_m": state.geometry.distances[:team, team].tolist(),
                "lost": list(self._rounds.lost),
            }
        )
