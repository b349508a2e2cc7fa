"""A flood of garbage and of oversized messages, on every key, by one who is allowed to connect.

It goes through a router, which passes on what the longest message of the protocol may take. Seeded,
bounded in count. The run goes on to the same digest, what was refused stands in
its result and in its recording, and memory stays within a bound over that of a run left in peace.
Nothing in the flood is a message that is to be believed; ``docs/security.md`` has the figures.
"""

import itertools
import json
import os
import random
import signal
import struct
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path

import msgpack
import pytest
from helpers_commands import ours, process_of
from helpers_hunt import LONG
from helpers_messages import GOLDEN
from helpers_security import ROBOTS
from helpers_waiting import LONGEST_S, until
from zenoh import CongestionControl

import encircle
from encircle.network.certificates import make_certificates
from encircle.protocol import VERSION
from encircle.protocol.codec import BYTES_MAX, encode
from encircle.protocol.keys import ROBOT_CHANNELS, WORLD_CHANNELS, robot_key, world_key
from encircle.protocol.messages import Command, Observation, Pose, Setup
from encircle.protocol.zenoh.access_control import identity_in
from encircle.protocol.zenoh.connection import ZenohConnection
from encircle.protocol.zenoh.endpoints import Endpoints
from encircle.runner.launch import free_endpoint
from encircle.world.__main__ import TAKEN_BYTES_MAX
from encircle.world.recording.recording import read_recording

RUN = "flooded"
TICKS = 800
SCENARIO = LONG | {"ticks_max": TICKS}
SMALL, LARGE_EVERY, DELETE_EVERY, LOOK_EVERY = 20_000, 200, 100, 250
GROWTH_MIB_MAX = 64
KEYS = (
    *(robot_key(RUN, r, c) for r in (*ROBOTS, "r9", "*") for c in (*ROBOT_CHANNELS, "junk", "*")),
    *(world_key(RUN, channel) for channel in (*WORLD_CHANNELS, "junk")),
)
"""Every key of the run, keys that it does not have, and whole sets of them at once."""


class Hunt:
    """A hunt as processes that is recorded, and the most memory that each has taken so far.

    ``certificates``: the directory that has everybody's, None without.
    """

    def __init__(self, folder: Path, closing: ExitStack, certificates: Path | None = None) -> None:
        folder.mkdir()
        self.endpoint, self.out, self._said = free_endpoint(), folder / "run", folder / "said"
        own = () if certificates is None else ("--certificates", certificates)
        if own:
            self.endpoint = self.endpoint.replace("tcp/", "tls/")
        self.peaks_mib: dict[str, float] = {}
        scenario = folder / "scenario.json"
        scenario.write_text(json.dumps(SCENARIO))
        where = ("--connect", self.endpoint, "--run", RUN, *own)
        commands = {
            "router": (
                "encircle.protocol.programs.router",
                "--listen",
                self.endpoint,
                "--for-run",
                RUN,
                *own,
            ),
            "world": ("world", scenario, "--json", *where, "--out", self.out),
            **{robot: ("agents", robot, *where) for robot in ROBOTS},
        }
        with self._said.open("wb") as said, open(os.devnull, "r+b") as nothing:
            self._processes = {
                name: process_of(
                    ours(*command),
                    (nothing, said if name == "world" else nothing, nothing),
                    os.environ,
                )
                for name, command in commands.items()
            }
        for process in self._processes.values():
            closing.callback(process.wait)
            closing.callback(process.kill)

    def reports(self):
        """What the world has said, whole lines only."""
        return [json.loads(line) for line in self._said.read_text().split("\n")[:-1]]

    def tick(self):
        return max((report.get("tick", -1) for report in self.reports()), default=-1)

    def freeze(self):
        """Have the lock-step hunt wait for a robot."""
        self._processes[ROBOTS[-1]].send_signal(signal.SIGSTOP)

    def thaw(self):
        self._processes[ROBOTS[-1]].send_signal(signal.SIGCONT)

    def look(self):
        """Note the memory taken; whether all have ended."""
        for name, process in self._processes.items():
            lines = []
            with suppress(OSError):  # it has ended, and its starter does not know of it yet
                lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
            for line in lines:
                if line.startswith("VmHWM:"):
                    self.peaks_mib[name] = int(line.split()[1]) / 1024
        return all(process.poll() is not None for process in self._processes.values())

    def end(self):
        until(self.look, "the hunt's end", self.tick)
        assert {p.returncode for p in self._processes.values()} == {0}, self.reports()[-1]
        return self.reports()[-1]["result"]


def small(draws):
    """Garbage of every make: never a valid message of this run at its turn."""
    valid = [bytes.fromhex(hexadecimal) for hexadecimal in GOLDEN.values()]
    robot = draws.choice(ROBOTS)
    late = 10 * TICKS
    misplaced = [
        Pose(robot, late, late, (0.0, 0.0), (0.0, 0.0), None, "search", None, None),
        Command(robot, late, (9.0, 9.0), "search", None, None, None, None, None, ()),
        Observation(robot, late, (0.0, 0.0), 0.0, None, (6.0,) * 24, (), (b"\xc1", b"")),
        Setup(robot, ROBOTS, 0.1, "of-another-make", {}),
    ]
    damaged = bytearray(draws.choice(valid))
    for _ in range(draws.randint(0, 3)):
        damaged[draws.randrange(len(damaged))] ^= 1 << draws.randrange(8)
    return draws.choice(
        (
            b"",
            draws.randbytes(draws.randrange(300)),
            bytes(damaged),
            draws.choice(valid)[: draws.randrange(100)] + draws.choice(valid),
            encode(draws.choice(misplaced), RUN),
            b"\x91" * draws.randrange(1, 6000),
            b"\xdf\xff\xff\xff\xff" + draws.randbytes(20),
            msgpack.packb({"v": VERSION, "run": RUN, draws.choice(("robot", "tick", "x")): 1}),
        )
    )


