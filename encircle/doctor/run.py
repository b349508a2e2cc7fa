"""Who of a run is there, whether all speak one version, and how far apart the clocks are.

Parties are found by their liveliness tokens, as they find each other, and then asked what they are
(``encircle.protocol.zenoh.node_info``) and what their clocks show (``encircle.protocol.clocks``).
What answers nothing of that sort, such as a robot of other make, is listened to for a moment,
because every message says of which version of the wire it is.
"""

import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import msgpack

from encircle.doctor.machine import CheckResult
from encircle.protocol import VERSION
from encircle.protocol.clocks import Exchange
from encircle.protocol.errors import ProtocolError
from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.zenoh.endpoints import ConnectionFailed, Endpoints
from encircle.protocol.zenoh.liveliness import alive_keys
from encircle.protocol.zenoh.node_info import ROUTER_KEY, NodeInfo, decode_info, versions_here
from encircle.protocol.zenoh.queries import first_messages, query
from encircle.protocol.zenoh.session import closing, has_neighbours, open_session

ASKED_TIMES = 8
ASKED_S_MAX = 1.0
"""A party that is slow to answer is not asked again and again: it has something else to do."""
LISTENING_S = 0.5
OFFSET_US_NOTED, OFFSET_US_WRONG = 10e3, 1e6
SHOWN_MAX = 32
ANSWER_BYTES_MAX = 1024 * 1024


class _NodeReply(NamedTuple):
    """What a party said of itself, if it did, and the exchange that tells most of its clock."""

    info: NodeInfo
    clock: Exchange


def nodes(
    where: Endpoints, run: str | None, robot: str | None, s_max: float, asking_s_max: float
) -> list[CheckResult]:
    """Who can be seen from a session there, of a run or of all runs, and what they say.

    ``s_max``: for each answer; ``asking_s_max``: for all of them.
    """
    try:
        session = open_session(where)
    except ConnectionFailed as error:
        advice = (
            "something answers there, but lets no Zenoh session in: see that it is a router or a"
            " world, whether both or neither use certificates (tls/ or tcp/), that these are of one"
            " making and not expired, and what the other end says of it"
        )
        return [CheckResult("session", "wrong", str(error), advice)]
    deadline_s = time.monotonic() + asking_s_max
    with closing(session):
        if not has_neighbours(session):
            return [
                CheckResult("session", "wrong", f"{where}: nobody is connected", "try once more")
            ]
        found = [CheckResult("session", "ok", f"{where} lets a session in")]
        keys = _tokens(session, run, robot, s_max)
        there = _by_run(keys)
        found += _presence(there, run, robot, where.identity is not None)
        found += _query_nodes(session, there, s_max, deadline_s)
    return found


def _tokens(session: Any, run: str | None, robot: str | None, s_max: float) -> set[str]:
    name = run or "*"
    keys = [world_key(name, "alive"), robot_key(name, "*", "alive")]
    if robot is not None:
        # A robot's certificate shows its own token to a question for that alone.
        keys.append(robot_key(name, robot, "alive"))
    return {found for key in keys for found in alive_keys(session, key, s_max)}


def _by_run(keys: Iterable[str]) -> dict[str, list[str]]:
    """The parties of each run, as ``world`` and the robots' ids, in robot order."""
    found: dict[str, list[str]] = {}
    for key in keys:
        with suppress(ProtocolError):
            parsed = parse_key(key)
            found.setdefault(parsed.run, []).append(parsed.robot or "world")
    return {run: sorted(found[run], key=_node_order) for run in sorted(found)}


def _node_order(node: str) -> tuple[int, int, str]:
    number = node[1:]
    is_numbered = node.startswith("r") and number.isdigit()
    return node != "world", int(number) if is_numbered else len(node), node


def _presence(
    there: Mapping[str, list[str]], run: str | None, robot: str | None, certified: bool
) -> list[CheckResult]:
    """Who is there and who is not."""
    if run is None:
        if not there:
            return [CheckResult("run", "note", "no run is under way there", "start its world")]
        return [
            CheckResult("run", "ok", f"run {name}: {_listed(who)}")
            for name, who in list(there.items())[:SHOWN_MAX]
        ]
    who = there.get(run, [])
    found = [CheckResult("run", "ok", f"run {run}: {_listed(who)}")] if who else []
    if "world" not in who:
        advice = (
            f"start it with --run {run}, or wait until it has started; or compare the run's name"
            " and the endpoint with the world's"
        )
        found.append(CheckResult("run", "wrong", f"run {run} has no world there", advice))
    missing = _missing(who, robot, certified)
    if missing:
        advice = f"is it started, with --run {run}, and can its host reach the same endpoint?"
        message = f"run {run} has no {', '.join(missing)} there"
        found.append(CheckResult("run", "wrong", message, advice))
    return found


def _missing(who: list[str], robot: str | None, certified: bool) -> list[str]:
    """Robots that should be there: the one asked for, and those between others."""
    if robot is not None:
        return [robot] if robot not in who else []
    if certified:
        return []  # a robot's certificate shows it no other robot
    numbers = [int(node[1:]) for node in who if node[1:].isdigit()]
    return [f"r{k}" for k in range(1, max(numbers, default=0)) if f"r{k}" not in who]


