"""Replay of runs by the clock: the same decisions from the record, and what cannot be told."""

from dataclasses import replace

import pytest
from helpers_networks import delays_us, lossier
from helpers_real_time import RUN, Simulated, by_clock

from encircle.protocol.codec import decode, encode
from encircle.protocol.messages import Command
from encircle.replay.replaying import replay
from encircle.runlog.recorded_log import log_of_recording
from encircle.world.network.transport import links_of
from encircle.world.recording.recorder import Recorder
from encircle.world.recording.recording import RecordingError, read_recording

CHANNEL = (
    'channel.loss={model="bernoulli",rate=0.3}',
    'channel.delay={model="exponential",mean_s=0.05}',
    "channel.duplication.rate=0.2",
)


@pytest.mark.parametrize("radio", ["world", "direct"])
@pytest.mark.parametrize("channel", [(), CHANNEL])
def test_fresh_brains_decide_the_same(tmp_path, radio, channel):
    Simulated(by_clock(f"radio={radio}", *channel), delays_us, out=tmp_path).run()
    found = replay(tmp_path)
    assert found.same
    assert found.unchecked == ()
    # A command and a pose of each robot at every tick but those that were on their way at the end.
    assert 8 * 98 <= found.compared <= 8 * 100


@pytest.mark.parametrize("radio", ["world", "direct"])
def test_observations_passed_over_and_late_commands_are_no_trouble(tmp_path, radio):
    frozen = {"r2": (300_000, 700_000), "r3": (500_000, 1_200_000)}
    Simulated(by_clock(f"radio={radio}", *CHANNEL), delays_us, frozen_us=frozen, out=tmp_path).run()
    found = replay(tmp_path)
    assert found.same
    assert found.unchecked == ()
    # Twenty ticks of r2 and thirty-five of r3 have gone by without a command.
    assert 8 * 100 - 2 * 60 <= found.compared <= 8 * 100 - 2 * 50


@pytest.mark.parametrize("radio", ["world", "direct"])
def test_a_robot_that_is_lost_and_back_begins_anew(tmp_path, radio):
    crash = 'events=[{kind="crash",robot="r3",tick=20,ticks=30}]'
    played = Simulated(by_clock(f"radio={radio}", crash), delays_us, out=tmp_path)
    result = played.run().rounds.result()
    assert [(tick, robot) for tick, robot, _ in result.departures] == [(20, "r3"), (50, "r3")]
    found = replay(tmp_path)
    assert found.same
    assert found.unchecked == ()
    assert 8 * 98 - 2 * 31 <= found.compared <= 8 * 100 - 2 * 30
    # The gap in its numbering is no loss: nobody was there to send.
    links = links_of(played.world.ledger)
    assert all(link.lost == 0 for link in links)


def test_lost_observations_are_no_trouble_while_it_is_known_which(tmp_path):
    def losing(sender, receiver, channel, number):
        lost = channel == "observation" and receiver == "r1" and 20 <= number < 23
        return None if lost else delays_us(sender, receiver, channel, number)

    Simulated(by_clock("radio=direct"), losing, out=tmp_path).run()
    found = replay(tmp_path)
    assert found.same
    assert found.unchecked == ()


def test_what_cannot_be_put_together_is_said_and_the_rest_checked(tmp_path):
    def losing(sender, receiver, channel, number):
        lost = (sender, receiver, channel, number) in {
            ("r1", "world", "command", 40),
            ("r2", "world", "pose", 30),
        }
        return None if lost else delays_us(sender, receiver, channel, number)

    Simulated(by_clock("radio=direct"), losing, out=tmp_path).run()
    found = replay(tmp_path)
    assert found.same
    # The others have heard a packet of r2 that the world has not.
    assert len(found.unchecked) == 3
    assert all("packet 30 of r2" in reason for reason in found.unchecked)
    assert {reason.split(":")[0] for reason in found.unchecked} == {"r1", "r3", "r4"}


@pytest.mark.parametrize("frozen_us", [{}, {"r1": (700_000, 860_000)}])
def test_lost_commands_and_observations_are_no_trouble(tmp_path, frozen_us):
    def losing(sender, receiver, channel, number):
        lost = channel in ("command", "observation") and "r1" in (sender, receiver)
        lost = lost and number % 7 in (3, 4)
        return None if lost else delays_us(sender, receiver, channel, number)

    Simulated(by_clock(*CHANNEL), losing, frozen_us=frozen_us, out=tmp_path).run()
    found = replay(tmp_path)
    assert found.same
    assert found.unchecked == ()


def test_a_command_of_which_none_tells_is_not_checked(tmp_path, monkeypatch):
    """More is heard than commands have room for, and the run ends."""
    monkeypatch.setattr("encircle.agents.brain.unacknowledged.RECEIPTS_MAX", 2)
    Simulated(by_clock("radio=direct"), delays_us, out=tmp_path).run()
    found = replay(tmp_path)
    assert found.differences == ()
    assert len(found.unchecked) == 4
    assert "what it had at tick" in found.unchecked[0]


def test_a_bad_network_leads_to_gaps_and_not_to_false_differences(tmp_path):
    Simulated(by_clock("radio=direct"), lossier, out=tmp_path).run()
    found = replay(tmp_path)
    assert found.differences == ()
    assert len(found.unchecked) == 4


def test_a_command_that_was_tampered_with_is_found(tmp_path):
    Simulated(by_clock("radio=direct"), delays_us, out=tmp_path / "run").run()
    recording = read_recording(tmp_path / "run")
    copy = Recorder(tmp_path / "copy.mcap", 0.02, metadata_of(tmp_path / "run"))
    for (tick, topic, payload), at_us in zip(recording.messages, recording.logged_us, strict=True):
        changed = payload
        if (tick, topic) == (50, "robots/r3/command"):
            command = decode(Command, payload, RUN)
            changed = encode(replace(command, step=(command.step[0] + 2.0**-20, 0.0)), RUN)
        copy.record(tick, f"encircle/{RUN}/{topic}", changed, at_us)
    copy.close()
    assert replay(tmp_path / "copy.mcap").differences == ((50, "r3", "command"),)


def metadata_of(path):
    from mcap.reader import make_reader

    with open(path / "recording.mcap", "rb") as file:
        [metadata] = make_reader(file).iter_metadata()
    return metadata.metadata


def test_measures_of_a_run_by_the_clock_are_refused_in_one_line(tmp_path):
    Simulated(by_clock("ticks_max=5"), delays_us, out=tmp_path).run()
    with pytest.raises(RecordingError, match="clock = 'wall'") as refused:
        log_of_recording(read_recording(tmp_path))
    assert "\n" not in str(refused.value)
