"""Counting refusals out of Zenoh's log; the lines are as Zenoh 1.10 writes them.

That it still writes them so is for ``test_security`` to say, with real sessions.
"""

import sys

import pytest
from helpers_waiting import completed

from encircle.protocol.zenoh.refusals import KNOWN_MAX, Refusals

SESSION = "c9a8e3510e12e0fb5a3d718a54cf74c8"
SUBJECT = f"Interface(lo)+CertCommonName(r2)+Transport(Tls)+{SESSION}"
KEY = "encircle/demo/robots/r3/pose"
ACTIONS = (
    *("Query", "Reply", "Put", "Delete", "Declare/Undeclare Subscriber"),
    *("Declare/Undeclare Queryable", "Declare/Undeclare Liveliness Token", "Liveliness Query"),
    "Declare Liveliness Subscriber",
)


def line(text: str, level: str = "TRACE", module: str = "", thread: str = "rx-0") -> str:
    module = module or "zenoh::net::routing::interceptor::access_control"
    return (
        f"\x1b[2m2026-01-02T03:04:05.678901Z\x1b[0m \x1b[35m{level}\x1b[0m {thread} ThreadId(09)"
        f" \x1b[2m{module}\x1b[0m\x1b[2m:\x1b[0m {text}\n"
    )


def direct(what: str, verdict: str = "unauthorized", flow: str = "ingress") -> str:
    return f"{SESSION} on {SUBJECT} is {verdict} to {what} ({flow}) on {KEY}"


def cached(what: str, verdict: str = "unauthorized", flow: str = "ingress") -> str:
    return f"Using cached result: {SESSION} is {verdict} to {what} ({flow}) on {KEY}"


def preparing(thread: str) -> list[str]:
    """A new key is looked up for every action in both directions, before any message is judged."""
    return [
        line(text, thread=thread)
        for flow in ("ingress", "egress")
        for text in (
            f"ACL ({flow}): caching permissions for `{KEY}` ...",
            *(direct(action, flow=flow) for action in ACTIONS),
        )
    ]


def test_a_message_counts_once_whether_its_key_was_looked_up_before_or_not():
    log = [line(direct("Put")), *preparing("rx-0"), line(cached("Put")), line(cached("Put"))]
    assert Refusals().take_all(log).messages == {("r2", "put"): 3}


def test_looking_a_key_up_is_no_refusal_and_hides_none_on_another_thread():
    first, *rest = preparing("rx-0")
    log = [first, line(direct("Put"), thread="rx-1"), *rest, line(direct("Delete"))]
    assert Refusals().take_all(log).messages == {("r2", "put"): 1, ("r2", "delete"): 1}


def test_each_kind_of_message_is_named():
    told = ("Put", "Declare Subscriber", "Liveliness Token", "Declare Liveliness Subscriber")
    found = Refusals().take_all(line(direct(what)) for what in told)
    assert found.messages == {("r2", what.lower()): 1 for what in told}


def test_what_was_allowed_or_not_passed_on_is_no_refusal():
    found = Refusals()
    for form in (direct, cached):
        found.take(line(form("Put", "authorized")))
        found.take(line(form("Put", flow="egress")))
    assert not found.messages
    assert not found.connections
    assert str(found) == "nothing"


@pytest.mark.parametrize(
    ("said", "cause"),
    [
        ("peer sent no certificates.", "no-certificate"),
        ("invalid peer certificate: BadSignature.", "unknown-authority"),
        ("invalid peer certificate: UnknownIssuer.", "unknown-authority"),
        ("invalid peer certificate: certificate expired: verification time 2 (UNIX)", "expired"),
        ("received corrupt message of type InvalidContentType.", "other"),
    ],
)
def test_a_refused_connection_is_counted_by_cause(said, cause):
    found = Refusals().take_all([line(said, "WARN", "zenoh_link_tls::unicast")] * 2)
    assert found.connections == {cause: 2}
    assert str(found) == f"2 connections: {cause}"


def test_strangers_cannot_make_the_counts_grow_without_bound():
    found = Refusals()
    for number in range(KNOWN_MAX + 100):
        session = f"{number:032x}"
        other = direct("Put").replace(SESSION, session).replace("r2", f"x{number}")
        found.take(line(other))
    assert len(found.messages) == KNOWN_MAX


def test_the_log_is_counted_and_what_is_printed_is_printed():
    script = f"""
import os, sys
from encircle.protocol.zenoh.refusals import LOG, counting_refusals
print("before")
with counting_refusals() as found:
    assert os.environ["RUST_LOG"] == LOG
    print("during")
    os.write(1, {(line(direct("Put")) * 3).encode()!r} + b"\\xff\\n")
print(found)
"""
    done = completed([sys.executable, "-c", script])
    assert done.stdout.splitlines() == ["before", "during", "3 times put by r2"]
    assert done.stderr == ""
