"""Zenoh links over real sessions on the loopback interface, on ports the system chooses."""

import json
import queue
import socket
import threading
import time
from contextlib import ExitStack
from dataclasses import replace

import pytest
from helpers_connections import connecting_to, in_thread, listening, received
from helpers_waiting import LONGEST_S, result_of, taken, until

from encircle.protocol.codec import BYTES_MAX
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.zenoh.access_control import settings
from encircle.protocol.zenoh.configuration import configuration, warning
from encircle.protocol.zenoh.connection import ConnectionFailed, ZenohConnection
from encircle.protocol.zenoh.endpoints import (
    MESSAGE_BYTES_MAX,
    ConfigurationError,
    Endpoints,
    Identity,
)


@pytest.fixture
def endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    return f"tcp/127.0.0.1:{port}"


@pytest.fixture
def closing():
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def pair(endpoint, closing):
    """A link that listens and one that connected to it, known to reach each other."""
    links = []
    for listens in (True, False):
        access = listening(endpoint) if listens else connecting_to(endpoint)
        link = ZenohConnection(access, "t/**")
        closing.callback(link.close)
        links.append(link)
    for sender, receiver in (links, links[::-1]):
        until_heard(sender, receiver)
    return links


def until_heard(sender, receiver):
    """Send until something arrives, then until all that was sent before has."""
    heard = in_thread(receiver.receive)

    def said():
        sender.send("t/hello", b"hello")
        return heard.done()

    until(said, "hello to arrive")
    assert result_of(heard) == ("t/hello", b"hello")
    sender.send("t/synced", b"")
    while received(receiver) != [("t/synced", b"")]:
        pass


def test_messages_go_both_ways_unchanged_and_in_order(pair):
    payloads = [b"", bytes(range(256)), b"x" * 100_000, *(str(k).encode() for k in range(200))]
    for sender, receiver in (pair, pair[::-1]):
        sent = [(f"t/{k % 3}", payload) for k, payload in enumerate(payloads)]
        for key, payload in sent:
            sender.send(key, payload)
        assert received(receiver, len(sent)) == sent


def test_own_messages_do_not_come_back(pair):
    for sender, receiver in (pair, pair[::-1]):
        receiver.send("t/own", b"own")
        sender.send("t/other", b"other")
        assert received(receiver) == [("t/other", b"other")]
        assert received(sender) == [("t/own", b"own")]


def test_only_the_keys_taken_are_received(pair):
    listener, connected = pair
    connected.send("u/1", b"not taken")
    connected.send("t/1", b"taken")
    assert received(listener) == [("t/1", b"taken")]


def test_overhearing_takes_what_others_send_on_such_keys_until_it_is_ended(pair):
    world, robot = pair
    heard: queue.Queue[tuple[str, bytes]] = queue.Queue()
    end = robot.subscribe("t/peers/*/pose", lambda key, payload: heard.put((key, payload)))
    robot.send("t/peers/1/pose", b"own")

    def said():
        world.send("t/peers/2/pose", b"theirs")
        return not heard.empty()

    until(said, "the subscription to be known on the other side")
    assert taken(heard) == ("t/peers/2/pose", b"theirs")
    end()
    end()


def test_who_never_waits_drops_what_finds_no_room_but_for_what_is_sent_once(pair):
    sender, receiver = pair[::-1]
    sender.drop_when_congested()
    flood = [("t/observation", b"%d" % k + bytes(30_000)) for k in range(2000)]
    for key, payload in flood:
        sender.send(key, payload)
    ended = in_thread(sender.send, "t/end", b"")
    found = []
    while not found or found[-1][0] != "t/end":
        found += received(receiver)
    result_of(ended)
    # Nobody took them in time, yet the sender went on; those that came are in order.
    came = [int(payload.rstrip(bytes(1))) for _, payload in found[:-1]]
    assert 0 < len(came) < len(flood)
    assert came == sorted(came)


def test_a_token_is_seen_to_come_and_go(pair):
    listener, connected = pair
    seen = queue.Queue()
    listener.watch("t/*/alive", lambda key, alive: seen.put((key, alive)))
    connected.declare_alive("t/r1/alive")
    assert taken(seen) == ("t/r1/alive", True)
    connected.close()
    assert taken(seen) == ("t/r1/alive", False)


def test_a_token_that_was_there_before_the_watch_is_told_of(pair):
    listener, connected = pair
    listener.declare_alive("t/world/alive")
    connected.send("t/announced", b"")
    received(listener)
    seen = queue.Queue()
    connected.watch("t/world/alive", lambda key, alive: seen.put((key, alive)))
    assert taken(seen) == ("t/world/alive", True)


