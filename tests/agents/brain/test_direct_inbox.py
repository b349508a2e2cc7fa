"""Direct radio's inbox: what has both arrived and been admitted, in an order of its own."""

from itertools import permutations

from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.agents.brain.direct_inbox import PENDING_MAX, DirectInbox

PEERS = ("r2", "r3")


def packet(sender: str, sequence: int) -> bytes:
    return f"{sender} {sequence}".encode()


def test_with_everything_admitted_what_has_arrived_is_heard_once():
    hearing = DirectInbox(PEERS)
    hearing.add_packet("r3", 0, 0, b"a")
    hearing.admit(None, 1)
    assert hearing.take(1) == (b"a",)
    hearing.admit(None, 2)
    assert hearing.take(2) == ()


def test_a_packet_is_never_heard_at_its_own_tick_nor_forgotten_for_that():
    hearing = DirectInbox(PEERS)
    hearing.add_packet("r2", 5, 7, b"early")
    for tick, heard in ((6, ()), (7, ()), (8, (b"early",))):
        hearing.admit(None, tick)
        assert hearing.take(tick) == heard


def test_all_are_admitted_only_when_it_was_said_since():
    hearing = DirectInbox(PEERS)
    hearing.admit(None, 1)
    hearing.take(1)
    hearing.add_packet("r2", 1, 1, b"a")
    assert hearing.take(2) == ()


def test_arrival_and_admission_may_come_in_either_order():
    hearing = DirectInbox(PEERS)
    hearing.admit([("r2", 0)], 1)
    assert hearing.take(1) == ()
    hearing.add_packet("r2", 0, 0, b"a")
    hearing.add_packet("r2", 1, 1, b"b")
    assert hearing.take(2) == (b"a",)
    hearing.admit([("r2", 1), ("r9", 1)], 3)
    assert hearing.take(3) == (b"b",)


def test_once_packets_are_named_those_sent_before_count_all_the_same_however_late_they_come():
    hearing = DirectInbox(PEERS)
    hearing.admit(None, 5)
    assert hearing.take(5) == ()
    hearing.admit([("r2", 5)], 6)
    hearing.add_packet("r2", 4, 4, b"late")
    hearing.add_packet("r2", 5, 5, b"named")
    hearing.add_packet("r3", 5, 5, b"lost")
    assert hearing.take(6) == (b"late", b"named")
    hearing.add_packet("r3", 4, 4, b"later still")
    assert hearing.take(7) == (b"later still",)
    assert hearing.take(8) == ()


def test_what_is_not_named_does_not_count_though_all_did_a_tick_before():
    hearing = DirectInbox(PEERS)
    for sequence in (4, 5):
        hearing.add_packet("r2", sequence, sequence, packet("r2", sequence))
    # The observation of tick 5 is passed over.
    hearing.admit(None, 5)
    hearing.admit([], 6)
    assert hearing.take(6) == (b"r2 4",)


def test_order_of_arrival_means_nothing():
    packets = [("r3", 4, 2), ("r2", 9, 3), ("r3", 3, 2), ("r2", 1, 2)]
    found = set()
    for order in permutations(packets):
        hearing = DirectInbox(PEERS)
        for sender, sequence, tick in order:
            hearing.add_packet(sender, sequence, tick, packet(sender, sequence))
        hearing.admit(None, 10)
        found.add(hearing.take(10))
    assert found == {(b"r2 1", b"r3 3", b"r3 4", b"r2 9")}


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.sampled_from(PEERS), st.integers(0, 6), st.booleans()), max_size=40))
def test_what_is_heard_is_the_intersection_of_arrived_and_admitted(events):
    hearing = DirectInbox(PEERS)
    arrived, admitted, heard = set(), set(), set()
    for tick, (sender, sequence, is_arrival) in enumerate(events):
        if is_arrival:
            hearing.add_packet(sender, sequence, 0, packet(sender, sequence))
            arrived.add((sender, sequence))
        else:
            hearing.admit([(sender, sequence)], tick + 1)
            admitted.add((sender, sequence))
        heard |= set(hearing.take(tick + 1))
    assert heard == {packet(*name) for name in arrived & admitted}


def test_what_never_fits_together_is_bounded():
    hearing = DirectInbox(PEERS)
    for sequence in range(PENDING_MAX + 10):
        hearing.add_packet("r2", sequence, 0, b"")
        hearing.admit([("r3", sequence)], 1)
    assert len(hearing._arrived["r2"]) == PENDING_MAX
    assert len(hearing._admitted["r3"]) == PENDING_MAX
    # The oldest are gone, the newest are there.
    hearing.admit([("r2", 0), ("r2", PENDING_MAX + 9)], 1)
    assert len(hearing.take(1)) == 1
