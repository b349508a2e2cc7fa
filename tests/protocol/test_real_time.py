"""Receipts and times of commands: named here, plain lists on the wire."""

import msgpack
import pytest

from encircle.protocol.codec import decode, encode
from encircle.protocol.messages import Command
from encircle.protocol.real_time import Receipt, ReceiptKind, Timing

RECEIPTS = (
    Receipt("r2", 3, 5),
    Receipt.of_observation(ReceiptKind.PASSED_OVER, 6, 7),
    Receipt.of_observation(ReceiptKind.ANSWERED, 7, 8),
)
COMMAND = Command(
    *("r1", 7, (0.0, 0.0), "search", None, None, None, None, None, ()),
    timing=Timing(8, 9, RECEIPTS),
)


def test_a_timing_is_a_list_on_the_wire_and_has_its_names_again_when_decoded():
    payload = encode(COMMAND, "g1")
    assert msgpack.unpackb(payload)["timing"] == [
        *(8, 9),
        [["r2", 3, 5], ["passed-over", 6, 7], ["world", 7, 8]],
    ]
    timing = decode(Command, payload, "g1").timing
    assert timing == COMMAND.timing
    assert (type(timing), {type(receipt) for receipt in timing.receipts}) == (Timing, {Receipt})
    assert timing.sent_us == 9
    assert timing.receipts[0].arrival_us == 5


@pytest.mark.parametrize(
    ("receipt", "kind"),
    [
        (RECEIPTS[0], ReceiptKind.PACKET),
        (RECEIPTS[1], ReceiptKind.PASSED_OVER),
        (RECEIPTS[2], ReceiptKind.ANSWERED),
    ],
)
def test_a_receipt_says_what_it_is_for(receipt, kind):
    assert receipt.kind is kind
