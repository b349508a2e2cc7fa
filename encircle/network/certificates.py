"""A lab's own certificates: a private authority, and one certificate for each party.

X.509 with keys on the curve P-256. A party's common name is its id, by which access control knows
it (``encircle.protocol.zenoh.access_control``). The authority may sign nothing but end
certificates. Router and world may be connected to, under the names and addresses in their
certificates; robots and viewers may only connect, so that whoever takes a robot's key cannot pass
itself off as the world.

Trust ends in the authority's key. It is needed to make certificates and for nothing else, so it is
written into a directory of its own, to be kept away from the hosts. There is no list of revoked
certificates, because Zenoh would not read one: a short validity, and a new set of certificates
under a new authority, is what ends the use of a key that got lost.
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
HERE = ("localhost", "127.0.0.1", "::1")
DAYS, DAYS_MAX = 30, 825
SLACK = timedelta(hours=1)
"""Valid from this long ago, for hosts whose clocks are behind."""
HOST_CHARACTERS_MAX = 253
AUTHORITY_DIRECTORY = "keep-apart"

Names = list[x509.GeneralName]


class CertificateError(Exception):
    """Certificates cannot be made as asked; the message names the value and what would be right."""


class CertificateSet(NamedTuple):
    """What was made. ``names``: the parties; times are UTC."""

    directory: Path
    names: tuple[str, ...]
    authority_key: Path
    not_before: datetime
    not_after: datetime


class _Signed(NamedTuple):
    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def make_certificates(
    directory: Path,
    robots: int,
    hosts: Sequence[str] = (),
    days: int = DAYS,
    not_before: datetime | None = None,
    not_after: datetime | None = None,
) -> CertificateSet:
    """Make an authority and certificates for router, world, viewer and robots r1 to rN.

    ``directory`` gets ``authority.pem`` and for each party, say r1, ``r1.pem`` and ``r1.key``; the
    authority's key goes into ``keep-apart`` within. Directories have mode 0700, keys 0600. Git is
    told to ignore all of it.
    ``hosts``: names and addresses under which router and world are reached, besides this machine's
    own. ``not_before`` and ``not_after`` (UTC, for tests) overrule ``days`` for the parties.
    Nothing that exists is overwritten. Raises ``CertificateError``.
    """
    if not 1 <= robots <= TEAM_MAX:
        raise CertificateError(f"robots = {robots}: must be 1 to {TEAM_MAX}")
    if not 1 <= days <= DAYS_MAX:
        raise CertificateError(f"days = {days}: must be 1 to {DAYS_MAX}")
    names = [_host(host) for host in dict.fromkeys([*HERE, *hosts])]
    now = datetime.now(UTC).replace(microsecond=0)
    begin, end = not_before or now - SLACK, not_after or now + timedelta(days=days)
    authority = _authority(min(begin, now - SLACK), max(end, now + timedelta(days=days)))
    nodes = {
        name: _node_certificate(name, authority, names if name in SERVERS else [], begin, end)
        for name in (*SERVERS, VIEWER, *TEAM[:robots])
    }
    apart = directory / AUTHORITY_DIRECTORY
    _new_directory(directory)
    with signals_held(), emptied_on_failure(directory):
        _new_directory(apart)
        # Keys made inside a repository are not to be committed to it.
        (directory / ".gitignore").write_text("*\n")
        _write_certificate(directory / f"{AUTHORITY}.pem", authority)
        _write_key(apart / f"{AUTHORITY}.key", authority)
        for name, signed in nodes.items():
            check()
            _write_certificate(directory / f"{name}.pem", signed)
            _write_key(directory / f"{name}.key", signed)
    return CertificateSet(directory, tuple(nodes), apart / f"{AUTHORITY}.key", begin, end)


def describe(made: CertificateSet) -> str:
    """What was made, in lines for whoever asked for it."""
    robots = [name for name in made.names if name in TEAM]
    return "\n".join(
        (
            f"{made.directory}: certificates for {', '.join(SERVERS)}, {VIEWER} and"
            f" {robots[0]}{f' to {robots[-1]}' if len(robots) > 1 else ''},"
            f" valid until {made.not_after:%Y-%m-%d %H:%M} UTC",
            f"each party needs {AUTHORITY}.pem, its own .pem and its own .key, and no other key",
            f"keep {made.authority_key} away from the hosts: whoever has it belongs to the lab",
        )
    )


def _host(host: str) -> x509.GeneralName:
    """A host's name or address as it stands in a certificate."""
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


def _authority(not_before: datetime, not_after: datetime) -> _Signed:
    key = ec.generate_private_key(ec.SECP256R1())
    # Two labs' authorities must differ in name, or a stranger's error would be hard to read.
    name = _name(f"encircle authority {secrets.token_hex(4)}")
    usage = _key_usage(signs_certificates=True)
    return _Signed(
        _builder(name, name, key.public_key(), not_before, not_after)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(_key_id(key), critical=False)
        .sign(key, SHA256()),
        key,
    )


def _node_certificate(
    name: str, authority: _Signed, hosts: Names, not_before: datetime, not_after: datetime
) -> _Signed:
    """A certificate for one party; one with ``hosts`` may be connected to."""
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
    # Without a name of its own, a certificate is none to some checkers; a robot's is its id.
    names = x509.SubjectAlternativeName(hosts or [x509.DNSName(name)])
    builder = builder.add_extension(names, critical=False)
    return _Signed(builder.sign(authority.key, SHA256()), key)


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
    """Make a directory for its owner alone; one that exists must be empty."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if any(path.iterdir()):
            raise CertificateError(f"{path} is not empty: nothing is overwritten, name a new one")
        path.chmod(0o700)
    except OSError as error:
        raise CertificateError(f"{path}: {error.strerror}") from None


def _write_certificate(path: Path, signed: _Signed) -> None:
    _write(path, signed.certificate.public_bytes(Encoding.PEM), 0o644)


def _write_key(path: Path, signed: _Signed) -> None:
    pem = signed.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    _write(path, pem, 0o600)


def _write(path: Path, content: bytes, mode: int) -> None:
    """Write a new file that nobody could read with other permissions even for a moment."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
    except OSError as error:
        raise CertificateError(f"{path}: {error.strerror}") from None