def large(draws):
    """What is longer than allowed, and what is not but takes long to look at."""
    limit = draws.choice(list(BYTES_MAX.values()))
    count = BYTES_MAX[Observation] - 5
    element = draws.choice((b"\x01", b"\x80", b"\x91", b"\xc4\x00"))
    return draws.choice(
        (
            bytes(limit + 1),
            draws.randbytes(limit),
            encode(Setup("r1", ROBOTS, 0.1, "x", {"x": "y" * 60_000}), RUN) + bytes(limit),
            b"\xdd" + struct.pack(">I", count) + (element * count)[:count],
            bytes(5 * 2**20),
        )
    )


def flood(hunt, identity=None):
    """Send all of it while the hunt goes on; how many on each key the world has to look at.

    ``identity``: whose certificate to show.
    """
    draws = random.Random(20)
    access = Endpoints(connect=(hunt.endpoint,), identity=identity)
    link = ZenohConnection(access, robot_key(RUN, "nobody", "*"))
    sent, keys = 0, Counter()
    # However slowly this process gets to send, the hunt does not end before a part of the flood.
    hunt.freeze()
    try:
        for key in itertools.cycle(KEYS):
            link.session.put(key, small(draws), congestion_control=CongestionControl.BLOCK)
            keys[key] += 1
            if sent % LARGE_EVERY == 0:
                other = draws.choice(KEYS)
                payload = large(draws)
                link.send(other, payload)
                # Zenoh's limit is on what a message takes with its key and header.
                keys[other] += len(payload) < TAKEN_BYTES_MAX - 1024
            if sent % DELETE_EVERY == 0:
                link.session.delete(key, congestion_control=CongestionControl.BLOCK)
                keys[key] += 1
            sent += 1
            if sent == SMALL // 4:
                hunt.thaw()
            over = sent % LOOK_EVERY == 0 and hunt.look()
            if over or sent == SMALL:
                # To close before that would lose the end.
                link.flush(world_key(RUN, "about"), LONGEST_S)
                return keys
    finally:
        link.close()


@pytest.fixture
def closing():
    with ExitStack() as stack:
        yield stack


def test_a_flood_on_every_key_changes_nothing_and_takes_bounded_memory(tmp_path, closing):
    expected = encircle.run(SCENARIO, link="memory").digest
    peaceful = Hunt(tmp_path / "peaceful", closing)
    result = peaceful.end()
    assert (result["digest"], result["refused"]) == (expected, {})

    flooded = Hunt(tmp_path / "flooded", closing)
    until(lambda: flooded.tick() >= 0, "the hunt's begin")
    keys, tick = flood(flooded), flooded.tick()
    result = flooded.end()
    print(f"{keys.total()} messages until tick {tick}; refused by the world: {result['refused']}")
    print(f"peaks in MiB: {peaceful.peaks_mib}, flooded {flooded.peaks_mib}")
    assert result["digest"] == expected
    assert keys.total() >= SMALL // 4
    due = sum(number for key, number in keys.items() if "/robots/" in key)
    refused = sum(result["refused"].values())
    # The router drops what the world does not take fast enough, and the hunt may end before the
    # flood does.
    # The robot that was frozen may have answered twice, as it was asked twice: out of turn.
    in_turn = refused - result["refused"]["out-of-turn"]
    assert 0 < in_turn <= due, (refused, in_turn, due, tick)
    for cause in ("malformed", "oversized", "out-of-turn", "wrong-run", "unknown-key"):
        assert result["refused"][cause] > 0

    counts = {}
    for _, key, payload in read_recording(flooded.out).messages:
        if key.endswith("/command"):
            counts[key.split("/")[-2]] = msgpack.unpackb(payload)["refused"]
    for robot in ROBOTS:
        assert sum(counts[robot].values()) > 100
        assert {"malformed", "oversized", "out-of-turn"} <= set(counts[robot])
    for name, peak in flooded.peaks_mib.items():
        assert peak < peaceful.peaks_mib[name] + GROWTH_MIB_MAX


def test_a_flood_by_one_who_has_a_certificate_is_one_on_its_own_keys(tmp_path, closing):
    lab = make_certificates(tmp_path / "lab", len(ROBOTS)).directory
    peaceful = Hunt(tmp_path / "peaceful", closing, lab)
    result = peaceful.end()
    expected = result["digest"]
    assert result["refused"] == {}

    flooded = Hunt(tmp_path / "flooded", closing, lab)
    until(lambda: flooded.tick() >= 0, "the hunt's begin")
    keys = flood(flooded, identity_in(lab, "r1"))
    result = flooded.end()
    print(f"{keys.total()} messages; refused by the world: {result['refused']}")
    print(f"peaks in MiB: {peaceful.peaks_mib}, flooded {flooded.peaks_mib}")
    assert result["digest"] == expected
    due = sum(keys[robot_key(RUN, "r1", channel)] for channel in ("pose", "command"))
    refused = result["refused"]
    assert 0 < sum(refused.values()) - refused["out-of-turn"] <= due
    for name, peak in flooded.peaks_mib.items():
        assert peak < peaceful.peaks_mib[name] + GROWTH_MIB_MAX