def _listed(who: list[str]) -> str:
    more = len(who) - SHOWN_MAX
    return ", ".join(who[:SHOWN_MAX]) + (f" and {more} more" if more > 0 else "")


def _query_nodes(
    session: Any, there: Mapping[str, list[str]], s_max: float, deadline_s: float
) -> list[CheckResult]:
    """What router and parties say of versions and clocks."""
    found: list[CheckResult] = []
    keys = {"router": ROUTER_KEY}
    for run, who in there.items():
        for node in who:
            name = node if len(there) == 1 else f"{node} of run {run}"
            own = node == "world"
            keys[name] = world_key(run, "about") if own else robot_key(run, node, "about")
    silent = []
    for name, key in keys.items():
        if time.monotonic() > deadline_s:
            message = f"time is up: {name} and those after it were not asked"
            return [*found, CheckResult("versions", "note", message, "ask for one --run alone")]
        try:
            node_reply = _query_node(session, key, s_max)
        except ProtocolError as error:
            message = f"{name} answers something else: {error}"
            found.append(CheckResult("versions", "note", message, "is it of the same Encircle?"))
            continue
        if node_reply is None:
            silent.append(name)
        else:
            found += [_version(name, node_reply.info), _clock(name, node_reply.clock)]
    return [
        *found,
        *_versions_overheard(session, there, [name for name in silent if name != "router"]),
    ]


def _query_node(session: Any, key: str, s_max: float) -> _NodeReply | None:
    """Ask a party some times over, for a bounded time; None if it does not answer."""
    best: _NodeReply | None = None
    deadline_s = time.monotonic() + ASKED_S_MAX
    for _ in range(ASKED_TIMES):
        if best is not None and time.monotonic() > deadline_s:
            break
        answer = query(session, key, s_max)
        if answer is None:
            break
        info = decode_info(answer.payload)
        times = (answer.asked_us, info.received_us, info.sent_us, answer.arrival_us)
        clock = Exchange(*times)
        if best is None or clock.error_us < best.clock.error_us:
            best = _NodeReply(info, clock)
    return best


def _version(name: str, info: NodeInfo) -> CheckResult:
    own = versions_here()
    theirs = ", ".join(f"{what} {version}" for what, version in info.versions.items())
    if info.wire != VERSION:
        message = f"{name} speaks version {info.wire} of the wire, this is {VERSION} ({theirs})"
        return CheckResult("versions", "wrong", message, "install the same Encircle on every host")
    if info.versions.get("encircle") != own["encircle"]:
        message = f"{name} has {theirs}; here it is encircle {own['encircle']}"
        advice = "it should work, but results are only the same with one version on every host"
        return CheckResult("versions", "note", message, advice)
    return CheckResult("versions", "ok", f"{name}: wire version {info.wire}, {theirs}")


def _clock(name: str, clock: Exchange) -> CheckResult:
    off_us, error_us = clock.offset_us, clock.error_us
    sure_us = abs(off_us) - error_us
    ahead = "ahead of" if off_us >= 0 else "behind"
    message = (
        f"{name}'s is {abs(off_us) / 1e6:.6f} s {ahead} this one, within {error_us / 1e6:.6f} s"
    )
    if sure_us <= OFFSET_US_NOTED:
        return CheckResult("clock", "ok", message)
    advice = (
        "run a time service, chrony for instance, on both hosts and let it settle (`chronyc"
        ' tracking`); one-way delays of radio = "direct" and certificates need it, lock-step'
        " does not"
    )
    return CheckResult("clock", "wrong" if sure_us > OFFSET_US_WRONG else "note", message, advice)


def _versions_overheard(
    session: Any, there: Mapping[str, list[str]], silent: list[str]
) -> list[CheckResult]:
    """The wire's version of those that say nothing of themselves, from what else they say."""
    if not silent:
        return []
    found: list[CheckResult] = []
    heard = {
        key: payload
        for run in there
        for channel in (world_key(run, "state"), robot_key(run, "*", "command"))
        for key, payload in first_messages(session, channel, LISTENING_S).items()
    }
    versions = {}
    for key, payload in heard.items():
        with suppress(Exception):  # whatever a stranger has sent
            body = msgpack.unpackb(payload[:ANSWER_BYTES_MAX])
            versions[parse_key(key).robot or "world"] = body["v"]
    for name in silent:
        spoken = versions.get(name.partition(" ")[0])
        if type(spoken) is int and spoken != VERSION:
            message = f"{name} speaks version {spoken} of the wire, this is {VERSION}"
            found.append(
                CheckResult("versions", "wrong", message, "install the same Encircle on every host")
            )
        elif spoken == VERSION:
            message = f"{name} speaks version {VERSION} of the wire and says no more of itself"
            found.append(CheckResult("versions", "ok", message))
        else:
            message = (
                f"{name} says nothing of itself: frozen, of other make, or of an older version"
            )
            found.append(CheckResult("versions", "note", message, "see there which of these it is"))
    return found
