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
    hearing.admit(None)
    assert hearing.take(1) == (b"a",)
    hearing.admit(None)
    assert hearing.take(2) == ()


def test_a_packet_is_never_heard_at_its_own_tick_nor_forgotten_for_that():
    hearing = DirectInbox(PEERS)
    hearing.add_packet("r2", 5, 7, b"early")
    for tick, heard in ((6, ()), (7, ()), (8, (b"early",))):
        hearing.admit(None)
        assert hearing.take(tick) == heard


def test_all_are_admitted_only_when_it_was_said_since():
    hearing = DirectInbox(PEERS)
    hearing.admit(None)
    hearing.take(1)
    hearing.add_packet("r2", 1, 1, b"a")
    assert hearing.take(2) == ()


def test_arrival_and_admission_may_come_in_either_order():
    hearing = DirectInbox(PEERS)
    hearing.admit([("r2", 0)])
    assert hearing.take(1) == ()
    hearing.add_packet("r2", 0, 0, b"a")
    hearing.add_packet("r2", 1, 1, b"b")
    assert hearing.take(2) == (b"a",)
    hearing.admit([("r2", 1), ("r9", 1)])
    assert hearing.take(3) == (b"b",)


def test_order_of_arrival_means_nothing():
    packets = [("r3", 4, 2), ("r2", 9, 3), ("r3", 3, 2), ("r2", 1, 2)]
    found = set()
    for order in permutations(packets):
        hearing = DirectInbox(PEERS)
        for sender, sequence, tick in order:
            hearing.add_packet(sender, sequence, tick, packet(sender, sequence))
        hearing.admit(None)
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
            hearing.admit([(sender, sequence)])
            admitted.add((sender, sequence))
        heard |= set(hearing.take(tick + 1))
    assert heard == {packet(*name) for name in arrived & admitted}


def test_what_never_fits_together_is_bounded():
    hearing = DirectInbox(PEERS)
    for sequence in range(PENDING_MAX + 10):
        hearing.add_packet("r2", sequence, 0, b"")
        hearing.admit([("r3", sequence)])
    assert len(hearing._arrived["r2"]) == PENDING_MAX
    assert len(hearing._admitted["r3"]) == PENDING_MAX
    # The oldest are gone, the newest are there.
    hearing.admit([("r2", 0), ("r2", PENDING_MAX + 9)])
    assert len(hearing.take(1)) == 1
