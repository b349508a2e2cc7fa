"""Addresses at which a page is served: which requests are meant for it, and who reaches it."""

import pytest

from encircle.viewer.addresses import is_loopback, is_meant_for


@pytest.mark.parametrize(
    ("host", "port", "named", "is_own"),
    [
        # A browser leaves out the port that is http's own, and writes names small.
        ("127.0.0.1", 80, "127.0.0.1", True),
        ("127.0.0.1", 80, "localhost", True),
        ("127.0.0.1", 80, "evil.example", False),
        ("127.0.0.1", 8080, "127.0.0.1", False),
        ("Laptop", 8080, "laptop:8080", True),
        ("::1", 8080, "[::1]:8080", True),
        # At all of a machine's addresses it has no name of its own.
        ("0.0.0.0", 8080, "192.0.2.7:8080", True),
        ("0.0.0.0", 8080, "labhost:8080", False),
        ("labhost", 8080, "labhost:8080", True),
    ],
)
def test_its_own_name_is_known_as_browsers_write_it(host, port, named, is_own):
    assert is_meant_for(named, host, port) == is_own


@pytest.mark.parametrize(
    ("host", "alone"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.1.7", False),
        ("localhost.evil.example", False),
        # What cannot be known without asking anybody counts as reached by others.
        ("laptop", False),
    ],
)
def test_only_this_machine_reaches_loopback(host, alone):
    assert is_loopback(host) == alone
