"""The queue between threads that receive and the one that acts."""

import pytest

from encircle.protocol import mailbox
from encircle.protocol.errors import ConnectionClosed
from encircle.protocol.mailbox import Mailbox, now_us


def keys(found):
    return [key for _, key, _ in found]


def test_messages_come_in_order_with_the_time_at_which_they_were_put():
    mail, before_us = Mailbox(), now_us()
    for k in range(3):
        mail.put(f"k{k}", b"%d" % k)
    found = mail.take(1.0)
    assert keys(found) == ["k0", "k1", "k2"]
    times = [time_us for time_us, _, _ in found]
    assert sorted(times) == times
    assert before_us <= times[0] <= times[-1] <= now_us()


def test_nothing_comes_back_after_the_wait():
    assert Mailbox().take(0.01) == []
    assert Mailbox().take(-1.0) == []


def test_an_end_is_the_last_that_is_taken_at_once():
    mail = Mailbox()
    for key in ("a", "b/end", "c"):
        mail.put(key, b"")
    assert keys(mail.take(0.1)) == ["a", "b/end"]
    assert keys(mail.take(0.1)) == ["c"]


def test_what_came_before_it_was_closed_is_still_there_and_then_it_stays_closed():
    mail = Mailbox()
    mail.put("a", b"")
    mail.close()
    assert keys(mail.take(0.1)) == ["a"]
    for _ in range(2):
        with pytest.raises(ConnectionClosed):
            mail.take(0.1)
        mail.close()


def test_what_finds_no_room_is_dropped_and_counted(monkeypatch):
    monkeypatch.setattr(mailbox, "MAIL_MAX", 5)
    monkeypatch.setattr(mailbox, "TAKEN_MAX", 4)
    mail = Mailbox()
    for k in range(7):
        mail.put(f"k{k}", b"")
    assert mail.dropped == 2
    assert keys(mail.take(0.1)) == ["k0", "k1", "k2", "k3"]
    assert keys(mail.take(0.1)) == ["k4"]
