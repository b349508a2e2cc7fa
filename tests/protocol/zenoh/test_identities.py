"""Certificates are found out about before anybody connects, in one line that names the file."""

import stat
from datetime import timedelta

import pytest
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
    load_pem_private_key,
)
from helpers_security import Lab

from encircle.protocol.zenoh.endpoints import ConfigurationError
from encircle.protocol.zenoh.identities import common_name, identity_of, viewer_identity

DAY = timedelta(days=1)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return Lab(tmp_path_factory.mktemp("identities"))


@pytest.fixture
def files(lab, tmp_path):
    """A directory with r1's three files, to be spoilt; it takes identities in r1's place."""

    def put(identity=None):
        identity = identity or lab.identity("r1")
        names = ("authority.pem", "r1.pem", "r1.key")
        for path, name in zip(
            (identity.authority, identity.certificate, identity.key), names, strict=True
        ):
            (tmp_path / name).write_bytes(path.read_bytes())
        (tmp_path / "r1.key").chmod(0o600)
        return tmp_path

    return put


def test_a_key_with_a_passphrase_is_refused_and_nobody_is_asked_for_it(lab, files):
    directory = files()
    key = load_pem_private_key((directory / "r1.key").read_bytes(), None)
    locked = BestAvailableEncryption(b"secret")
    (directory / "r1.key").write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, locked))
    refused(directory, r"r1\.key: must have no passphrase")


@pytest.mark.parametrize("name", ["router", "world", "viewer", "r1", "r4"])
def test_what_was_made_will_do_and_is_whose_it_is(lab, name):
    assert identity_of(lab.directory, name) == lab.identity(name)
    assert common_name(lab.identity(name)) == name


def refused(directory, said, name="r1"):
    with pytest.raises(ConfigurationError, match=said) as error:
        identity_of(directory, name)
    assert str(error.value).startswith(f"certificates = {directory}: ")
    assert "\n" not in str(error.value)


def test_one_that_has_expired_or_is_not_yet_valid_is_refused(lab, files):
    refused(files(lab.dated("r1", -3 * DAY, -DAY)), r"r1\.pem: certificate has expired; make new")
    refused(files(lab.dated("r1", DAY, 3 * DAY)), r"r1\.pem: certificate is not yet valid")


def test_one_of_another_authority_is_refused(lab, files):
    refused(files(lab.foreign("r1")), r"r1\.pem: ")


def test_one_under_anothers_name_is_refused(lab, files):
    refused(files(lab.identity("r2")), r"r1\.pem: is the certificate of 'r2', not of 'r1'")


def test_a_key_of_another_certificate_is_refused(lab, files):
    directory = files()
    (directory / "r1.key").write_bytes(lab.identity("r2").key.read_bytes())
    refused(directory, r"r1\.key are not a certificate and its key: (?i:key.values.mismatch)")


@pytest.mark.parametrize("name", ["authority.pem", "r1.pem", "r1.key"])
def test_what_is_no_certificate_or_not_there_is_named(files, name):
    directory = files()
    (directory / name).write_text("nothing of the kind")
    refused(directory, r"authority\.pem, r1\.pem and r1\.key are not a certificate and its key: \w")
    (directory / name).unlink()
    refused(directory, f"{name}: No such file or directory; r1 needs")


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o660])
def test_a_key_that_others_may_read_is_refused(files, mode):
    directory = files()
    (directory / "r1.key").chmod(mode)
    refused(directory, rf"r1\.key: mode {mode:04o} lets others at the key: chmod 600 ")
    (directory / "r1.key").chmod(stat.S_IRUSR)
    identity_of(directory, "r1")


def test_an_onlooker_is_the_viewer_or_the_only_one_there_is(lab, files):
    assert viewer_identity(lab.directory) == lab.identity("viewer")
    alone = files()
    assert viewer_identity(alone).certificate == alone / "r1.pem"
    (alone / "r2.key").touch()
    assert viewer_identity(alone).certificate == alone / "r1.pem"
    (alone / "r2.pem").touch()
    with pytest.raises(
        ConfigurationError, match=r"whose, of r1, r2\? Put viewer\.pem and viewer\.key"
    ):
        viewer_identity(alone)
    with pytest.raises(ConfigurationError, match="No such file"):
        viewer_identity(lab.directory / "nowhere")
