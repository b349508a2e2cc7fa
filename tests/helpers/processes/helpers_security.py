"""A lab with certificates for tests: its files, and Zenoh configuration files for its nodes."""

import itertools
import socket
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key

from encircle.network.certificates import make_certificates
from encircle.protocol.zenoh.access_control import configuration_file, gate, identity_in, tls
from encircle.protocol.zenoh.endpoints import Identity

ROBOTS = ("r1", "r2", "r3", "r4")
REFUSED_S_MAX = 0.3
"""How long those go on trying to connect who never will."""


def free_endpoint(protocol: str) -> str:
    """A loopback endpoint with a port that is free now."""
    kind = socket.SOCK_DGRAM if protocol == "quic" else socket.SOCK_STREAM
    with socket.socket(type=kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{protocol}/127.0.0.1:{probe.getsockname()[1]}"


class Lab:
    """A lab of four robots with certificates, another lab, and configuration files for each."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._numbers = itertools.count()
        self._made = make_certificates(folder / "lab", len(ROBOTS))
        self.directory = self._made.directory
        make_certificates(folder / "other", len(ROBOTS))

    def identity(self, name: str) -> Identity:
        return identity_in(self.directory, name)

    def foreign(self, name: str) -> Identity:
        """A certificate by the other lab's authority, for one that takes this lab's word."""
        other = identity_in(self._folder / "other", name)
        return Identity(self.identity(name).authority, other.certificate, other.key)

    def dated(self, name: str, begin: timedelta, end: timedelta) -> Identity:
        """A node's certificate issued anew by its lab, valid from and until so long from now."""
        now = datetime.now(UTC)
        ours = self.identity(name)
        old = x509.load_pem_x509_certificate(ours.certificate.read_bytes())
        builder = x509.CertificateBuilder(
            old.issuer, old.subject, old.public_key(), old.serial_number, now + begin, now + end
        )
        for extension in old.extensions:
            builder = builder.add_extension(extension.value, extension.critical)
        key = load_pem_private_key(self._made.authority_key.read_bytes(), None)
        path = self._folder / f"{name}-{next(self._numbers)}.pem"
        path.write_bytes(builder.sign(key, SHA256()).public_bytes(Encoding.PEM))
        return Identity(ours.authority, path, ours.key)

    def listening(self, name: str, endpoint: str, mode: str, connect: Sequence[str] = ()) -> Path:
        """The configuration file of a gate: it listens, and holds the rules."""
        settings = {"mode": mode, "listen/endpoints": [endpoint], "connect/endpoints": [*connect]}
        return self._file(settings | tls(self.identity(name), True, bool(connect)) | gate(ROBOTS))

    def connecting(self, who: str | Identity | None, endpoint: str, mode: str = "client") -> Path:
        """That of a node, or with None of one without any certificate."""
        settings = {"mode": mode, "listen/endpoints": [], "connect/endpoints": [endpoint]}
        if who is None:
            authority = str(self.identity("r1").authority)
            return self._file(settings | {"transport/link/tls/root_ca_certificate": authority})
        identity = self.identity(who) if isinstance(who, str) else who
        return self._file(settings | tls(identity, False, True))

    def _file(self, settings: dict[str, Any]) -> Path:
        path = self._folder / f"{next(self._numbers)}.json5"
        path.write_text(configuration_file(settings))
        return path
