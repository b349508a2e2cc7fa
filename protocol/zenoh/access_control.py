"""Who belongs: what Zenoh is told so that only a lab's own nodes take part in its runs.

Two layers. Mutual TLS says who is there: both ends of a connection show a certificate signed by the
lab's private authority, and its common name is the node's id (``r1``, ``world``, ``router``,
``viewer``). Access control says what each may do: the *gate*, which is the node that the others
connect to, a router or the world itself, passes on what the table of keys in ``docs/protocol.md``
has a node say and hear, and drops the rest. So the holder of r2's key can neither speak as r3 nor
read what r3 observes. Rules name keys, never contents: whatever a node may say is still checked by
whoever receives it.

Nothing here touches a file or a socket but ``identity_in``, which looks whether the files are
there. Settings are a mapping from names in Zenoh's configuration to values.
"""

import json
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from encircle.protocol.keys import robot_key, world_key
from encircle.protocol.zenoh.endpoints import MESSAGE_BYTES_MAX, ConfigurationError, Identity
from encircle.protocol.zenoh.lanes import GATE_SETTINGS, QUEUE_SETTINGS
from encircle.protocol.zenoh.node_info import ROUTER_KEY
from encircle.protocol.zenoh.scenario_query import CHANNEL as SCENARIO

AUTHORITY, WORLD, ROUTER, VIEWER = "authority", "world", "router", "viewer"
FROM_ROBOTS, TO_ROBOTS, SHOWN = (
    ("pose", "command"),
    ("setup", "observation", "end"),
    ("state", "radio", "intervention"),
)
"""Channels of what robots say, of what the world says to them, and of what it shows to viewers."""
TEAM_MAX = 256
TEAM = tuple(f"r{number}" for number in range(1, TEAM_MAX + 1))
"""The ids of the largest team, for a gate that is not told which robots there are."""
ENCRYPTED = ("tls", "quic")
RETRY = {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2}
"""Slower than without TLS: a listener pauses for 0.1 s after every handshake that fails."""

Settings = dict[str, Any]


class Permissions(NamedTuple):
    """What a node may do, as key expressions.

    ``publishes``: keys that it publishes on. ``discovers``: subscriptions of others that it is
    informed of, for Zenoh holds a message back at its source until one is known. ``subscribes``:
    each of its own subscriptions must lie within one of these. ``receives``: keys of the messages
    that are passed on to it. ``declares``: its liveliness tokens. ``watches``: tokens that it is
    informed of. ``answers``: keys on which it answers queries about itself. ``queries``: keys on
    which it may query others.
    """

    publishes: tuple[str, ...] = ()
    discovers: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    receives: tuple[str, ...] = ()
    declares: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    queries: tuple[str, ...] = ()


ALL_MESSAGES = (
    *("put", "delete", "query", "reply", "declare_subscriber", "declare_queryable"),
    *("liveliness_token", "liveliness_query", "declare_liveliness_subscriber"),
)


def identity_in(directory: Path, name: str) -> Identity:
    """The identity of a node in a directory as ``make_certificates`` lays it out.

    ``ConfigurationError`` names the file that is not there or cannot be read.
    """
    identity = Identity(
        directory / f"{AUTHORITY}.pem", directory / f"{name}.pem", directory / f"{name}.key"
    )
    for path in (identity.authority, identity.certificate, identity.key):
        try:
            path.open("rb").close()
        except OSError as error:
            raise ConfigurationError(
                f"certificates = {directory}: {path.name}: {error.strerror};"
                f" {name} needs {AUTHORITY}.pem, {name}.pem and {name}.key there"
            ) from None
    return identity


def check_encrypted(kind: str, endpoints: Iterable[str]) -> None:
    """``ConfigurationError`` for an endpoint that would go around the certificates."""
    for endpoint in endpoints:
        protocol, _, rest = endpoint.partition("/")
        if protocol not in ENCRYPTED:
            raise ConfigurationError(
                f"{kind} = {endpoint!r}: with certificates it must be"
                f" {' or '.join(f'{p}/{rest}' for p in ENCRYPTED)}"
            )


def settings(
    identity: Identity,
    listen: Collection[str],
    connect: Collection[str],
    direct_radio: bool = False,
) -> Settings:
    """All settings of a node with these endpoints; who listens is a gate.

    ``direct_radio``: as for ``gate``. ``ConfigurationError`` for an endpoint without encryption.
    """
    check_encrypted("listen", listen)
    check_encrypted("connect", connect)
    tls_settings = tls(identity, bool(listen), bool(connect))
    return tls_settings | gate(direct_radio=direct_radio) if listen else tls_settings


def tls(identity: Identity, listens: bool, connects: bool) -> Settings:
    """Settings for mutual TLS, in whichever direction connections are made.

    A connection is closed when the certificate at its other end expires.
    """
    authority, certificate, key = (
        str(path.absolute()) for path in (identity.authority, identity.certificate, identity.key)
    )
    tls_settings: Settings = {
        "transport/link/tls/root_ca_certificate": authority,
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/verify_name_on_connect": True,
        "transport/link/tls/close_link_on_expiration": True,
        "transport/link/protocols": list(ENCRYPTED),
        "transport/link/rx/max_message_size": MESSAGE_BYTES_MAX,
    }
    if listens:
        tls_settings["transport/link/tls/listen_certificate"] = certificate
        tls_settings["transport/link/tls/listen_private_key"] = key
    if connects:
        tls_settings["transport/link/tls/connect_certificate"] = certificate
        tls_settings["transport/link/tls/connect_private_key"] = key
        tls_settings["connect/retry"] = dict(RETRY)
    return tls_settings


