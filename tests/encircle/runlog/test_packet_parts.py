"""Bytes of a packet by what they are for: against lengths of packets with and without each part."""

from dataclasses import replace

import msgpack
import numpy as np
import pytest

from encircle.measures.registry import measure
from encircle.protocol.codec import encode
from encircle.protocol.messages import Pose
from encircle.protocol.plugin_files import FOLDERS
from encircle.runlog.packet_parts import ESTIMATE, NO_PARTS, PAYLOAD, RELAYED, parts_bytes
from encircle.runlog.recorded_log import log_of_messages
from encircle.runlog.runlog import RunLogCollector
from encircle.runner.memory import run_in_memory
from encircle.world.arena.engine import build
from encircle.world.loading.load import load

NAME = "tested"

POSE = Pose("r1", 7, 7, (1.0, 2.0), (0.1, 0.2), (3.0, 4.0), "encircle", 1.0, 2)
SAY = {"bids": [0.5, 1.5, None], "round": 3}
SEEN = (("r2", 5, 1.25, 2.5), ("r3", 6, 1.0, 2.0))
TALK = """
from encircle.agents.policies.paper import xi_star


def talk(memory, view):
    memory, decision = xi_star(memory, view)
    said = {"tick": view.tick} if view.tick % 2 else None
    return memory, decision._replace(say=said)
"""


def hunted(*changes):
    """The messages and the log of a hunt under loss."""
    loss = "channel.loss={model='bernoulli', rate=0.3}"
    scenario, messages, collector = load("sim1", [loss, *changes]), [], RunLogCollector()

    def record(*message):
        messages.append(message)

    run_in_memory(build(scenario, 2), NAME, print, record, observer=collector)
    return messages, collector.log()


def size(pose):
    return len(encode(pose, NAME))


def test_a_part_takes_what_the_packet_is_longer_for_it():
    both = replace(POSE, say=SAY, relayed=SEEN)
    parts = parts_bytes(encode(both, NAME))
    assert parts[PAYLOAD] == size(both) - size(replace(both, say={}))
    # The name of the field and an empty list are there without relayed detections too.
    assert parts[RELAYED] == size(both) - size(replace(both, relayed=())) + len(b"\xa7relayed\x90")
    assert parts[ESTIMATE] == 0


def test_a_packet_without_such_parts_is_all_pose():
    assert parts_bytes(encode(POSE, NAME)) == NO_PARTS == (0, 0, 0)


def test_each_part_is_told_apart_however_its_sender_packs_it():
    fields = {"robot": "r1", "estimate": [1.0, 2.0], "say": {"say": "estimate"}, "relayed": []}
    for options in ({}, {"use_single_float": True}):
        packer = msgpack.Packer(**options)
        sizes = {
            name: len(packer.pack(name) + packer.pack(value)) for name, value in fields.items()
        }
        assert parts_bytes(packer.pack(fields)) == (sizes["say"], 0, sizes["estimate"])
    # Texts and maps in their longest forms, as another language's library may pack them.
    say = b"\xdb\x00\x00\x00\x03say" + b"\xdf\x00\x00\x00\x01\xd9\x01k\x05"
    assert parts_bytes(b"\xde\x00\x02" + say + b"\xa1v\x04") == (len(say), 0, 0)


@pytest.mark.parametrize("changes", [[], ["robot.detections=relay"], ["robot.detections=fuse"]])
def test_bytes_of_a_hunt_by_kind_add_up(tmp_path, monkeypatch, changes):
    monkeypatch.setenv(FOLDERS, str(tmp_path))
    (tmp_path / "talk.py").write_text(TALK, encoding="utf-8")
    changes = ["ticks_max=20", *changes]
    messages, log = hunted(*changes, "team.strategy=talk.py:talk")
    _, mute = hunted(*changes)
    recorded = log_of_messages(log.scenario, 2, NAME, messages)
    assert recorded.parts_bytes.tolist() == log.parts_bytes.tolist()
    names = [f"sent_bytes_{kind}" for kind in ("pose", "payload", "relayed", "estimate")]
    found, without = measure(log, ["sent_bytes", *names]), measure(mute, ["sent_bytes", *names])
    assert found["sent_bytes"] == sum(found[name] for name in names)
    # Half of the ticks, in which it says its tick, which is a number below 128.
    said_bytes = len(b"\xa3say\x81\xa4tick\x01")
    assert found["sent_bytes_payload"] == 4 * np.ceil((log.ticks - 1) / 2) * said_bytes
    assert found["sent_bytes"] - found["sent_bytes_payload"] == without["sent_bytes"]
    assert without["sent_bytes_payload"] == 0.0
    for kind, detections in (("relayed", "relay"), ("estimate", "fuse")):
        part_bytes = found[f"sent_bytes_{kind}"]
        assert (part_bytes > 0.0) == (f"robot.detections={detections}" in changes)
        assert part_bytes == without[f"sent_bytes_{kind}"]


def counted(packet):
    """What the parts take: the length of a map of that part alone, without its head."""
    body = msgpack.unpackb(packet, use_list=False)
    return tuple(
        len(msgpack.packb({name: body[name]})) - 1 if body.get(name) else 0
        for name in ("say", "relayed", "estimate")
    )


TEXTS = ["say", "relayed", "estimate", "relayed \u0410", "hearsay", ""]


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("relayed", [None, (), ("r2",), (("say", 1),)])
@pytest.mark.parametrize("say", [None, {}, {"relayed": ()}, {"estimate": 1}])
def test_names_of_parts_elsewhere_in_a_packet_mislead_nobody(text, relayed, say):
    body = {"mode": text, "relayed": relayed, "say": say, "last": text}
    for left_out in ((), ("relayed",), ("say",), ("relayed", "say")):
        packet = msgpack.packb({k: v for k, v in body.items() if k not in left_out})
        assert parts_bytes(packet) == counted(packet)
