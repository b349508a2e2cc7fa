"""A queue between one that must not wait and one that may be slow."""

import threading

from helpers_waiting import joined

from encircle.live.inbox import Inbox


def test_what_is_put_in_comes_out_in_order_and_at_once():
    inbox = Inbox(len)
    for item in (b"a", b"bb", b""):
        inbox.put(item)
    assert inbox.take(0.0) == [b"a", b"bb", b""]
    assert inbox.take(0.0) == []
    assert inbox.overflows == 0


def test_what_is_too_much_goes_as_a_whole_and_the_next_is_kept():
    by_count = Inbox(len, items_max=10)
    by_bytes = Inbox(len, bytes_max=100)
    for number in range(25):
        by_count.put(b"%d" % number)
        by_bytes.put(bytes(10))
    assert by_count.take(0.0) == [b"%d" % number for number in range(20, 25)]
    assert (by_count.overflows, by_bytes.overflows) == (2, 2)
    assert len(by_bytes.take(0.0)) == 5


def test_who_waits_is_woken_by_an_item_and_by_the_end():
    inbox, found = Inbox(len), []
    waiting = threading.Thread(target=lambda: found.append(inbox.take(3600.0)))
    waiting.start()
    inbox.put(b"x")
    joined(waiting)
    waiting = threading.Thread(target=lambda: found.append(inbox.take(3600.0)))
    waiting.start()
    inbox.close()
    joined(waiting)
    inbox.put(b"too late")
    assert found == [[b"x"], []]
    assert inbox.take(0.0) == []