def gate(robots: Iterable[str] = TEAM, run: str = "*", direct_radio: bool = False) -> Settings:
    """Settings of the node that the others connect to: what each certificate may do there.

    And that nobody is waited for who does not read (``encircle.protocol.zenoh.lanes``).
    ``run``: a run's name, or any. ``direct_radio``: robots hear each other's poses themselves.
    """
    parts = {WORLD: world_permissions(run), VIEWER: viewer_permissions(run)}
    parts |= {robot: robot_permissions(run, robot, direct_radio) for robot in robots}
    rules = {name: _rules(name, part) for name, part in parts.items()}
    # Gates may be connected to each other; each has judged what it passes on.
    rules[ROUTER] = [_rule(f"{ROUTER} passes on", ALL_MESSAGES, ("ingress", "egress"), ("**",))]
    return QUEUE_SETTINGS | GATE_SETTINGS | {"access_control": _access_control(rules)}


def robot_permissions(run: str, robot: str, direct_radio: bool = False) -> Permissions:
    """A robot: speaks on its own keys, hears what is meant for it, sees whether the world lives."""
    from_robot = tuple(robot_key(run, robot, channel) for channel in FROM_ROBOTS)
    to_robots = tuple(robot_key(run, robot, channel) for channel in TO_ROBOTS)
    peers = (robot_key(run, "*", "pose"),) if direct_radio else ()
    own = robot_key(run, robot, "alive")
    return Permissions(
        publishes=from_robot,
        discovers=(robot_key(run, "*", "*"),),
        subscribes=(robot_key(run, robot, "*"), *peers),
        receives=(*to_robots, *peers),
        declares=(own,),
        watches=(own, world_key(run, "alive")),
        answers=(robot_key(run, robot, "about"),),
        queries=_info_keys(run),
    )


def world_permissions(run: str) -> Permissions:
    """The world: the other end of every robot's keys, and the truth for those who look on."""
    to_robots = tuple(robot_key(run, "*", channel) for channel in TO_ROBOTS)
    shown = tuple(world_key(run, channel) for channel in SHOWN)
    own = world_key(run, "alive")
    return Permissions(
        publishes=(*to_robots, *shown),
        discovers=(robot_key(run, "*", "*"), *shown),
        subscribes=(robot_key(run, "*", "*"),),
        receives=tuple(robot_key(run, "*", channel) for channel in FROM_ROBOTS),
        declares=(own,),
        watches=(own, robot_key(run, "*", "alive")),
        answers=(world_key(run, "about"), world_key(run, SCENARIO)),
        queries=_info_keys(run),
    )


def viewer_permissions(run: str) -> Permissions:
    """Whoever looks on: hears all that is said in a run, sees who is there, says nothing."""
    shown = tuple(world_key(run, channel) for channel in SHOWN)
    said = tuple(robot_key(run, "*", channel) for channel in (*TO_ROBOTS, *FROM_ROBOTS))
    return Permissions(
        subscribes=(*shown, robot_key(run, "*", "*")),
        receives=(*shown, *said),
        watches=(world_key(run, "alive"), robot_key(run, "*", "alive")),
        queries=(*_info_keys(run), world_key(run, SCENARIO)),
    )


def _info_keys(run: str) -> tuple[str, ...]:
    """Whom everybody may ask for versions and clock: ``encircle doctor`` does, on any host."""
    return world_key(run, "about"), robot_key(run, "*", "about"), ROUTER_KEY


def configuration_file(settings: Mapping[str, Any]) -> str:
    """Settings as the text of a Zenoh configuration file, for a router that is not ours."""
    tree: Settings = {}
    for name, value in settings.items():
        *path, last = name.split("/")
        branch = tree
        for part in path:
            branch = branch.setdefault(part, {})
        branch[last] = value
    return json.dumps(tree, indent=2)


def _access_control(rules: Mapping[str, list[Settings]]) -> Settings:
    """Zenoh's ``access_control``: by certificate common name, and what is not allowed is denied."""
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for own in rules.values() for rule in own],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in rules],
        "policies": [
            {"rules": [rule["id"] for rule in own], "subjects": [name]}
            for name, own in rules.items()
        ],
    }


def _rules(name: str, part: Permissions) -> list[Settings]:
    """Permissions as rules; messages come in from the node (ingress) or go out to it (egress)."""
    queries = ("declare_liveliness_subscriber", "liveliness_query")
    table = (
        ("says", ("put",), "ingress", part.publishes),
        ("finds", ("declare_subscriber",), "egress", part.discovers),
        ("takes", ("declare_subscriber",), "ingress", part.subscribes),
        ("hears", ("put",), "egress", part.receives),
        ("lives", ("liveliness_token",), "ingress", part.declares),
        ("watches", queries, "ingress", part.watches),
        ("sees", ("liveliness_token",), "egress", part.watches),
        ("tells", ("declare_queryable", "reply"), "ingress", part.answers),
        ("is asked", ("query",), "egress", part.answers),
        ("asks", ("query",), "ingress", part.queries),
        ("is told", ("reply",), "egress", part.queries),
    )
    return [
        _rule(f"{name} {verb}", messages, (flow,), expressions)
        for verb, messages, flow, expressions in table
        if expressions
    ]


def _rule(
    name: str, messages: Iterable[str], flows: Iterable[str], expressions: Iterable[str]
) -> Settings:
    return {
        "id": name,
        "permission": "allow",
        "messages": list(messages),
        "flows": list(flows),
        "key_exprs": list(expressions),
    }
