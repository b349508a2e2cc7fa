"""A node's endpoints (``encircle.protocol.zenoh.endpoints``) as Zenoh's own configuration.

Explicit endpoints, nothing scouted for, limits on messages and queues, certificates and rules; and
whether that lets in who should not be.
"""

import json
import re

import zenoh

from encircle.protocol.zenoh.access_control import settings
from encircle.protocol.zenoh.endpoints import (
    Access,
    AccessError,
    Identity,
    reachable_from_elsewhere,
)
from encircle.protocol.zenoh.lanes import GATE, ROOM

CONNECT_RETRY_MS = 20
CONNECT_RETRY_MS_MAX = 200
ERROR_CHARACTERS_MAX = 300
_BYTES_MAX = "transport/link/rx/max_message_size"
_SOURCE_LINE = re.compile(r" at /\S+\.rs:\d+\.")


def configuration(access: Access) -> zenoh.Config:
    """Zenoh's configuration for it; raises ``AccessError``.

    Explicit endpoints only, unless a configuration file says otherwise: nothing is scouted for,
    nothing listens that was not asked to. Certificates overrule such a file.
    """
    config = _from_file(access)
    if access.mode is not None:
        _insert(config, "mode", access.mode)
    _insert_if_open(config, "mode", "peer" if access.listen else "client")
    default = zenoh.Config().get_json("listen/endpoints")
    # A file may tell its owner where to listen; who only looks whether that is there must not.
    unsaid = config.get_json("listen/endpoints") == default
    if access.listen or access.mode == "client" or unsaid:
        _insert(config, "listen/endpoints", access.listen)
    if access.connect:
        _insert(config, "connect/endpoints", access.connect)
    if access.identity is not None:
        _insert_identity(config, access.identity, access.direct_radio)
    bytes_max = json.loads(config.get_json(_BYTES_MAX))
    _insert(config, _BYTES_MAX, min(bytes_max, access.message_bytes_max))
    retry = {
        "period_init_ms": CONNECT_RETRY_MS,
        "period_max_ms": CONNECT_RETRY_MS_MAX,
        "period_increase_factor": 2,
    }
    _insert_if_open(config, "connect/timeout_ms", int(access.connect_s_max * 1000))
    _insert_if_open(config, "connect/exit_on_failure", True)
    _insert_if_open(config, "connect/retry", retry)
    _insert_if_open(config, "scouting/multicast/enabled", False)
    _insert_if_open(config, "scouting/gossip/enabled", False)
    if access.config is None:
        _insert(config, "transport/shared_memory/enabled", False)
    _insert_lanes(config)
    exposed = _exposed(config)
    if exposed and not access.without_authentication:
        raise AccessError(
            f"listen = {exposed[0]}: other machines may reach it, and nothing tells who connects;"
            " listen on 127.0.0.1, or give --certificates, or say --without-authentication"
        )
    return config


def endpoints(access: Access) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Where it will listen and where it will connect, its configuration file included."""
    config = configuration(access)
    mode = json.loads(config.get_json("mode"))
    return _listed(config, "listen/endpoints", mode), _listed(config, "connect/endpoints", mode)


def warning(access: Access) -> str | None:
    """What is to be said of listening as asked, if anything; raises ``AccessError``."""
    exposed = _exposed(configuration(access))
    if not exposed:
        return None
    return (
        f"listening on {', '.join(exposed)} without authentication: whoever can connect is let in"
    )


def _from_file(access: Access) -> zenoh.Config:
    if access.config is None:
        return zenoh.Config()
    try:
        # Opened here first: a reason in plain words.
        access.config.open("rb").close()
        return zenoh.Config.from_file(str(access.config))
    except OSError as error:
        raise AccessError(f"Zenoh configuration {access.config}: {error.strerror}") from None
    except zenoh.ZError as error:
        raise AccessError(f"Zenoh configuration {access.config}: {in_one_line(error)}") from None


def _insert_identity(config: zenoh.Config, identity: Identity, direct_radio: bool) -> None:
    """Certificates, and the rules if it listens; to be done when all endpoints are known."""
    mode = json.loads(config.get_json("mode"))
    listening, connecting = (
        _listed(config, f"{kind}/endpoints", mode) for kind in ("listen", "connect")
    )
    for name, value in settings(identity, listening, connecting, direct_radio).items():
        # How patiently to connect is for a configuration file to say, if it does.
        (_insert_if_open if name == "connect/retry" else _insert)(config, name, value)


def _insert_lanes(config: zenoh.Config) -> None:
    """Room for messages, and who waits for it, where a configuration file says nothing else."""
    listens = _listed(config, "listen/endpoints", json.loads(config.get_json("mode")))
    default = zenoh.Config()
    for name, value in (ROOM | GATE if listens else ROOM).items():
        if config.get_json(name) == default.get_json(name):
            _insert(config, name, value)


def _exposed(config: zenoh.Config) -> tuple[str, ...]:
    """The listening endpoints that others may reach, and nothing says who they are."""
    mode = json.loads(config.get_json("mode"))
    listening = _listed(config, "listen/endpoints", mode)
    if json.loads(config.get_json("transport/auth/usrpwd/dictionary_file")) is not None:
        return ()
    certified = json.loads(config.get_json("transport/link/tls/enable_mtls")) is True
    return tuple(
        endpoint
        for endpoint in reachable_from_elsewhere(listening)
        if not (certified and endpoint.startswith(("tls/", "quic/")))
    )


def _listed(config: zenoh.Config, name: str, mode: str) -> tuple[str, ...]:
    """Endpoints of a configuration, which may name them apart for each mode."""
    found = json.loads(config.get_json(name))
    if isinstance(found, dict):
        found = found.get(mode, [])
    return tuple(map(str, found if isinstance(found, list) else [found]))


def _insert(config: zenoh.Config, name: str, value: object) -> None:
    config.insert_json5(name, json.dumps(value))


def _insert_if_open(config: zenoh.Config, name: str, value: object) -> None:
    """What a configuration file left open; there Zenoh's own default is null."""
    if config.get_json(name) == "null":
        _insert(config, name, value)


def in_one_line(error: BaseException) -> str:
    """The error without the places in Zenoh's source where it passed."""
    text = " ".join(_SOURCE_LINE.sub("", str(error)).split())
    return text[:ERROR_CHARACTERS_MAX] or type(error).__name__
