"""Who belongs: the settings, and with real sessions, that they have the effect they should.

The oracle of who may say and hear what is the table of keys in ``docs/protocol.md``, written out
here once more. Hunts with intruders are in ``test_intruders``.
"""

import itertools
import json
import time
from contextlib import ExitStack
from datetime import timedelta

import pytest
import zenoh
from helpers_security import REFUSED_S_MAX, ROBOTS, Lab, free_endpoint
from helpers_waiting import LONGEST_S, ample_s, until

from encircle.protocol.keys import ROBOT_CHANNELS, WORLD_CHANNELS, robot_key, world_key
from encircle.protocol.zenoh.access_control import (
    TEAM,
    check_encrypted,
    configuration_file,
    gate,
    identity_in,
    settings,
    tls,
)
from encircle.protocol.zenoh.endpoints import ConfigurationError, ConnectionFailed, Endpoints
from encircle.protocol.zenoh.liveliness import is_alive
from encircle.protocol.zenoh.node_info import ROUTER_KEY
from encircle.protocol.zenoh.queries import query, serve_queries
from encircle.protocol.zenoh.session import open_session

RUN = "m"
SAID_BY_ROBOTS, SAID_TO_ROBOTS = ("pose", "command"), ("setup", "observation", "end")
SHOWN = ("state", "radio", "intervention")
NODE_KINDS = ("world", "r1", "r2", "viewer")
LATER_S = 0.3
"""How long what should not arrive is given to arrive."""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return Lab(tmp_path_factory.mktemp("security"))


@pytest.fixture
def closing():
    with ExitStack() as stack:
        yield stack


def opened(config, closing, connect_s_max=LONGEST_S):
    session = open_session(Endpoints(config=config, connect_s_max=connect_s_max))
    closing.callback(session.close)
    return session