def test_closing_wakes_who_waits(pair):
    for link in pair:
        waiting = in_thread(link.receive)
        time.sleep(0.1)  # let it get to where it waits
        result_of(in_thread(link.close))
        with pytest.raises(ConnectionClosed):
            result_of(waiting)


def test_what_was_sent_and_flushed_arrives_though_the_link_is_closed(pair):
    listener, connected = pair
    listener.answer_info_queries("t/listener/about", "listener")
    payloads = [bytes([k]) * 1000 for k in range(100)]
    taken = in_thread(received, listener, 100)
    for payload in payloads:
        connected.send("t/1", payload)
    connected.flush("t/*/about", LONGEST_S)
    connected.close()
    assert result_of(taken) == [("t/1", payload) for payload in payloads]


def test_a_link_whose_inbox_is_full_and_that_is_sent_still_more_closes(pair):
    receiver, sender = pair
    sent, seen, enough = [], [], threading.Event()

    def send_on():
        while not enough.is_set():
            sender.send("t/junk", bytes(1000))
            sent.append(1)

    sending = in_thread(send_on)

    def no_room():
        seen.append(len(sent))
        return seen[-1] > 0 and seen[-25:] == [seen[-1]] * 25

    until(no_room, "the inbox to be full")
    result_of(in_thread(receiver.close))
    enough.set()
    result_of(sending)


def test_a_link_may_be_closed_twice_and_stays_closed(pair):
    link = pair[1]
    link.send("t/declared", b"")
    for _ in range(2):
        link.close()
    for _ in range(2):
        with pytest.raises(ConnectionClosed):
            link.receive()
        for key in ("t/declared", "t/new"):
            with pytest.raises(ConnectionClosed):
                link.send(key, b"late")


def test_a_link_whose_other_end_is_gone_waits_on(pair):
    listener, connected = pair
    waiting = in_thread(connected.receive)
    listener.close()
    time.sleep(0.3)
    assert not waiting.done()
    connected.close()
    with pytest.raises(ConnectionClosed):
        result_of(waiting)


def test_connecting_where_nobody_listens_fails_and_names_the_endpoint(endpoint):
    with pytest.raises(ConnectionFailed) as refused:
        ZenohConnection(connecting_to(endpoint, 0.5), "t/**")
    assert str(refused.value) == (
        f"cannot connect to {endpoint}: nobody answers there within 0.5 s, or nobody who lets this"
        " node in; is a router or a world started there?"
    )


def test_connecting_to_a_host_that_is_not_known_says_so():
    where = "tcp/nowhere.invalid:7447"
    with pytest.raises(ConnectionFailed) as refused:
        ZenohConnection(connecting_to(where, 0.3), "t/**")
    said = f"cannot connect to {where}: no address is known for the host of {where}"
    assert str(refused.value) == said


def test_listening_where_somebody_else_does_fails_and_names_the_endpoint(closing):
    taken = closing.enter_context(socket.socket())
    taken.bind(("127.0.0.1", 0))
    taken.listen()
    endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
    with pytest.raises(ConnectionFailed) as refused:
        ZenohConnection(listening(endpoint), "t/**")
    said = str(refused.value)
    assert said.startswith(f"cannot listen on {endpoint}: ")
    assert "Address already in use" in said
    assert "\n" not in said
    assert ".rs:" not in said


def test_of_several_endpoints_the_one_that_fails_is_named(endpoint):
    """A mesh: it listens well enough, but one of its peers is not there."""
    there = endpoint.rpartition(":")[0] + ":0"
    absent = Endpoints(listen=(there,), connect=(endpoint,), connect_s_max=0.5)
    with pytest.raises(ConnectionFailed, match=f"cannot connect to {endpoint}: "):
        ZenohConnection(absent, "t/**")


def test_connecting_waits_for_a_listener_that_comes_a_little_later(endpoint, closing):
    connecting = in_thread(ZenohConnection, connecting_to(endpoint), "t/**")
    listener = ZenohConnection(listening(endpoint), "t/**")
    closing.callback(listener.close)
    connected = result_of(connecting)
    closing.callback(connected.close)
    until_heard(connected, listener)


