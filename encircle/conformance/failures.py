"""Why a policy could not answer: the usual mistakes, and what to do about each."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from encircle.agents.estimation.kalman import Estimate
from encircle.agents.policies.interface import Decision, View
from encircle.check_results import CheckResult
from encircle.conformance.purity import PURE_ADVICE, Parts
from encircle.conformance.scenes import ANSWER_S_MAX, Failure, Recorded, TooSlow
from encircle.conformance.subject import Subject
from encircle.protocol.plugins import InvalidPluginResult, error_line
from encircle.world.targets.behaviours import TargetView

DISTANCE_M, COVARIANCE = 3.0, (1e-4, 0.0, 1.0)
SEARCH_ADVICE = (
    "view.target is None until somebody has detected it: begin with"
    " `if view.target is None: return memory, view.search`"
)
MEMORY_ADVICE = "memory is None at first: begin with `memory = memory or {...}`"
PEERS_ADVICE = "view.peers may be empty, and peer.packet is None of a peer that was only seen"
FROZEN = ("can't set attribute", "cannot assign to field", "cannot be changed", "has no setter")
"""What Python, and what peers have said, answer to who would change them."""
FROZEN_ADVICE = "what it is given cannot be changed: make new values, and return them as memory"
OF_TARGETS = frozenset(TargetView._fields).difference(View._fields)
TARGET_ADVICE = (
    "this looks like a target behaviour: {} is of encircle.TargetView; this command checks policies"
    " alone, a behaviour is named by target.behaviour"
)
PAIR_ADVICE = "return a pair at every return: memory, Decision(mode, step, goal)"


def guarded(
    name: str,
    subject: Subject,
    check: Callable[[Subject, Parts], CheckResult],
    parts: Parts,
) -> list[CheckResult]:
    """The result of a check in which a policy may raise although it did not in the hunt."""
    try:
        return [check(subject, parts)]
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        place = subject.place_in(error)
        if not place and not isinstance(error, InvalidPluginResult):
            raise
        what = "answers" if isinstance(error, InvalidPluginResult) else "raises"
        reason = error if what == "answers" else error_line(error)
        said = f"asked again, it {what} {reason}{place}"
        return [CheckResult(name, "wrong", said, PURE_ADVICE)]


def check_decisions(subject: Subject, recorded: Recorded) -> list[CheckResult]:
    """Has it answered in every scene, and without a target too? One result for each mistake."""
    count = sum(len(part.views) for part in recorded.participations)
    if not recorded.failures:
        blind = sum(v.target is None for p in recorded.participations for v in p.views)
        return [
            CheckResult("decisions", "ok", f"{count} in {_scenes(recorded)} scenes, all valid"),
            CheckResult("no target", "ok", f"{blind} of them without an estimate of the target"),
        ]
    return list(_explained(subject, recorded))


def _scenes(recorded: Recorded) -> int:
    return len({part.scene for part in recorded.participations})


def _explained(subject: Subject, recorded: Recorded) -> Iterator[CheckResult]:
    told = set()
    for failure in recorded.failures:
        said, advice = explanation(subject, failure)
        if (key := (said, advice)) in told:
            continue
        told.add(key)
        check = "no target" if advice == SEARCH_ADVICE else "decisions"
        where = f"{failure.robot} at tick {failure.view.tick} ({failure.scene})"
        yield CheckResult(check, "wrong", f"{where}: {said}", advice)


def explanation(subject: Subject, failure: Failure) -> tuple[str, str]:
    """What went wrong, and what to do."""
    error, view = failure.error, failure.view
    place = subject.place_in(error)
    if isinstance(error, TooSlow):
        return f"no answer after {ANSWER_S_MAX:g} s{place}", "give every loop a limit"
    if isinstance(error, InvalidPluginResult):
        return f"it answers {error}", _advice_on_answer(subject, failure)
    said = f"it raises {error_line(error)}{place}"
    if isinstance(error, TypeError) and "argument" in str(error) and not place:
        return said, "its own parameters need defaults, or are set by --set NAME=VALUE"
    if any(text in str(error) for text in FROZEN):
        return said, FROZEN_ADVICE
    if isinstance(error, AttributeError) and error.name in OF_TARGETS and error.obj is view:
        return said, TARGET_ADVICE.format(error.name)
    if view.target is None and _answers(subject, failure.memory, with_target(view)):
        return said, SEARCH_ADVICE
    if failure.memory is None and "NoneType" in str(error):
        return said, MEMORY_ADVICE
    if not view.peers or any(peer.packet is None for peer in view.peers):
        return said, PEERS_ADVICE
    return said, "encircle.View says what each field is, and when it is None"


def with_target(view: View) -> View:
    """A view as if a target that stands still had just been detected."""
    x, y = view.position
    estimate = Estimate(x + DISTANCE_M, y, 0.0, 0.0, COVARIANCE)

    def predict(xi_grid: tuple[float, ...]) -> tuple[NDArray[np.float64], str]:
        return np.array([estimate.position] * len(xi_grid)), "hold"

    return view._replace(target=estimate, target_age_ticks=0, predict=predict, search=None)


def _answers(subject: Subject, memory: Any, view: View) -> bool:
    try:
        subject.ask(memory, view)
    except KeyboardInterrupt:
        raise
    except BaseException:
        return False
    return True


def _advice_on_answer(subject: Subject, failure: Failure) -> str:
    try:
        answer = subject.ask(failure.memory, failure.view)
    except KeyboardInterrupt:
        raise
    except BaseException:
        return PAIR_ADVICE
    if isinstance(answer, Decision):
        return f"it answers a Decision alone: {PAIR_ADVICE}"
    if answer is None:
        return f"some way through it ends without a return: {PAIR_ADVICE}"
    if type(answer) is tuple and len(answer) == 2 and isinstance(answer[0], Decision):
        return f"memory comes first: {PAIR_ADVICE}"
    if type(answer) is not tuple or len(answer) != 2 or not isinstance(answer[1], Decision):
        return PAIR_ADVICE
    if "bytes as msgpack" in str(failure.error):
        return "say less: what changed, or of a few robots only"
    if "say" in str(failure.error):
        return "say plain values under texts; arrays as lists, objects as their numbers"
    return "step and goal are (x, y) in m; a division by a distance of 0 makes NaN"
