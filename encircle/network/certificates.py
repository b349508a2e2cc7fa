"""Certificates of a lab: a private authority, and one certificate for each node and for viewers.

The certificates are X.509 with keys on the curve P-256. A node's common name is its id, by which
access control knows it (``encircle.protocol.zenoh.access_control``). The authority may sign end
certificates only. Router and world accept connections under the names and addresses in their
certificates. Robots and viewers may only connect, so that a stolen robot key cannot be used to pose
as the world.

Whoever has the authority's key can make certificates that all nodes trust. It is needed for nothing
else, so it is written into a directory of its own, to be kept away from the hosts. There is no list
of revoked certificates, because Zenoh would not read one. Two things end the use of a lost key: the
certificate expires, or the lab makes a new set of certificates with a new authority.
"""

import contextlib
import ipaddress
import os
import secrets
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from encircle.protocol.process.interrupts import check, signals_held
from encircle.protocol.zenoh.access_control import AUTHORITY, ROUTER, TEAM, TEAM_MAX, VIEWER, WORLD
from encircle.whole_directory import emptied_on_failure

SERVERS = (ROUTER, WORLD)
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
DAYS_DEFAULT, DAYS_MAX = 30, 825
CLOCK_SLACK = timedelta(hours=1)
"""Certificates are valid from this long ago, for hosts whose clocks are behind."""
HOST_CHARACTERS_MAX = 253
AUTHORITY_DIRECTORY = "keep-apart"

Names = list[x509.GeneralName]


class CertificateError(Exception):
    """Certificates cannot be made as requested; the message names the value and what is allowed."""


class CertificateSet(NamedTuple):
    """Certificates that were made, and where; times are UTC.

    ``names``: who has a certificate. ``authority_key``: path of the key that signed them.
    """

    directory: Path
    names: tuple[str, ...]
    authority_key: Path
    not_before: datetime
    not_after: datetime


class _CertificateAndKey(NamedTuple):
    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def make_certificates(
    directory: Path,
    robots: int,
    hosts: Sequence[str] = (),
    days: int = DAYS_DEFAULT,
    not_before: datetime | None = None,
    not_after: datetime | None = None,
) -> CertificateSet:
    """Make an authority and certificates for router, world, viewer and robots r1 to rN.

    ``directory`` gets ``authority.pem`` and for each name, say r1, ``r1.pem`` and ``r1.key``.
    The authority's key is written into ``keep-apart`` in it. Directories have mode 0700, keys
    0600. A ``.gitignore`` keeps all of it out of Git.

    ``hosts``: names and addresses of router and world, besides those of this machine.
    ``not_before`` and ``not_after`` (UTC, for tests) replace ``days`` for all certificates but
    the authority's. Nothing that exists is overwritten. Raises ``CertificateError`` for a wrong
    argument or a directory that cannot be used.
    """
    if not 1 <= robots <= TEAM_MAX:
        raise CertificateError(f"robots = {robots}: must be 1 to {TEAM_MAX}")
    if not 1 <= days <= DAYS_MAX:
        raise CertificateError(f"days = {days}: must be 1 to {DAYS_MAX}")
    names = [_host(host) for host in dict.fromkeys([*LOCAL_HOSTS, *hosts])]
    now = datetime.now(UTC).replace(microsecond=0)
    valid_from, valid_until = (
        not_before or now - CLOCK_SLACK,
        not_after or now + timedelta(days=days),
    )
    authority = _authority(
        min(valid_from, now - CLOCK_SLACK), max(valid_until, now + timedelta(days=days))
    )
    nodes = {
        name: _node_certificate(
            name, authority, names if name in SERVERS else [], valid_from, valid_until
        )
        for name in (*SERVERS, VIEWER, *TEAM[:robots])
    }
    apart = directory / AUTHORITY_DIRECTORY
    _new_directory(directory)
    with signals_held(), emptied_on_failure(directory):
        _new_directory(apart)
        # The directory may lie in a repository, and keys must not be committed.
        (directory / ".gitignore").write_text("*\n")
        _write_certificate(directory / f"{AUTHORITY}.pem", authority)
        _write_key(apart / f"{AUTHORITY}.key", authority)
        for name, signed in nodes.items():
            check()
            _write_certificate(directory / f"{name}.pem", signed)
            _write_key(directory / f"{name}.key", signed)
    return CertificateSet(
        directory, tuple(nodes), apart / f"{AUTHORITY}.key", valid_from, valid_until
    )