def test_peers_that_know_each_other_form_a_mesh_whichever_comes_first(closing):
    endpoints = [f"tcp/127.0.0.1:{port}" for port in free_ports(3)]
    opening = []
    for k, own in enumerate(endpoints):
        others = tuple(endpoint for endpoint in endpoints if endpoint != own)
        access = Endpoints((own,), others, connect_s_max=LONGEST_S)
        opening.append(in_thread(ZenohConnection, access, f"t/{k}/*"))
    links = [result_of(future) for future in opening]
    for link in links:
        closing.callback(link.close)
    heard = [set() for _ in links]
    waiting = [
        in_thread(hear_from_two, link, keys) for link, keys in zip(links, heard, strict=True)
    ]

    def said():
        for k, link in enumerate(links):
            for j in range(len(links)):
                link.send(f"t/{j}/{k}", b"")
        return all(future.done() for future in waiting)

    until(said, "all to hear of all")
    assert heard == [{"t/0/1", "t/0/2"}, {"t/1/0", "t/1/2"}, {"t/2/0", "t/2/1"}]


def hear_from_two(link, keys):
    while len(keys) < 2:
        keys.add(link.receive()[0])


def free_ports(count):
    with ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(count)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [probe.getsockname()[1] for probe in probes]


def test_an_endpoint_of_a_configuration_file_that_fails_is_named_with_the_file(endpoint, tmp_path):
    path = written(tmp_path / "own.json5", f'{{ connect: {{ endpoints: ["{endpoint}"] }} }}')
    with pytest.raises(ConnectionFailed, match=r"cannot connect to \S+own\.json5: .+") as refused:
        ZenohConnection(Endpoints(config=path, connect_s_max=0.5), "t/**")
    assert f"nobody answers at {endpoint} within 0.5 s" in str(refused.value)


WIDE = ("tcp/0.0.0.0:0", "tcp/[::]:0", "tls/0.0.0.0:0", "tcp/example.invalid:1")


@pytest.mark.parametrize("endpoint", WIDE)
def test_listening_beyond_this_machine_must_be_asked_for_by_name(endpoint):
    with pytest.raises(ConfigurationError, match="--without-authentication") as refused:
        configuration(Endpoints(listen=("tcp/127.0.0.1:0", endpoint)))
    assert str(refused.value).startswith(f"listen = {endpoint}: ")
    asked = Endpoints(listen=(endpoint,), without_authentication=True)
    assert warning(asked) == (
        f"listening on {endpoint} without authentication: whoever can connect is let in"
    )


def test_listening_on_loopback_needs_no_asking_and_no_warning():
    for endpoint in ("tcp/127.0.0.1:0", "tcp/127.1.2.3:9", "tcp/[::1]:0", "tcp/localhost:0"):
        assert warning(Endpoints(listen=(endpoint,))) is None


def written(path, text):
    path.write_text(text)
    return path


def test_a_listener_that_authenticates_needs_no_asking(tmp_path):
    secret = '{ transport: { auth: { usrpwd: { dictionary_file: "users.txt" } } } }'
    by_password = written(tmp_path / "password.json5", secret)
    assert warning(Endpoints(listen=("tcp/0.0.0.0:0",), config=by_password)) is None
    certified = written(
        tmp_path / "tls.json5", "{ transport: { link: { tls: { enable_mtls: true } } } }"
    )
    assert warning(Endpoints(listen=("tls/0.0.0.0:0",), config=certified)) is None
    # Certificates say nothing of who connects by plain TCP.
    with pytest.raises(ConfigurationError, match=r"listen = tcp/0\.0\.0\.0:0: "):
        warning(Endpoints(listen=("tls/0.0.0.0:0", "tcp/0.0.0.0:0"), config=certified))


def setting(config, name):
    return json.loads(config.get_json(name))


def test_nothing_is_scouted_for_and_nothing_listens_that_was_not_asked_to():
    client = configuration(Endpoints(connect=("tcp/127.0.0.1:1",)))
    assert setting(client, "mode") == "client"
    assert setting(client, "listen/endpoints") == []
    peer = configuration(Endpoints(listen=("tcp/127.0.0.1:1",)))
    assert setting(peer, "mode") == "peer"
    assert setting(peer, "connect/endpoints") == []
    for config in (client, peer):
        assert setting(config, "scouting/multicast/enabled") is False
        assert setting(config, "scouting/gossip/enabled") is False


