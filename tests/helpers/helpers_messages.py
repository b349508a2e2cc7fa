"""A message of each kind, and its bytes."""

from typing import Any

from encircle.protocol.codec import Message
from encircle.protocol.messages import (
    Command,
    End,
    Intervention,
    Observation,
    Pose,
    Radio,
    Setup,
    State,
)
from encircle.protocol.wire.declaration import declared_fields
from encircle.protocol.wire.payload import FrozenMap

SAMPLES: dict[type[Any], Message] = {
    Setup: Setup(
        *("r1", ("r1", "r2"), 0.1, "xi-star", {"window_ticks": 30, "xi_grid": (0.0, 1.0)}),
        *("direct", 5, 300, {"rebid": 5}, "ab"),
    ),
    Observation: Observation(
        *(
            "r1",
            7,
            (1.0, -2.5),
            0.5,
            None,
            (6.0, *(0.25,) * 7),
            (("r2", 3.0, 4.0),),
            (b"\x01\x02",),
        ),
        *(("r3",), 1_700_000_000_000_000, (("r2", 6),), 5),
    ),
    Pose: Pose(
        *("r2", 3, 3, (1.0, 2.0), (0.0, -1.5), (4.0, 0.5), "encircle", 2.0, 1),
        relayed=(("r1", 2, 4.0, 0.25), ("r3", 1, 5.0, 0.0)),
        sent_us=1_700_000_000_000_000,
        say=FrozenMap({"bid": 1.5}),
    ),
    Command: Command(
        "r1",
        7,
        (0.25, 0.0),
        "search",
        None,
        None,
        (1.0, 2.0),
        None,
        None,
        ("r1",),
        False,
        {"malformed": 2},
        (1_700_000_000_000_000, 70_000, (("r2", 3, 5),)),
    ),
    End: End("r1", 9, "captured"),
    State: State(5, ((0.0, 1.0),), (0.5,), (2.0, 3.0), False, (("r1", "target"),)),
    Radio: Radio(4, ((0, 5), (-2, 0)), ((0, 7), (0, 0))),
    Intervention: Intervention(6, {"kind": "loss", "tick": 7, "rate": 0.5}),
}


def sent_names(message: Message) -> list[str]:
    """The fields that are sent: not those that may be left out and have their defaults."""
    return [
        field.name
        for field in declared_fields(type(message))
        if not field.may_be_left_out or getattr(message, field.name) != field.default
    ]


# Each line of hex is a field: its name, then its value. The first is the map's size, v and run.
GOLDEN = {
    Setup: """
        8c a176 04 a372756e a26731 a5726f626f74 a27231 a47465616d 92a27231a27232
        a67469636b5f73 cb3fb999999999999a a87374726174656779 a778692d73746172
        aa706172616d6574657273 82 ac77696e646f775f7469636b73 1e
        a778695f67726964 92cb0000000000000000cb3ff0000000000000 a5726164696f a6646972656374
        aa66697273745f7469636b 05 ab616e737765725f7469636b cd012c
        b1706f6c6963795f706172616d6574657273 81 a57265626964 05
        ad706f6c6963795f736f75726365 a26162""",
    Observation: """
        8e a176 04 a372756e a26731 a5726f626f74 a27231 a47469636b 07
        a8706f736974696f6e 92cb3ff0000000000000cbc004000000000000
        ab68656164696e675f726164 cb3fe0000000000000 a6746172676574 c0
        a47363616e 98cb4018000000000000
        cb3fd0000000000000cb3fd0000000000000cb3fd0000000000000cb3fd0000000000000
        cb3fd0000000000000cb3fd0000000000000cb3fd0000000000000
        a47365656e 9193a27232cb4008000000000000cb4010000000000000 a5696e626f78 91c4020102
        a46c6f7374 91a27233 a773656e745f7573 cf00060a24181e4000
        a861646d6974746564 9192a2723206 a8616e737765726564 05""",
    Pose: """
        8e a176 04 a372756e a26731 a5726f626f74 a27232 a47469636b 03 a873657175656e6365 03
        a8706f736974696f6e 92cb3ff0000000000000cb4000000000000000
        a876656c6f63697479 92cb0000000000000000cbbff8000000000000
        a9646574656374696f6e 92cb4010000000000000cb3fe0000000000000
        a46d6f6465 a8656e636972636c65 a27869 cb4000000000000000 a5706f696e74 01
        a772656c61796564 92 94a2723102cb4010000000000000cb3fd0000000000000
        94a2723301cb4014000000000000cb0000000000000000
        a773656e745f7573 cf00060a24181e4000
        a3736179 81 a3626964 cb3ff8000000000000""",
    Command: """
        8f a176 04 a372756e a26731 a5726f626f74 a27231 a47469636b 07
        a473746570 92cb3fd0000000000000cb0000000000000000
        a46d6f6465 a6736561726368 a27869 c0 a5706f696e74 c0
        a4676f616c 92cb3ff0000000000000cb4000000000000000 a8657374696d617465 c0
        a9707265646963746f72 c0 a47465616d 91a27231
        a97075626c6973686564 c2 a772656675736564 81a96d616c666f726d656402
        a674696d696e67 93cf00060a24181e4000ce00011170 91 93a272320305""",
    End: """
        85 a176 04 a372756e a26731 a5726f626f74 a27231 a47469636b 09
        a6726561736f6e a86361707475726564""",
    State: """
        88 a176 04 a372756e a26731 a47469636b 05
        a6726f626f7473 9192cb0000000000000000cb3ff0000000000000
        ac68656164696e67735f726164 91cb3fe0000000000000
        a6746172676574 92cb4000000000000000cb4008000000000000 a86361707475726564 c2
        a8636f6e7461637473 9192a27231a6746172676574""",
    Radio: """
        85 a176 04 a372756e a26731 a47469636b 04 a56661746573 92920005 92fe00
        a6636f70696573 92920007 920000""",
    Intervention: """
        84 a176 04 a372756e a26731 a47469636b 06
        a56576656e74 83 a46b696e64 a46c6f7373 a47469636b 07 a472617465 cb3fe0000000000000""",
}
