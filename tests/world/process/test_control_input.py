"""Control lines: bytes to lines however they are cut, and lines to a run and its reports."""

import os
import random

import pytest
from helpers_world import RUN, answers, arena, begun
from hypothesis import given, settings
from hypothesis import strategies as st

from encircle.world.coordinator.world_core import WorldCore
from encircle.world.loading.interventions import LINE_BYTES_MAX, InterventionRefused
from encircle.world.process.control_input import (
    ControlInput,
    ControlLines,
    read_event,
)

LONG = b"x" * (LINE_BYTES_MAX + 1)
LINES = st.lists(st.sampled_from([b"{}", b"", b"  ", b"abc", LONG, LONG * 3, b"\xff\x00"]))


@settings(deadline=None, derandomize=True, max_examples=60)
@given(LINES, st.integers(0, 10**6))
def test_lines_are_the_same_however_they_are_cut(lines, seed):
    data, draws = b"".join(line + b"\n" for line in lines), random.Random(seed)
    cuts = sorted(draws.randint(0, len(data)) for _ in range(5))
    reader, read = ControlLines(), []
    for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True):
        read += reader.feed(data[begin:end])
    expected = [None if len(line) > LINE_BYTES_MAX else line for line in lines if line.strip()]
    assert read == expected


def test_what_never_ends_is_not_kept():
    reader = ControlLines()
    for _ in range(100):
        assert reader.feed(LONG) == []
        assert len(reader._rest) <= LINE_BYTES_MAX
    assert reader.feed(b"\n{}\n") == [None, b"{}"]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (None, "a line of more than 16384 bytes"),
        (b"{", "a line is not JSON"),
        (b"\xff", "a line is not JSON"),
        (b"[" * 10000, "a line is not JSON"),
        (b"[1]", "must be a table with a kind"),
        (b"7", "must be a table with a kind"),
    ],
)
def test_a_line_that_is_no_event_is_refused_with_one_line(line, reason):
    with pytest.raises(InterventionRefused, match=reason) as refused:
        read_event(line)
    assert "\n" not in str(refused.value)


class Access:
    """In place of the lock and the connection: changes are made, and what is sent is kept."""

    def __init__(self):
        self.sent = []

    def change(self, change):
        self.sent += change()


def test_lines_wait_for_the_first_round_and_each_is_reported():
    core, access, reports = WorldCore(arena(), RUN), Access(), []
    control = ControlInput(core, access, reports.append)
    read, write = os.pipe()
    os.write(
        write, b'{"kind": "loss", "rate": 0.5}\n{"kind": "loss", "rate": 2}\nnonsense\n{"kind"'
    )
    assert control.readable(read)
    assert (reports, access.sent) == ([], [])
    begun(core)
    control.begin()
    assert core.arena.scenario.events[0].tick == 1
    loss = {"kind": "loss", "tick": 1, "rate": 0.5}
    assert reports[0] == {"intervention": {"given": 0, "event": loss}}
    assert reports[1] == {"refused_intervention": "intervention.rate = 2: must be at most 1.0"}
    assert "not JSON" in reports[2]["refused_intervention"]
    assert [key for key, _ in access.sent] == [f"encircle/{RUN}/world/intervention"]
    for message in answers(core):
        core.receive(*message)
    os.write(write, b': "heal"}\n')
    assert control.readable(read)
    assert reports[3]["intervention"] == {"given": 1, "event": {"kind": "heal", "tick": 2}}
    os.close(write)
    assert not control.readable(read)
    os.close(read)
