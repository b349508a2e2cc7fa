"""Checks of a run's nodes: which are there, do versions agree, how far apart are clocks.

Nodes are found by their liveliness tokens, in the way that they find each other. Then each is asked
for its node information (``encircle.protocol.zenoh.node_info``), and its clock offset is measured
(``encircle.protocol.clocks``). A node may not answer, such as a robot that is not of this program.
Then one of its messages is received, because every message holds the protocol version.
"""

import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import msgpack

from encircle.check_results import CheckResult
from encircle.protocol import VERSION
from encircle.protocol.clocks import Exchange
from encircle.protocol.errors import ProtocolError
from encircle.protocol.keys import parse_key, robot_key, world_key
from encircle.protocol.zenoh.endpoints import ConnectionFailed, Endpoints
from encircle.protocol.zenoh.liveliness import alive_keys
from encircle.protocol.zenoh.node_info import ROUTER_KEY, NodeInfo, decode_info, versions_here
from encircle.protocol.zenoh.queries import first_messages, query
from encircle.protocol.zenoh.session import closing, has_neighbours, open_session

QUERIES_PER_NODE = 8
QUERY_S_MAX = 1.0
"""Time limit for repeated queries to one node: a slow node is busy with the run."""
LISTEN_S = 0.5
OFFSET_US_NOTE, OFFSET_US_WRONG = 10e3, 1e6
NAMES_SHOWN_MAX = 32
ANSWER_BYTES_MAX = 1024 * 1024


class _NodeReply(NamedTuple):
    """A node's information, and the clock exchange with the smallest error bound."""

    info: NodeInfo
    clock: Exchange


def check_nodes(
    endpoints: Endpoints, run: str | None, robot: str | None, s_max: float, asking_s_max: float
) -> list[CheckResult]:
    """Check the nodes that a session there sees, of one run or of all.

    ``s_max``: time limit for each answer. ``asking_s_max``: time limit for all of them.
    """
    try:
        session = open_session(endpoints)
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
                CheckResult(
                    "session", "wrong", f"{endpoints}: nobody is connected", "try once more"
                )
            ]
        results = [CheckResult("session", "ok", f"{endpoints} lets a session in")]
        keys = _alive_keys(session, run, robot, s_max)
        nodes_by_run = _nodes_by_run(keys)
        results += _check_presence(nodes_by_run, run, robot, endpoints.identity is not None)
        results += _query_nodes(session, nodes_by_run, s_max, deadline_s)
    return results


def _alive_keys(session: Any, run: str | None, robot: str | None, s_max: float) -> set[str]:
    name = run or "*"
    keys = [world_key(name, "alive"), robot_key(name, "*", "alive")]
    if robot is not None:
        # With a robot's certificate its own token is visible only to a query for that key.
        keys.append(robot_key(name, robot, "alive"))
    return {token for key in keys for token in alive_keys(session, key, s_max)}


def _nodes_by_run(keys: Iterable[str]) -> dict[str, list[str]]:
    """The nodes of each run, as ``world`` and the robots' ids, in robot order."""
    nodes_by_run: dict[str, list[str]] = {}
    for key in keys:
        with suppress(ProtocolError):
            parsed = parse_key(key)
            nodes_by_run.setdefault(parsed.run, []).append(parsed.robot or "world")
    return {run: sorted(nodes_by_run[run], key=_node_order) for run in sorted(nodes_by_run)}


def _node_order(node: str) -> tuple[int, int, str]:
    number = node[1:]
    is_numbered = node.startswith("r") and number.isdigit()
    return node != "world", int(number) if is_numbered else len(node), node


def _check_presence(
    nodes_by_run: Mapping[str, list[str]], run: str | None, robot: str | None, certified: bool
) -> list[CheckResult]:
    """Which nodes are there and which are missing."""
    if run is None:
        if not nodes_by_run:
            return [CheckResult("run", "note", "no run is under way there", "start its world")]
        return [
            CheckResult("run", "ok", f"run {name}: {_names_text(nodes)}")
            for name, nodes in list(nodes_by_run.items())[:NAMES_SHOWN_MAX]
        ]
    nodes = nodes_by_run.get(run, [])
    results = [CheckResult("run", "ok", f"run {run}: {_names_text(nodes)}")] if nodes else []
    if "world" not in nodes:
        advice = (
            f"start it with --run {run}, or wait until it has started; or compare the run's name"
            " and the endpoint with the world's"
        )
        results.append(CheckResult("run", "wrong", f"run {run} has no world there", advice))
    missing = _missing_robots(nodes, robot, certified)
    if missing:
        advice = f"is it started, with --run {run}, and can its host reach the same endpoint?"
        message = f"run {run} has no {', '.join(missing)} there"
        results.append(CheckResult("run", "wrong", message, advice))
    return results


def _missing_robots(nodes: list[str], robot: str | None, certified: bool) -> list[str]:
    """Robots that should be there: the given one, or those whose number others exceed."""
    if robot is not None:
        return [robot] if robot not in nodes else []
    if certified:
        return []  # with a robot's certificate no other robot is visible
    numbers = [int(node[1:]) for node in nodes if node[1:].isdigit()]
    return [f"r{k}" for k in range(1, max(numbers, default=0)) if f"r{k}" not in nodes]


