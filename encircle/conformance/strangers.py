"""Views as a mixed team, a bad radio and a stranger's robot make them, for a policy to survive.

In a mixed team a peer's packet holds what another policy says, under other names or under the same
names with other values; a peer may have said nothing yet, or only have been seen. Such views are
made of real ones. The real ones come before and after, so that what a policy has remembered of a
stranger shows as well.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from encircle.agents.policies.decision_check import validated
from encircle.agents.policies.interface import View
from encircle.check_results import CheckResult
from encircle.conformance.purity import Parts
from encircle.conformance.scenes import Participation
from encircle.conformance.subject import Subject
from encircle.protocol.messages import Pose
from encircle.protocol.plugins import InvalidPluginResult, error_line
from encircle.protocol.wire.payload import payload

SCENES = ("plain", "bad radio")
BEFORE, ALTERED, AFTER = 8, 16, 6
STRANGER = "r999"
OTHER_VALUES: tuple[Any, ...] = ("?", None, True, -1, 1_000_000, 0.5, (), {})
FOREIGN = {"greeting": "hello", "plan": [1, {"left": None}], "weights": b"\x00\x01"}
LONGER, SHORTER = 2, 0
SAY_ADVICE = (
    "a mixed team has peers with other policies: take what is said by .get(), check what it is"
    " before it is used, and expect any mode, xi and point"
)
PEERS_ADVICE = "there may be no peers, and peer.packet is None of one that was only seen"
Alter = Callable[[View], View]


def check_strangers(subject: Subject, parts: Parts) -> list[CheckResult]:
    """One result for each way in which views are altered that it does not survive."""
    chosen = [part for part in parts if part.scene in SCENES][:: len(SCENES) + 1]
    keys = sorted({key for part in parts for d in part.decisions for key in d.say or ()})
    ways = list(alterations(keys))
    results: list[CheckResult] = []
    for said, advice, alter in ways:
        if any(result.advice == advice for result in results):
            continue
        for part in chosen:
            if problem := problem_with(subject, part, alter):
                results.append(CheckResult("strangers", "wrong", f"{said}, {problem}", advice))
                break
    if results:
        return results
    return [
        CheckResult("strangers", "ok", f"{len(ways)} kinds of other packets and peers survived")
    ]


def problem_with(subject: Subject, part: Participation, alter: Alter) -> str:
    """How a policy fails on altered views among real ones; empty if it does not."""
    memory: Any = None
    first, last = BEFORE, BEFORE + ALTERED
    for k, view in enumerate(part.views[: last + AFTER]):
        try:
            memory, _ = validated(subject.ask(memory, alter(view) if first <= k < last else view))
        except InvalidPluginResult as error:
            return f"its answer is {error}"
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            later = " a little later" if k >= last else ""
            return f"it raises{later} {error_line(error)}{subject.place_in(error)}"
    return ""


def alterations(keys: list[str]) -> Iterator[tuple[str, str, Alter]]:
    """How views are altered: in words, advice, and the function.

    ``keys``: under which the policy itself says something.
    """
    yield "where nobody else is", PEERS_ADVICE, _alone
    yield "where peers are only seen", PEERS_ADVICE, lambda v: _with_packets(v, lambda _: None)
    yield "where a peer that it does not plan with is heard", PEERS_ADVICE, _unplanned
    yield "where packets come twice", PEERS_ADVICE, _twice
    yield "where peers say nothing", SAY_ADVICE, _saying(lambda _: {})
    yield "where peers say something else", SAY_ADVICE, _saying(lambda _: FOREIGN)
    for key in keys:
        yield f"where peers say no {key!r}", SAY_ADVICE, _saying(partial(_without, key))
    for value in OTHER_VALUES if keys else ():
        said = f"where peers say {value!r} under its names"
        yield said, SAY_ADVICE, _saying(partial(_all_as, value))
        said = f"where peers say {value!r} for each value"
        yield said, SAY_ADVICE, _saying(partial(_leaves_as, value))
    if keys:
        yield "where peers say longer lists", SAY_ADVICE, _saying(partial(_lists, times=LONGER))
        yield "where peers say empty lists", SAY_ADVICE, _saying(partial(_lists, times=SHORTER))
        yield "where peers name robots that are not there", SAY_ADVICE, _saying(_renamed)


def _alone(view: View) -> View:
    nobody = tuple([None] * len(view.team))
    return _unplanned(view)._replace(heard=(), seen=(), packets=nobody)


def _unplanned(view: View) -> View:
    """Alone among those that are planned with."""
    own = view.own
    return view._replace(own=0, members=(view.members[own],), positions=(view.positions[own],))


def _twice(view: View) -> View:
    return view._replace(heard=tuple([packet for p in view.heard for packet in (p, p)]))


def _with_packets(view: View, change: Callable[[Pose], Pose | None]) -> View:
    heard = [change(packet) for packet in view.heard]
    packets = tuple([None if p is None else change(p) for p in view.packets])
    return view._replace(heard=tuple([p for p in heard if p is not None]), packets=packets)


def _saying(change: Callable[[Any], Any]) -> Alter:
    """Peers that say something else, and whose intents are those of another policy."""

    def altered(packet: Pose) -> Pose:
        said = payload(change(packet.say))
        return replace(packet, say=said, mode="elsewhere", xi=None, point=None)

    return lambda view: _with_packets(view, altered)


def _without(key: str, said: Any) -> Any:
    return {name: value for name, value in said.items() if name != key}


def _all_as(other: Any, said: Any) -> Any:
    return dict.fromkeys(said, other)


def _leaves_as(other: Any, value: Any) -> Any:
    """A value with each of its plain parts another one."""
    if isinstance(value, dict):
        return {name: _leaves_as(other, part) for name, part in value.items()}
    if isinstance(value, tuple | list):
        return [_leaves_as(other, part) for part in value]
    return other


def _lists(value: Any, times: int) -> Any:
    if isinstance(value, dict):
        return {name: _lists(part, times) for name, part in value.items()}
    return list(value) * times if isinstance(value, tuple | list) else value


def _renamed(value: Any) -> Any:
    """What is said with each robot's id another, as text or as name of a map's part."""
    if isinstance(value, dict):
        return {_name(name): _renamed(part) for name, part in value.items()}
    if isinstance(value, tuple | list):
        return [_renamed(part) for part in value]
    return _name(value) if isinstance(value, str) else value


def _name(text: str) -> str:
    return STRANGER if text[:1] == "r" and text[1:].isdigit() else text
