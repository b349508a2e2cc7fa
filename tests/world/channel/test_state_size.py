"""What the channel remembers: arrays of a stated size, however long a run is."""

import numpy as np
import pytest

from encircle.world.channel import channel
from encircle.world.loading.load import load

ALL_STAGES = {
    "loss": {"model": "gilbert-elliott", "good_to_bad": 0.1, "bad_to_good": 0.3},
    "delay": {"model": "uniform", "low_s": 0.0, "high_s": 0.6},
    "order": "kept",
    "duplication": {"rate": 0.2},
    "rate_limit": {"packets_per_s": 9.0, "queue_packets_max": 5},
}
DELAYED_TICKS_MAX, WAITING_TICKS_MAX = 6, 7
"""Of the uniform delay, and of a queue of six packets at 0.9 a tick."""


def bytes_in(value):
    """Bytes of all arrays in a value made of tuples and maps."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, dict):
        return sum(bytes_in(part) for part in value.values())
    return sum(bytes_in(part) for part in value) if isinstance(value, tuple) else 0


@pytest.mark.parametrize("robots", [8, 64])
def test_a_link_takes_bytes_that_follow_from_the_longest_delay_and_not_from_the_run(robots):
    team = {"robots": robots, "placement": {"distance_m_max": 60.0}}
    scenario = load({"team": team, "channel": ALL_STAGES})
    radio = channel.build(scenario, 1)
    state, sizes = channel.initial(radio), np.full(robots, 100)
    for tick in range(120):
        state, _ = channel.deliver(state, tick)
        state, _ = channel.transmit(radio, state, channel.Sending(tick, sizes, None, None))
        longest = DELAYED_TICKS_MAX + WAITING_TICKS_MAX
        # One byte a link for each pair of a tick that sent and a later one that receives, twice as
        # packets and copies fly apart; one for the chain; eight for the order.
        flights = 2 * longest * (longest + 1) // 2
        assert bytes_in(state) <= robots**2 * (flights + 1 + 8) + robots * 6 * 8