def describe_certificates(certificates: CertificateSet) -> str:
    """What was made, as lines for the terminal."""
    robots = [name for name in certificates.names if name in TEAM]
    return "\n".join(
        (
            f"{certificates.directory}: certificates for {', '.join(SERVERS)}, {VIEWER} and"
            f" {robots[0]}{f' to {robots[-1]}' if len(robots) > 1 else ''},"
            f" valid until {certificates.not_after:%Y-%m-%d %H:%M} UTC",
            f"each node needs {AUTHORITY}.pem, its own .pem and its own .key, and no other key",
            f"keep {certificates.authority_key} away from the hosts: whoever has it belongs to the"
            " lab",
        )
    )


def _host(host: str) -> x509.GeneralName:
    """A host's name or address in the form that a certificate holds."""
    with contextlib.suppress(ValueError):
        return x509.IPAddress(ipaddress.ip_address(host))
    labels = host.removesuffix(".").split(".")
    plain = all(
        label.isascii()
        and label.replace("-", "").replace("_", "").isalnum()
        and not label.startswith("-")
        and not label.endswith("-")
        and len(label) <= 63
        for label in labels
    )
    if not plain or len(host) > HOST_CHARACTERS_MAX or labels[-1].isdigit():
        raise CertificateError(
            f"host {host!r}: must be a host's name or an address, as in lab.local or 192.168.1.10"
        )
    return x509.DNSName(host.removesuffix("."))


def _authority(not_before: datetime, not_after: datetime) -> _CertificateAndKey:
    key = ec.generate_private_key(ec.SECP256R1())
    # Authorities of different labs get different names, so that error messages tell them apart.
    name = _name(f"encircle authority {secrets.token_hex(4)}")
    usage = _key_usage(signs_certificates=True)
    return _CertificateAndKey(
        _builder(name, name, key.public_key(), not_before, not_after)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(_key_id(key), critical=False)
        .sign(key, SHA256()),
        key,
    )


def _node_certificate(
    name: str,
    authority: _CertificateAndKey,
    hosts: Names,
    not_before: datetime,
    not_after: datetime,
) -> _CertificateAndKey:
    """A certificate for one node or viewer; one with ``hosts`` accepts connections."""
    key = ec.generate_private_key(ec.SECP256R1())
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if hosts else [])]
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(authority.key.public_key())
    builder = (
        _builder(
            _name(name), authority.certificate.subject, key.public_key(), not_before, not_after
        )
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        .add_extension(_key_id(key), critical=False)
        .add_extension(issuer, critical=False)
    )
    # Some libraries reject a certificate without an alternative name; a robot gets its id.
    names = x509.SubjectAlternativeName(hosts or [x509.DNSName(name)])
    builder = builder.add_extension(names, critical=False)
    return _CertificateAndKey(builder.sign(authority.key, SHA256()), key)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    public_key: ec.EllipticCurvePublicKey,
    not_before: datetime,
    not_after: datetime,
) -> x509.CertificateBuilder:
    return x509.CertificateBuilder(
        issuer, subject, public_key, x509.random_serial_number(), not_before, not_after
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _key_id(key: ec.EllipticCurvePrivateKey) -> x509.SubjectKeyIdentifier:
    return x509.SubjectKeyIdentifier.from_public_key(key.public_key())


def _key_usage(signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _new_directory(path: Path) -> None:
    """Make a directory that only its owner can read; one that exists must be empty."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if any(path.iterdir()):
            raise CertificateError(f"{path} is not empty: nothing is overwritten, name a new one")
        path.chmod(0o700)
    except OSError as error:
        raise CertificateError(f"{path}: {error.strerror}") from None


def _write_certificate(path: Path, signed: _CertificateAndKey) -> None:
    _write(path, signed.certificate.public_bytes(Encoding.PEM), 0o644)


def _write_key(path: Path, signed: _CertificateAndKey) -> None:
    pem = signed.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    _write(path, pem, 0o600)


def _write(path: Path, content: bytes, mode: int) -> None:
    """Write a new file that has its final permissions from the start.

    Otherwise others could read it for a moment.
    """
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
    except OSError as error:
        raise CertificateError(f"{path}: {error.strerror}") from None
