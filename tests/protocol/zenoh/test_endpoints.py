"""Endpoints and what can be meant by them."""

from pathlib import Path

import pytest

from encircle.protocol.zenoh.endpoints import (
    ConfigurationError,
    Endpoints,
    check_endpoint,
    loopback_endpoint,
    reachable_from_elsewhere,
)

GOOD = (
    "tcp/127.0.0.1:7447",
    "tcp/[::1]:7447",
    "tls/robots.example.org:7447",
    "quic/10.0.0.1:1",
    "ws/host-1:65535",
    "tcp/127.0.0.1:7447#so_sndbuf=65000;iface=lo",
    "udp/10.0.0.1:7447?rel=0",
    "unixsock-stream/run/encircle.sock",
)


@pytest.mark.parametrize("endpoint", GOOD)
def test_an_endpoint_is_taken(endpoint):
    check_endpoint("connect", endpoint)


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "nonsense",
        "tcp/",
        "127.0.0.1:7447",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:",
        "tcp/127.0.0.1:http",
        "tcp/127.0.0.1:0",
        "tcp/127.0.0.1:65536",
        "tcp/a b:7447",
        "tcp/::1:7447",
        "tcp/127.0.0.1:7447 ",
    ],
)
def test_what_is_no_endpoint_is_named_with_what_would_be_right(endpoint):
    with pytest.raises(ConfigurationError) as refused:
        Endpoints(connect=(endpoint,))
    said = str(refused.value)
    assert said == f"connect = {endpoint!r}: must be PROTOCOL/HOST:PORT, as in tcp/127.0.0.1:7447"


@pytest.mark.parametrize(
    ("endpoint", "protocol"), [("tpc/127.0.0.1:7447", "tpc"), ("tcp://127.0.0.1:7447", "tcp:")]
)
def test_an_unknown_protocol_is_named(endpoint, protocol):
    with pytest.raises(ConfigurationError) as refused:
        Endpoints(listen=(endpoint,))
    said = f"listen = {endpoint!r}: protocol {protocol!r} is not one of tcp, udp, tls, quic, ws"
    assert str(refused.value) == said


def test_any_free_port_can_be_listened_on_but_not_connected_to():
    Endpoints(listen=("tcp/127.0.0.1:0",))
    with pytest.raises(ConfigurationError):
        Endpoints(connect=("tcp/127.0.0.1:0",))


def test_a_party_that_neither_listens_nor_connects_is_refused():
    with pytest.raises(ConfigurationError, match="neither"):
        Endpoints()
    assert str(Endpoints(config=Path("own.json5"))) == "own.json5"


def test_a_client_does_not_listen():
    with pytest.raises(ConfigurationError, match="a client only connects"):
        Endpoints(listen=("tcp/127.0.0.1:1",), mode="client")


def test_it_reads_as_its_endpoints():
    both = Endpoints(listen=("tcp/127.0.0.1:1",), connect=("tcp/127.0.0.1:2", "tcp/127.0.0.1:3"))
    assert str(both) == "tcp/127.0.0.1:1, tcp/127.0.0.1:2, tcp/127.0.0.1:3"


def test_only_loopback_and_local_sockets_are_out_of_reach_for_others():
    local = (
        "tcp/127.0.0.1:1",
        "tcp/127.255.0.9:1",
        "tcp/[::1]:1",
        "tls/localhost:1#iface=eth0",
        "unixsock-stream/run/x",
        "unixpipe/run/x",
    )
    wide = (
        "tcp/0.0.0.0:1",
        "tcp/[::]:1",
        "tcp/10.0.0.1:1",
        "udp/127.0.0.1.example.org:1",
        "quic/host:1",
        "vsock/-1:1",
        "serial//dev/ttyS0",
    )
    assert reachable_from_elsewhere((*local, *wide)) == wide


def test_a_listener_everywhere_is_reached_from_here_by_loopback():
    assert loopback_endpoint("tcp/0.0.0.0:7447") == "tcp/127.0.0.1:7447"
    assert loopback_endpoint("tls/[::]:7447#iface=eth0") == "tls/[::1]:7447#iface=eth0"
    assert loopback_endpoint("tcp/10.0.0.1:7447") == "tcp/10.0.0.1:7447"
