"""Certificates: the content of the files, what each allows, and that nothing is overwritten.

OpenSSL decides who gets a connection: the tests do handshakes in memory with the standard library.
"""

import contextlib
import ssl
import stat
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from encircle.network.certificates import CertificateError, describe_certificates, make_certificates
from encircle.protocol.zenoh.access_control import identity_in
from encircle.protocol.zenoh.endpoints import Identity

NODE_KINDS = ("router", "world", "viewer", "r1", "r2")
DAY = timedelta(days=1)
FLIGHTS_MAX = 10


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return make_certificates(tmp_path_factory.mktemp("lab") / "new", 2, ["lab.local", "10.1.2.3"])


def certificate(lab, name):
    return x509.load_pem_x509_certificate((lab.directory / f"{name}.pem").read_bytes())


def handshake(server: Identity, client: Identity, host: str) -> None:
    """Mutual TLS in memory; raises ``ssl.SSLError`` if either end refuses the other."""
    ends = []
    for identity, serves in ((server, True), (client, False)):
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER if serves else ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(identity.authority)
        context.verify_mode = ssl.CERT_REQUIRED
        context.load_cert_chain(identity.certificate, identity.key)
        pipes = ssl.MemoryBIO(), ssl.MemoryBIO()
        name = None if serves else host
        ends.append((context.wrap_bio(*pipes, server_side=serves, server_hostname=name), *pipes))
    (_, *server_pipes), (_, *client_pipes) = ends
    done: set[int] = set()
    for _ in range(FLIGHTS_MAX):
        for path, (end, _, _) in enumerate(ends):
            with contextlib.suppress(ssl.SSLWantReadError):
                end.do_handshake()
                done.add(path)
            server_pipes[0].write(client_pipes[1].read())
            client_pipes[0].write(server_pipes[1].read())
        if len(done) == len(ends):
            return
    raise AssertionError("the handshake came to no end")


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "::1", "lab.local", "10.1.2.3"])
@pytest.mark.parametrize("server", ["router", "world"])
def test_every_party_gets_a_connection_to_router_and_world_by_every_name(lab, server, host):
    for client in NODE_KINDS:
        handshake(identity_in(lab.directory, server), identity_in(lab.directory, client), host)


def test_a_host_that_is_not_named_in_the_certificate_is_not_believed(lab):
    router, robot = (identity_in(lab.directory, name) for name in ("router", "r1"))
    for host in ("elsewhere.local", "10.1.2.4"):
        with pytest.raises(ssl.SSLError, match="mismatch"):
            handshake(router, robot, host)


@pytest.mark.parametrize("server", ["r1", "r2", "viewer"])
def test_nobody_connects_to_what_only_connects(lab, server):
    with pytest.raises(ssl.SSLError, match="unsuitable certificate purpose"):
        handshake(
            identity_in(lab.directory, server), identity_in(lab.directory, "world"), "localhost"
        )


def test_labs_do_not_believe_each_other(lab, tmp_path):
    other = make_certificates(tmp_path / "other", 1)
    router, stranger = identity_in(lab.directory, "router"), identity_in(other.directory, "r1")
    who_trusts_us = Identity(router.authority, stranger.certificate, stranger.key)
    for client in (stranger, who_trusts_us):
        with pytest.raises(ssl.SSLError):
            handshake(router, client, "localhost")


@pytest.mark.parametrize(("begin", "end"), [(-3 * DAY, -DAY), (DAY, 3 * DAY)])
def test_a_certificate_is_good_for_its_days_only(tmp_path, begin, end):
    now = datetime.now(UTC)
    made = make_certificates(tmp_path / "lab", 1, not_before=now + begin, not_after=now + end)
    with pytest.raises(ssl.SSLError, match=r"expired|not yet valid"):
        handshake(*(identity_in(made.directory, n) for n in ("router", "r1")), "localhost")


def test_a_key_does_not_go_with_another_certificate(lab):
    r1, r2 = (identity_in(lab.directory, name) for name in ("r1", "r2"))
    with pytest.raises(ssl.SSLError, match=r"(?i)key.values.mismatch"):
        handshake(Identity(r1.authority, r2.certificate, r1.key), r1, "localhost")