def _names_text(nodes: list[str]) -> str:
    more = len(nodes) - NAMES_SHOWN_MAX
    return ", ".join(nodes[:NAMES_SHOWN_MAX]) + (f" and {more} more" if more > 0 else "")


def _query_nodes(
    session: Any, nodes_by_run: Mapping[str, list[str]], s_max: float, deadline_s: float
) -> list[CheckResult]:
    """Query router and nodes for versions and clocks."""
    results: list[CheckResult] = []
    keys = {"router": ROUTER_KEY}
    for run, nodes in nodes_by_run.items():
        for node in nodes:
            name = node if len(nodes_by_run) == 1 else f"{node} of run {run}"
            versions_of_us = node == "world"
            keys[name] = (
                world_key(run, "about") if versions_of_us else robot_key(run, node, "about")
            )
    silent = []
    for name, key in keys.items():
        if time.monotonic() > deadline_s:
            message = f"time is up: {name} and those after it were not asked"
            return [*results, CheckResult("versions", "note", message, "ask for one --run alone")]
        try:
            node_reply = _query_node(session, key, s_max)
        except ProtocolError as error:
            message = f"{name} answers something else: {error}"
            results.append(CheckResult("versions", "note", message, "is it of the same Encircle?"))
            continue
        if node_reply is None:
            silent.append(name)
        else:
            results += [_check_version(name, node_reply.info), _check_clock(name, node_reply.clock)]
    return [
        *results,
        *_versions_overheard(session, nodes_by_run, [name for name in silent if name != "router"]),
    ]


def _query_node(session: Any, key: str, s_max: float) -> _NodeReply | None:
    """Query a node several times within a time limit; None if it does not answer."""
    best: _NodeReply | None = None
    deadline_s = time.monotonic() + QUERY_S_MAX
    for _ in range(QUERIES_PER_NODE):
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


def _check_version(name: str, info: NodeInfo) -> CheckResult:
    versions_of_us = versions_here()
    theirs = ", ".join(f"{what} {version}" for what, version in info.versions.items())
    if info.wire != VERSION:
        message = f"{name} speaks version {info.wire} of the wire, this is {VERSION} ({theirs})"
        return CheckResult("versions", "wrong", message, "install the same Encircle on every host")
    if info.versions.get("encircle") != versions_of_us["encircle"]:
        message = f"{name} has {theirs}; here it is encircle {versions_of_us['encircle']}"
        advice = "it should work, but results are only the same with one version on every host"
        return CheckResult("versions", "note", message, advice)
    return CheckResult("versions", "ok", f"{name}: wire version {info.wire}, {theirs}")


def _check_clock(name: str, clock: Exchange) -> CheckResult:
    offset_us, error_us = clock.offset_us, clock.error_us
    certain_us = abs(offset_us) - error_us
    ahead = "ahead of" if offset_us >= 0 else "behind"
    message = (
        f"{name}'s is {abs(offset_us) / 1e6:.6f} s {ahead} this one, within {error_us / 1e6:.6f} s"
    )
    if certain_us <= OFFSET_US_NOTE:
        return CheckResult("clock", "ok", message)
    advice = (
        "run a time service, chrony for instance, on both hosts and let it settle (`chronyc"
        ' tracking`); one-way delays of radio = "direct" and certificates need it, lock-step'
        " does not"
    )
    return CheckResult(
        "clock", "wrong" if certain_us > OFFSET_US_WRONG else "note", message, advice
    )


def _versions_overheard(
    session: Any, nodes_by_run: Mapping[str, list[str]], silent: list[str]
) -> list[CheckResult]:
    """Protocol versions of nodes that do not answer queries, from messages that they publish."""
    if not silent:
        return []
    results: list[CheckResult] = []
    payloads = {
        key: payload
        for run in nodes_by_run
        for channel in (world_key(run, "state"), robot_key(run, "*", "command"))
        for key, payload in first_messages(session, channel, LISTEN_S).items()
    }
    versions = {}
    for key, payload in payloads.items():
        with suppress(Exception):  # a stranger may have sent anything
            body = msgpack.unpackb(payload[:ANSWER_BYTES_MAX])
            versions[parse_key(key).robot or "world"] = body["v"]
    for name in silent:
        wire_version = versions.get(name.partition(" ")[0])
        if type(wire_version) is int and wire_version != VERSION:
            message = f"{name} speaks version {wire_version} of the wire, this is {VERSION}"
            results.append(
                CheckResult("versions", "wrong", message, "install the same Encircle on every host")
            )
        elif wire_version == VERSION:
            message = f"{name} speaks version {VERSION} of the wire and says no more of itself"
            results.append(CheckResult("versions", "ok", message))
        else:
            message = (
                f"{name} says nothing of itself: frozen, of other make, or of an older version"
            )
            results.append(
                CheckResult("versions", "note", message, "see there which of these it is")
            )
    return results
