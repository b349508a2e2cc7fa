"""Which certificate a node shows, and whether it will do, found out before anybody connects.

Zenoh says of a connection that was refused only that there is none. So certificates are looked at
beforehand: a node shakes hands with itself, in memory, by the library that Python comes with,
which takes its certificate for its authority's or says what is wrong with it.
"""

import ssl
import stat
from pathlib import Path
from typing import Any

from encircle.protocol.zenoh.access_control import AUTHORITY, VIEWER, identity_in
from encircle.protocol.zenoh.endpoints import ConfigurationError, Identity

FLIGHTS_MAX = 10
PEM, KEY = ".pem", ".key"


def identity_of(directory: Path, name: str) -> Identity:
    """A node's identity that will do; ``ConfigurationError`` names the file and what is wrong."""
    identity = identity_in(directory, name)
    mode = stat.S_IMODE(identity.key.stat().st_mode)
    if mode & 0o077:
        raise ConfigurationError(
            f"certificates = {directory}: {identity.key.name}: mode {mode:04o} lets others at the"
            f" key: chmod 600 {identity.key}"
        )
    try:
        subject = common_name(identity)
    except ssl.SSLCertVerificationError as error:
        raise ConfigurationError(
            f"certificates = {directory}: {identity.certificate.name}: {error.verify_message};"
            " make new ones with encircle certificates"
        ) from None
    except _EncryptedKey:
        raise ConfigurationError(
            f"certificates = {directory}: {identity.key.name}: must have no passphrase, for nobody"
            " is there to type it"
        ) from None
    except (ssl.SSLError, OSError) as error:
        reason = getattr(error, "reason", None) or "not in PEM form"
        files = f"{AUTHORITY}{PEM}, {name}{PEM} and {name}{KEY}"
        raise ConfigurationError(
            f"certificates = {directory}: {files} are not a certificate and its key: {reason}"
        ) from None
    if subject != name:
        raise ConfigurationError(
            f"certificates = {directory}: {identity.certificate.name}: is the certificate of"
            f" {subject!r}, not of {name!r}"
        )
    return identity


def viewer_identity(directory: Path) -> Identity:
    """For one who only looks: the viewer's identity if it is there, else the only one there is."""
    names = sorted(path.stem for path in directory.glob(f"*{KEY}") if _has_certificate(path))
    if VIEWER in names or not names:
        return identity_of(directory, VIEWER)
    if len(names) > 1:
        raise ConfigurationError(
            f"certificates = {directory}: whose, of {', '.join(names[:5])}? Put {VIEWER}{PEM} and"
            f" {VIEWER}{KEY} there, or leave one"
        )
    return identity_of(directory, names[0])


def common_name(identity: Identity) -> str:
    """The common name of a certificate that its authority vouches for now; raises ``SSLError``.

    The server's end judges the certificate as that of a client, which every node is certified as;
    the client's end believes anything.
    """
    ends = []
    for protocol, demands in (
        (ssl.PROTOCOL_TLS_SERVER, ssl.CERT_REQUIRED),
        (ssl.PROTOCOL_TLS_CLIENT, ssl.CERT_NONE),
    ):
        context = ssl.SSLContext(protocol)
        context.check_hostname = False
        context.verify_mode = demands
        context.load_verify_locations(identity.authority)
        context.load_cert_chain(identity.certificate, identity.key, _no_passphrase)
        incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        serves = demands is ssl.CERT_REQUIRED
        ends.append((context.wrap_bio(incoming, outgoing, serves), incoming, outgoing))
    (server, to_server, from_server), (client, to_client, from_client) = ends
    for _ in range(FLIGHTS_MAX):
        for end in (client, server):
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
            if end is server:
                shown: Any = server.getpeercert() or {}
                names = [part for parts in shown.get("subject", ()) for part in parts]
                return str(dict(names).get("commonName", ""))
        to_server.write(from_client.read())
        to_client.write(from_server.read())
    raise ssl.SSLError("the handshake came to no end")


class _EncryptedKey(Exception):
    """A key that is encrypted."""


def _no_passphrase() -> str:
    # Else the library would ask for it, on the terminal, and wait.
    raise _EncryptedKey


def _has_certificate(key: Path) -> bool:
    return key.with_suffix(PEM).exists()