def test_there_is_a_file_for_each_thing_and_only_their_owner_reads_keys(lab):
    made = {p.relative_to(lab.directory).as_posix(): p for p in lab.directory.rglob("*")}
    ends = {f"{name}.{end}" for name in NODE_KINDS for end in ("pem", "key")}
    others = {".gitignore", "authority.pem", "keep-apart", "keep-apart/authority.key"}
    assert set(made) == ends | others
    assert made[".gitignore"].read_text() == "*\n"
    assert lab.authority_key == made["keep-apart/authority.key"]
    modes = {name: stat.S_IMODE(path.stat().st_mode) for name, path in made.items()}
    assert {mode for name, mode in modes.items() if name.endswith(".key")} == {0o600}
    assert stat.S_IMODE(lab.directory.stat().st_mode) == modes["keep-apart"] == 0o700


def test_common_names_are_the_ids_and_validity_is_what_is_stated(lab):
    for name in NODE_KINDS:
        certificates_read = certificate(lab, name)
        assert [a.value for a in certificates_read.subject] == [name]
        assert (
            certificates_read.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value == name
        )
        assert (
            certificates_read.not_valid_before_utc,
            certificates_read.not_valid_after_utc,
        ) == lab[-2:]
    assert timedelta(days=30) < lab.not_after - lab.not_before < timedelta(days=31)
    assert all(
        name in describe_certificates(lab) for name in (*NODE_KINDS, f"{lab.not_after:%Y-%m-%d}")
    )


def test_the_authority_signs_ends_only_and_outlives_what_it_signed(lab):
    authority = certificate(lab, "authority")
    limits = authority.extensions.get_extension_for_class(x509.BasicConstraints)
    assert limits.critical
    assert (limits.value.ca, limits.value.path_length) == (True, 0)
    usage = authority.extensions.get_extension_for_class(x509.KeyUsage).value
    assert usage.key_cert_sign
    assert not usage.digital_signature
    key = load_pem_private_key(lab.authority_key.read_bytes(), None)
    assert key.public_key() == authority.public_key()
    for name in NODE_KINDS:
        certificates_read = certificate(lab, name)
        certificates_read.verify_directly_issued_by(authority)
        assert authority.not_valid_before_utc <= certificates_read.not_valid_before_utc
        assert authority.not_valid_after_utc >= certificates_read.not_valid_after_utc
        assert not certificates_read.extensions.get_extension_for_class(
            x509.BasicConstraints
        ).value.ca


def test_uses_and_names_are_those_of_the_part_played(lab):
    client, server = ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH
    for name in NODE_KINDS:
        extensions = certificate(lab, name).extensions
        serves = name in ("router", "world")
        uses = set(extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
        assert uses == ({client, server} if serves else {client})
        names = extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        hosts = ["localhost", "lab.local"] if serves else [name]
        addresses = ["127.0.0.1", "::1", "10.1.2.3"] if serves else []
        assert names.get_values_for_type(x509.DNSName) == hosts
        assert names.get_values_for_type(x509.IPAddress) == [ip_address(a) for a in addresses]


def test_no_two_keys_or_numbers_are_the_same(lab):
    certificates_read = [certificate(lab, name) for name in ("authority", *NODE_KINDS)]
    assert len({c.public_key().public_numbers() for c in certificates_read}) == len(
        certificates_read
    )
    assert len({c.serial_number for c in certificates_read}) == len(certificates_read)


def test_nothing_is_overwritten(lab, tmp_path):
    before = {path: path.read_bytes() for path in lab.directory.rglob("*.*") if path.is_file()}
    with pytest.raises(CertificateError, match="not empty: nothing is overwritten"):
        make_certificates(lab.directory, 2)
    assert {path: path.read_bytes() for path in before} == before
    (tmp_path / "file").write_text("mine")
    with pytest.raises(CertificateError, match="file"):
        make_certificates(tmp_path / "file", 2)
    (tmp_path / "empty").mkdir(mode=0o755)
    make_certificates(tmp_path / "empty", 1)
    assert stat.S_IMODE((tmp_path / "empty").stat().st_mode) == 0o700


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"robots": 0}, "robots = 0: must be 1 to 256"),
        ({"robots": 257}, "robots = 257: must be 1 to 256"),
        ({"days": 0}, "days = 0: must be 1 to 825"),
        ({"days": 826}, "days = 826: must be 1 to 825"),
        *(
            ({"hosts": [host]}, "must be a host's name or an address")
            for host in ("", "a b", "10.1.2.300", "-x.local", "a..b", "http://x", "bücher.de", "*")
        ),
    ],
)
def test_what_cannot_be_meant_is_named_and_leaves_nothing_behind(tmp_path, arguments, message):
    with pytest.raises(CertificateError, match=message):
        make_certificates(tmp_path / "lab", **{"robots": 2} | arguments)
    assert list(tmp_path.iterdir()) == []