class NodeProcess:
    """A session that subscribes to what is its own, and to everything."""

    def __init__(self, name, session):
        self.name, self.session = name, session
        self.heard, self.seen = set(), []
        shown = [world_key(RUN, channel) for channel in SHOWN]
        everybody = robot_key(RUN, "*", "*")
        own = {"world": [everybody], "viewer": [everybody, *shown]}
        takes = own.get(name, [robot_key(RUN, name, "*")])
        watched = [world_key(RUN, "alive"), robot_key(RUN, "*", "alive"), "encircle/**"]
        hears = zenoh.handlers.Callback(self._hear, indirect=False)
        sees = zenoh.handlers.Callback(self._see, indirect=False)
        remote = zenoh.Locality.REMOTE
        self.kept = [
            session.declare_subscriber(expression, hears, allowed_origin=remote)
            for expression in (*takes, "encircle/**", "**")
        ]
        self.kept += [
            session.liveliness().declare_subscriber(expression, sees, history=True)
            for expression in watched
        ]

    def _hear(self, sample):
        what = sample.payload.to_string() if sample.kind == zenoh.SampleKind.PUT else "deleted"
        self.heard.add((str(sample.key_expr), what))

    def _see(self, sample):
        self.seen.append((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

    def declare(self, key):
        self.kept.append(self.session.liveliness().declare_token(key))
        return self.kept[-1]


def meet(lab, closing, form, endpoint, **modes):
    """All nodes, connected to a gate: a router or the world, or r2 to a router further on."""
    sessions, places = {}, dict.fromkeys(NODE_KINDS, endpoint)
    name, mode = ("world", "peer") if form == "direct" else ("router", "router")
    sessions[name] = opened(lab.listening(name, endpoint, mode), closing)
    if form == "chain":
        places["r2"] = free_endpoint("tls")
        further = lab.listening("router", places["r2"], "router", connect=[endpoint])
        sessions["further"] = opened(further, closing)
    for node in NODE_KINDS:
        if node not in sessions:
            config = lab.connecting(node, places[node], modes.get(node, "client"))
            sessions[node] = opened(config, closing)
    nodes = {node: NodeProcess(node, sessions[node]) for node in NODE_KINDS}
    sync(nodes, "hello")
    return nodes


def sync(nodes, word):
    """Until a word that may be said has come to all whom it is for."""

    def said(sender, key, receiver):
        def arrived():
            nodes[sender].session.put(key, word)
            return (key, word) in nodes[receiver].heard

        until(arrived, f"{word} from {sender} to {receiver}")

    for robot in ("r1", "r2"):
        said(robot, robot_key(RUN, robot, "pose"), "world")
        said("world", robot_key(RUN, robot, "observation"), robot)
    for channel in SHOWN:
        said("world", world_key(RUN, channel), "viewer")


def may_say(node, robot, channel):
    if node == "world":
        return channel in (SAID_TO_ROBOTS if robot else SHOWN)
    return robot == node and channel in SAID_BY_ROBOTS


def may_hear(node, robot, channel):
    if node == "world":
        return robot is not None and channel in SAID_BY_ROBOTS
    if node == "viewer":
        return channel in ((*SAID_BY_ROBOTS, *SAID_TO_ROBOTS) if robot else SHOWN)
    return robot == node and channel in SAID_TO_ROBOTS


@pytest.mark.parametrize(
    ("form", "protocol", "mode"),
    [
        ("router", "tls", "client"),
        ("direct", "tls", "client"),
        ("router", "quic", "client"),
        ("router", "tls", "peer"),
        ("router", "tls", "router"),
        ("chain", "tls", "client"),
    ],
)
def test_everybody_says_and_hears_what_the_table_of_keys_has_it_do_and_nothing_else(
    lab, closing, form, protocol, mode
):
    """Also when r2 makes itself more of a node than a client is."""
    nodes = meet(lab, closing, form, free_endpoint(protocol), r2=mode)
    places = [*itertools.product(("r1", "r2", "r3"), (*ROBOT_CHANNELS, "junk"))]
    places += [(None, channel) for channel in (*WORLD_CHANNELS, "junk")]
    expected = {node: set() for node in NODE_KINDS}
    for (robot, channel), sender in itertools.product(places, NODE_KINDS):
        key = robot_key(RUN, robot, channel) if robot else world_key(RUN, channel)
        nodes[sender].session.put(key, f"word of {sender}")
        nodes[sender].session.delete(key)
        is_gate = form == "direct" and sender == "world"
        for receiver in NODE_KINDS:
            says = is_gate or may_say(sender, robot, channel)
            if says and receiver != sender and may_hear(receiver, robot, channel):
                expected[receiver].add((key, f"word of {sender}"))
    for sender, key in itertools.product(
        NODE_KINDS, ("encircle/m/robots/*/pose", "encircle/**", "x")
    ):
        nodes[sender].session.put(key, "to whom it may concern")
    if form == "direct":
        # What the gate itself says nobody judges but by who hears it.
        expected["viewer"].add(("encircle/m/robots/*/pose", "to whom it may concern"))
    sync(nodes, "goodbye")
    time.sleep(LATER_S)
    for node in NODE_KINDS:
        words = {(k, w) for k, w in nodes[node].heard if w not in ("hello", "goodbye")}
        assert words == expected[node]


@pytest.mark.parametrize("form", ["router", "direct", "chain"])
def test_nobody_can_be_taken_for_alive_or_gone_by_the_hand_of_another(lab, closing, form):
    endpoint = free_endpoint("tls")
    nodes = meet(lab, closing, form, endpoint)
    alive = {name: robot_key(RUN, name, "alive") for name in ("r1", "r2", "r3")}
    alive["world"] = world_key(RUN, "alive")
    false = [nodes["r2"].declare(alive[name]) for name in ("r1", "r3", "world")]
    nodes["r1"].declare(alive["r1"])
    nodes["world"].declare(alive["world"])
    nodes["r2"].declare(alive["r2"])
    told = {"world": {"r1", "r2"}, "viewer": {"r1", "r2", "world"}, "r1": {"world"}}
    for node, names in told.items():
        wanted = {(alive[name], True) for name in names}
        until(lambda p=node, w=wanted: w <= set(nodes[p].seen), f"{node} to see {wanted}")
    for token in false:
        token.undeclare()
    time.sleep(LATER_S)
    for node, names in told.items():
        own = {alive[node]} if node != "viewer" else set()
        seen = {change for change in nodes[node].seen if change[0] not in own}
        assert seen == {(alive[name], True) for name in names}
    # Asked anew, as a health check does it.
    asking = opened(lab.connecting("r1", endpoint), closing)
    for name in ("world", "r1"):
        assert is_alive(asking, alive[name], LONGEST_S)
    assert not is_alive(asking, alive["r2"], LONGEST_S)


@pytest.mark.parametrize("form", ["router", "direct"])
def test_only_a_viewer_may_ask_the_world_for_the_scenario(lab, closing, form):
    nodes, key = meet(lab, closing, form, free_endpoint("tls")), world_key(RUN, "scenario")
    serving = serve_queries(nodes["world"].session, key, lambda: b"the scenario")
    false = serve_queries(nodes["r2"].session, key, lambda: b"another")
    until(lambda: query(nodes["viewer"].session, key, LONGEST_S) is not None, "an answer")
    assert query(nodes["viewer"].session, key, LONGEST_S).payload == b"the scenario"
    assert query(nodes["r1"].session, key, LATER_S) is None
    serving.undeclare()
    false.undeclare()


@pytest.mark.parametrize("form", ["router", "direct"])
def test_who_does_not_belong_gets_no_session(lab, closing, form):
    endpoint = free_endpoint("tls")
    name, mode = ("router", "router") if form == "router" else ("world", "peer")
    opened(lab.listening(name, endpoint, mode), closing)
    strangers = {
        "without a certificate": lab.connecting(None, endpoint),
        "of another lab": lab.connecting(lab.foreign("r1"), endpoint),
        "whose certificate has expired": lab.connecting(
            lab.dated("r1", timedelta(days=-3), timedelta(days=-1)), endpoint
        ),
        "without TLS": lab.connecting(None, endpoint.replace("tls", "tcp")),
    }
    for who, config in strangers.items():
        print(f"a stranger {who}")
        with pytest.raises(ConnectionFailed, match="cannot connect"):
            opened(config, closing, REFUSED_S_MAX)
    opened(lab.connecting("r1", endpoint), closing)


def test_a_certificate_that_expires_ends_its_connection(lab, closing):
    endpoint = free_endpoint("tls")
    opened(lab.listening("router", endpoint, "router"), closing)
    soon = lab.dated("r2", timedelta(days=-1), timedelta(seconds=2.0 * ample_s()))
    brief = opened(lab.connecting(soon, endpoint), closing)
    lasting = opened(lab.connecting("r3", endpoint), closing)
    until(lambda: not brief.info.routers_zid(), "the connection's end")
    assert lasting.info.routers_zid()


@pytest.mark.parametrize("pretender", ["r2", "viewer"])
def test_a_robots_certificate_cannot_pass_for_the_routers(lab, closing, pretender):
    endpoint = free_endpoint("tls")
    opened(lab.listening(pretender, endpoint, "router"), closing)
    with pytest.raises(ConnectionFailed, match="cannot connect"):
        opened(lab.connecting("r1", endpoint), closing, REFUSED_S_MAX)


def test_a_router_under_a_name_that_its_certificate_does_not_have_is_not_believed(lab, closing):
    endpoint = free_endpoint("tls").replace("127.0.0.1", "127.0.0.2")
    opened(lab.listening("router", endpoint, "router"), closing)
    with pytest.raises(ConnectionFailed, match="cannot connect"):
        opened(lab.connecting("r1", endpoint), closing, REFUSED_S_MAX)


def test_the_largest_team_and_its_rules_are_accepted_by_zenoh(lab):
    everything = tls(lab.identity("router"), True, True) | gate()
    config = zenoh.Config.from_json5(configuration_file(everything))
    for name, value in everything.items():
        found = json.loads(config.get_json(name))
        if name == "access_control":
            assert [s["id"] for s in found["subjects"]] == ["world", "viewer", *TEAM, "router"]
            rules = [rule["id"] for rule in found["rules"]]
            assert len(rules) == len(set(rules))
            assert rules == [rule for policy in found["policies"] for rule in policy["rules"]]
        else:
            assert said(found) == value


def said(found):
    """A configuration without what it leaves open."""
    if isinstance(found, list):
        return [said(part) for part in found]
    if isinstance(found, dict):
        return {name: said(part) for name, part in found.items() if part is not None}
    return found


def test_rules_may_be_narrowed_to_one_run():
    rules = gate(ROBOTS, "demo")["access_control"]["rules"]
    keys = {key for rule in rules for key in rule["key_exprs"] if key != "**"}
    of_runs = keys - {ROUTER_KEY}
    assert {tuple(key.split("/")[:2]) for key in of_runs} == {("encircle", "demo")}


def test_robots_hear_each_others_poses_only_where_radios_are_real():
    def rules(**options):
        found = gate(ROBOTS, **options)["access_control"]["rules"]
        return {rule["id"]: rule["key_exprs"] for rule in found}

    simulated, real = rules(), rules(direct_radio=True)
    changed = {name for name in real if real[name] != simulated[name]}
    assert changed == {f"{robot} {verb}" for robot in ROBOTS for verb in ("takes", "hears")}
    for name in changed:
        assert real[name] == [*simulated[name], "encircle/*/robots/*/pose"]


def test_a_certificate_serves_in_the_direction_of_the_connection_only(lab):
    identity = lab.identity("world")
    names = {way: set(tls(identity, way != "out", way != "in")) for way in ("in", "out", "both")}
    assert not any("connect_" in name for name in names["in"] if "verify" not in name)
    assert not any("listen_" in name for name in names["out"])
    assert names["both"] == names["in"] | names["out"]


def test_who_listens_is_a_gate_and_nobody_listens_or_connects_without_encryption(lab):
    identity, inside, outside = lab.identity("world"), ["tls/127.0.0.1:7447"], ["tls/h:7447"]
    assert settings(identity, inside, ()) == tls(identity, True, False) | gate()
    assert settings(identity, (), outside) == tls(identity, False, True)
    both = settings(identity, inside, outside, direct_radio=True)
    assert both == tls(identity, True, True) | gate(direct_radio=True)
    for endpoints in ((["tcp/127.0.0.1:1"], outside), (inside, ["tcp/h:1"])):
        with pytest.raises(ConfigurationError, match="with certificates it must be tls/"):
            settings(identity, *endpoints)


def test_a_file_that_is_not_there_is_named(lab):
    with pytest.raises(ConfigurationError, match=r"r9\.pem: No such file.*r9 needs authority\.pem"):
        identity_in(lab.directory, "r9")
    with pytest.raises(ConfigurationError, match=r"authority\.pem: No such file"):
        identity_in(lab.directory / "nowhere", "r1")


def test_an_endpoint_without_encryption_is_refused_with_what_would_be_right():
    check_encrypted("listen", ["tls/127.0.0.1:7447", "quic/[::1]:7447"])
    with pytest.raises(
        ConfigurationError, match=r"connect = 'tcp/h:1'.*must be tls/h:1 or quic/h:1"
    ):
        check_encrypted("connect", ["tls/h:1", "tcp/h:1"])
