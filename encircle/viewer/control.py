"""What a page may change in a run: the radio in the hand of whoever started it. Sans I/O.

A page with the token sends events, which become interventions of the run; the run says of each what
became of it, and all pages with the token are told. Any other page is refused. What the messages
hold is in ``page/control.js``.
"""

from collections.abc import Callable
from typing import Any

from encircle.runner.interventions import Interventions
from encircle.world.channel.changes import in_force
from encircle.world.loading.interventions import InterventionRefused, event_of
from encircle.world.scenario.channel_model import ChannelModel
from encircle.world.scenario.delay_models import ConstantDelay
from encircle.world.scenario.loss_models import BernoulliLoss, DistanceLoss, NoLoss, RangeLoss
from encircle.world.scenario.model import Scenario

NOT_ALLOWED = "only the page of who started the run may change it"
NOT_UNDERSTOOD = 'not understood: send {"intervene": EVENT} or {"radio": true}'
OVER = "intervention: the run is over"

Answer = dict[str, Any]


class Control:
    """The control of one run. ``tell``: sends an object to all pages with the token.

    ``on_message`` is for the page's server, in whatever thread; ``on_report`` gets the reports of
    the run (``encircle.run``'s ``progress``).
    """

    def __init__(self, scenario: Scenario, interventions: Interventions) -> None:
        self.tell: Callable[[Answer], object] = lambda _answer: None
        self._scenario = scenario
        self._interventions = interventions
        self._tick = 0
        self._over = False

    def on_message(self, has_token: bool, said: dict[str, Any]) -> Answer | None:
        """Take in what a page has sent; the answer to that page, if there is one at once."""
        if not has_token:
            return _refused(NOT_ALLOWED)
        if "radio" in said:
            return {"control": {"radio": self.radio()}}
        if "intervene" not in said:
            return _refused(NOT_UNDERSTOOD)
        if self._over:
            return _refused(OVER)
        try:
            self._interventions.give(said["intervene"])
        except InterventionRefused as refused:
            return _refused(str(refused))
        return None

    def on_report(self, report: dict[str, Any]) -> None:
        """Take in a report of the run, and tell pages what became of their events."""
        self._tick = report.get("tick", self._tick)
        if "refused_intervention" in report:
            self.tell(_refused(report["refused_intervention"]))
        elif "intervention" in report:
            taken = report["intervention"]
            self._tick = taken["given"]
            event = event_of(taken["event"], self._scenario, self._tick)
            self._scenario = self._scenario.with_event(event)
            self.tell({"control": {"taken": taken}})

    def end(self) -> None:
        """The run is over: nothing can be given any more, and what still waits was not taken."""
        self._over = True
        for _ in self._interventions.take():
            self.tell(_refused(OVER))

    def radio(self) -> Answer:
        """What is in force from the next tick on: the scenario's own numbers, and those by events.

        None where the scenario's radio has no such number, and where its own are in force.
        """
        rate, delay_s, range_m = in_force(self._scenario.events, self._tick + 1)
        return {
            "own": own_numbers(self._scenario.channel),
            "now": {"rate": rate, "delay_s": delay_s, "range_m": range_m},
            "tick_s": self._scenario.tick_s,
        }


def own_numbers(channel: ChannelModel) -> dict[str, float | None]:
    """The rate of loss, delay in s and range in m of a channel that has such a number."""
    loss, delay = channel.loss, channel.delay
    rate = loss.rate if isinstance(loss, BernoulliLoss) else 0.0 if type(loss) is NoLoss else None
    return {
        "rate": rate,
        "delay_s": delay.mean_s if isinstance(delay, ConstantDelay) else None,
        "range_m": loss.cutoff_m if isinstance(loss, RangeLoss | DistanceLoss) else None,
    }


def _refused(why: str) -> Answer:
    return {"control": {"refused": why}}
