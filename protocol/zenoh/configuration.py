"""A node's endpoints (``encircle.protocol.zenoh.endpoints``) as Zenoh's own configuration.

Explicit endpoints, nothing scouted for, limits on messages and queues, certificates and rules; and
whether that lets in who should not be.
"""

import json
import re

import zenoh

from encircle.protocol.zenoh.access_control import settings
from encircle.protocol.zenoh.endpoints import (
    ConfigurationError,
    Endpoints,
    Identity,
    reachable_from_elsewhere,
)
from encircle.protocol.zenoh.lanes import GATE_SETTINGS, QUEUE_SETTINGS

CONNECT_RETRY_MS = 20
CONNECT_RETRY_MS_MAX = 200
ERROR_CHARACTERS_MAX = 300
_BYTES_MAX = "transport/link/rx/max_message_size"
_SOURCE_LINE = re.compile(r" at /\S+\.rs:\d+\.")


def configuration(endpoints: Endpoints) -> zenoh.Config:
    """Zenoh's configuration for it; raises ``ConfigurationError``.

    Explicit endpoints only, unless a configuration file says otherwise: nothing is scouted for,
    nothing listens that was not asked to. Certificates overrule such a file.
    """
    config = _from_file(endpoints)
    if endpoints.mode is not None:
        _insert(config, "mode", endpoints.mode)
    _insert_if_open(config, "mode", "peer" if endpoints.listen else "client")
    default = zenoh.Config().get_json("listen/endpoints")
    # A file may tell its owner where to listen; who only looks whether that is there must not.
    not_given = config.get_json("listen/endpoints") == default
    if endpoints.listen or endpoints.mode == "client" or not_given:
        _insert(config, "listen/endpoints", endpoints.listen)
    if endpoints.connect:
        _insert(config, "connect/endpoints", endpoints.connect)
    if endpoints.identity is not None:
        _insert_identity(config, endpoints.identity, endpoints.direct_radio)
    bytes_max = json.loads(config.get_json(_BYTES_MAX))
    _insert(config, _BYTES_MAX, min(bytes_max, endpoints.message_bytes_max))
    retry = {
        "period_init_ms": CONNECT_RETRY_MS,
        "period_max_ms": CONNECT_RETRY_MS_MAX,
        "period_increase_factor": 2,
    }
    _insert_if_open(config, "connect/timeout_ms", int(endpoints.connect_s_max * 1000))
    _insert_if_open(config, "connect/exit_on_failure", True)
    _insert_if_open(config, "connect/retry", retry)
    _insert_if_open(config, "scouting/multicast/enabled", False)
    _insert_if_open(config, "scouting/gossip/enabled", False)
    if endpoints.config is None:
        _insert(config, "transport/shared_memory/enabled", False)
    _insert_queues(config)
    exposed = _exposed(config)
    if exposed and not endpoints.without_authentication:
        raise ConfigurationError(
            f"listen = {exposed[0]}: other machines may reach it, and nothing tells who connects;"
            " listen on 127.0.0.1, or give --certificates, or say --without-authentication"
        )
    return config


def configured_endpoints(endpoints: Endpoints) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Where it will listen and where it will connect, its configuration file included."""
    config = configuration(endpoints)
    mode = json.loads(config.get_json("mode"))
    return _listed(config, "listen/endpoints", mode), _listed(config, "connect/endpoints", mode)


def warning(endpoints: Endpoints) -> str | None:
    """What is to be said of listening as asked, if anything; raises ``ConfigurationError``."""
    exposed = _exposed(configuration(endpoints))
    if not exposed:
        return None
    return (
        f"listening on {', '.join(exposed)} without authentication: whoever can connect is let in"
    )


def _from_file(endpoints: Endpoints) -> zenoh.Config:
    if endpoints.config is None:
        return zenoh.Config()
    try:
        # Opened here first: a reason in plain words.
        endpoints.config.open("rb").close()
        return zenoh.Config.from_file(str(endpoints.config))
    except OSError as error:
        raise ConfigurationError(
            f"Zenoh configuration {endpoints.config}: {error.strerror}"
        ) from None
    except zenoh.ZError as error:
        raise ConfigurationError(
            f"Zenoh configuration {endpoints.config}: {in_one_line(error)}"
        ) from None


def _insert_identity(config: zenoh.Config, identity: Identity, direct_radio: bool) -> None:
    """Certificates, and the rules if it listens; to be done when all endpoints are known."""
    mode = json.loads(config.get_json("mode"))
    listening, connecting = (
        _listed(config, f"{kind}/endpoints", mode) for kind in ("listen", "connect")
    )
    for name, value in settings(identity, listening, connecting, direct_radio).items():
        # How patiently to connect is for a configuration file to say, if it does.
        (_insert_if_open if name == "connect/retry" else _insert)(config, name, value)


def _insert_queues(config: zenoh.Config) -> None:
    """Room for messages, and who waits for it, where a configuration file says nothing else."""
    listens = _listed(config, "listen/endpoints", json.loads(config.get_json("mode")))
    default = zenoh.Config()
    for name, value in (QUEUE_SETTINGS | GATE_SETTINGS if listens else QUEUE_SETTINGS).items():
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
    entry = json.loads(config.get_json(name))
    if isinstance(entry, dict):
        entry = entry.get(mode, [])
    return tuple(map(str, entry if isinstance(entry, list) else [entry]))


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
