"""Whole hunts, in memory, by the policies that negotiate: they capture, the same each time."""

import pytest

import encircle

PERFECT = ()
LOSSY = (
    *("channel.loss.model=burst", "channel.loss.rate=0.5", "channel.loss.burst_packets=5"),
    *("channel.delay.model=exponential", "channel.delay.mean_s=0.2"),
    "channel.duplication.rate=0.2",
)


@pytest.mark.parametrize("channel", [PERFECT, LOSSY])
@pytest.mark.parametrize("policy", ["auction", "hungarian-consensus", "intents"])
def test_a_team_that_negotiates_captures_and_the_run_repeats(policy, channel):
    changes = [f"team.strategy={policy}", "sensing.noise_m_std=0.02", *channel]
    hunts = [encircle.run("sim1", seed=3, link="memory", overrides=changes) for _ in range(2)]
    assert hunts[0].captured
    assert hunts[0].digest == hunts[1].digest