def test_a_configuration_file_says_what_the_options_leave_open(tmp_path):
    path = written(
        tmp_path / "own.json5",
        """{ mode: "peer",  // as Zenoh's own files are written
             connect: { endpoints: ["tcp/10.0.0.1:7447"], timeout_ms: 77 },
             scouting: { multicast: { enabled: true } } }""",
    )
    config = configuration(Endpoints(config=path))
    assert setting(config, "mode") == "peer"
    assert setting(config, "connect/endpoints") == ["tcp/10.0.0.1:7447"]
    assert setting(config, "connect/timeout_ms") == 77
    assert setting(config, "scouting/multicast/enabled") is True
    assert setting(config, "scouting/gossip/enabled") is False
    assert setting(config, "listen/endpoints") == []
    over = Endpoints(connect=("tcp/127.0.0.1:1",), mode="client", config=path)
    config = configuration(over)
    assert setting(config, "mode") == "client"
    assert setting(config, "connect/endpoints") == ["tcp/127.0.0.1:1"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "No such file"),
        ('{ mode: "peer"', "expected"),
        ('{ mood: "peer" }', "mood"),
        ('{ listen: { endpoints: ["tcp/0.0.0.0:7447"] }, mode: "peer" }', "0.0.0.0:7447"),
    ],
)
def test_a_configuration_file_that_cannot_be_used_is_one_line(tmp_path, text, said):
    path = tmp_path / "bad.json5"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigurationError, match=said) as refused:
        configuration(Endpoints(config=path))
    assert "\n" not in str(refused.value)


def test_how_long_a_message_may_be_is_always_limited(tmp_path):
    name = "transport/link/rx/max_message_size"
    plain = Endpoints(connect=("tcp/127.0.0.1:1",))
    assert setting(configuration(plain), name) == MESSAGE_BYTES_MAX > max(BYTES_MAX.values())
    assert setting(configuration(replace(plain, message_bytes_max=7)), name) == 7
    sizes = {1000: 1000, 2**40: MESSAGE_BYTES_MAX}
    for size, limit in sizes.items():
        text = f"{{ transport: {{ link: {{ rx: {{ max_message_size: {size} }} }} }} }}"
        path = written(tmp_path / "own.json5", text)
        assert setting(configuration(replace(plain, config=path)), name) == limit


def test_what_is_too_long_does_not_come_in_and_what_follows_it_does(endpoint, closing):
    listener = ZenohConnection(replace(listening(endpoint), message_bytes_max=100_000), "t/**")
    closing.callback(listener.close)
    connected = ZenohConnection(connecting_to(endpoint), "t/**")
    closing.callback(connected.close)
    until_heard(connected, listener)
    for size in (90_000, 110_000, 1_000_000, 90_001):
        connected.send("t/1", bytes(size))
    assert [len(payload) for _, payload in received(listener, 2)] == [90_000, 90_001]


def test_certificates_overrule_a_file_but_for_how_patiently_it_connects(tmp_path):
    identity = Identity(*(tmp_path / name for name in ("authority.pem", "r1.pem", "r1.key")))
    out = Endpoints(connect=("tls/127.0.0.1:1",), identity=identity)
    config = configuration(out)
    expected = settings(identity, (), out.connect)
    assert {name: setting(config, name) for name in expected} == expected
    retry = "{ connect: { retry: { period_init_ms: 7 } }, transport: { link: { tls: {"
    path = written(
        tmp_path / "own.json5", f"{retry} enable_mtls: false, so_sndbuf: 65000 }} }} }} }}"
    )
    config = configuration(replace(out, config=path))
    assert setting(config, "connect/retry")["period_init_ms"] == 7
    assert setting(config, "transport/link/tls/enable_mtls") is True
    assert setting(config, "transport/link/tls/so_sndbuf") == 65000
    plain = written(tmp_path / "plain.json5", '{ connect: { endpoints: ["tcp/127.0.0.1:1"] } }')
    with pytest.raises(ConfigurationError, match="must be tls/"):
        configuration(Endpoints(config=plain, identity=identity))


@pytest.mark.parametrize("direct_radio", [False, True])
def test_who_listens_with_certificates_holds_the_rules_and_needs_no_asking(tmp_path, direct_radio):
    identity = Identity(*(tmp_path / name for name in ("authority.pem", "world.pem", "world.key")))
    wide = Endpoints(listen=("tls/0.0.0.0:0",), identity=identity, direct_radio=direct_radio)
    assert warning(wide) is None
    rules = setting(configuration(wide), "access_control")["rules"]
    hears = next(rule["key_exprs"] for rule in rules if rule["id"] == "r1 hears")
    assert ("encircle/*/robots/*/pose" in hears) is direct_radio
