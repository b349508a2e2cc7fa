"""What the tests of the radio's stages share: channels and what becomes of packets on them."""

from typing import Any

import numpy as np
from helpers_world import small
from hypothesis import settings
from hypothesis import strategies as st

from encircle.world.channel import channel as radio

ALPHA = 1e-6


def channel(*overrides: str, robots: int = 4, seed: int = 1, **sections: Any) -> radio.Channel:
    return radio.build(small(*overrides, team={"robots": robots}, **sections), seed)


class Flown:
    """What came of the packets of T ticks: ``due`` and ``copies``, (T, N, N), and deliveries.

    ``delivered``: per tick what arrives at it, as (sent tick, sender, receiver), in order.
    """

    def __init__(self, chan: radio.Channel, ticks: int, **sent: Any) -> None:
        """``sent``: further fields of ``Sending``, each a function of the tick or constant."""
        state, due, copies = radio.initial(chan), [], []
        self.delivered: list[list[tuple[int, int, int]]] = []
        for tick in range(ticks):
            state, arrived = radio.deliver(state, tick)
            self.delivered.append(
                [(f.sent_tick, s, r) for f in arrived for s, r in np.argwhere(f.links).tolist()]
            )
            now = {name: what(tick) if callable(what) else what for name, what in sent.items()}
            state, fates = radio.transmit(chan, state, radio.Sending(tick, **now))
            due.append(fates.due)
            copies.append(np.zeros_like(fates.due) if fates.copies is None else fates.copies)
        self.due, self.copies, self.state = np.array(due), np.array(copies), state

    @property
    def ticks(self) -> np.ndarray:
        """(T, N, N) how many ticks each packet takes that arrives, 0 for others."""
        sent = np.arange(len(self.due))[:, None, None]
        return np.where(self.due > 0, self.due - sent, 0)

    def lost(self, *causes: int) -> np.ndarray:
        """(T, N, N) which packets are lost, by some causes or by any."""
        return np.isin(-self.due, causes) if causes else self.due < 0


def links_of(robots: int) -> np.ndarray:
    """(N, N) the links between two robots."""
    return ~np.eye(robots, dtype=bool)


def distances(positions: np.ndarray) -> np.ndarray:
    """(N, N) between the robots at (N, 2)."""
    away = positions[:, None] - positions
    return np.hypot(away[..., 0], away[..., 1])


TICKS = 60
APART = distances(np.random.default_rng(7).uniform(-8.0, 8.0, (6, 2)))

LOSSES = [
    "model='none'",
    "model='bernoulli', rate=0.3",
    "model='gilbert-elliott', good_to_bad=0.2, bad_to_good=0.3, loss_good=0.1, loss_bad=0.9",
    "model='burst', rate=0.3, burst_packets=3",
    "model='distance', midpoint_m=7, width_m=2",
    "model='distance', midpoint_m=7, width_m=2, cutoff_m=9",
    "model='range', cutoff_m=8",
    "model='path-loss', range_m=9, exponent=3",
    "model='path-loss', range_m=9, exponent=3, shadowing_db=6",
    "model='path-loss', range_m=9, exponent=3, fading='none', shadowing_db=6, shadowing_s=1",
    "model='path-loss', range_m=9, coherence_s=0.4, shadowing_db=6",
    "model='trace', mode='repeat', values=[0, 0, 1, 0, 1]",
    "model='trace', mode='shifted', values=[0, 0, 1, 0, 1, 1, 0]",
    "model='trace', mode='resample', values=[0, 0, 1]",
]
DELAYS = [
    "model='constant', mean_s=0.25",
    "model='uniform', low_s=0.0, high_s=0.6",
    "model='gamma', mean_s=0.3, std_s=0.3",
    "model='lognormal', mean_s=0.3, std_s=0.4",
    "model='normal', mean_s=0.2, std_s=0.2",
    "model='exponential', mean_s=0.3",
    "model='trace', mode='repeat', values=[0.1, 0.4, 0.2]",
    "model='trace', mode='shifted', values=[0.1, 0.4, 0.2, 0.6]",
    "model='trace', mode='resample', values=[0.1, 0.4, 0.2]",
]
LIMITS = [
    "packets_per_s=8, queue_packets_max=2",
    "bytes_per_s=900, queue_packets_max=1",
    "packets_per_s=30, bytes_per_s=1500, queue_packets_max=4",
]
AIR = "packet_s=0.01, range_m=9"
CUTS = [
    {"kind": "outage", "tick": 10, "ticks": 12, "sender": "r2"},
    {"kind": "outage", "tick": 15, "ticks": 30, "sender": "r1", "receiver": "r3"},
    {"kind": "partition", "tick": 20, "ticks": 9, "groups": [["r1"], ["r2", "r3"]]},
]
LOSS, DELAY, LIMIT = (st.sampled_from(texts) for texts in (LOSSES, DELAYS, LIMITS))
OVERRIDES = st.lists(
    st.fixed_dictionaries(
        {},
        optional={
            "sender": st.sampled_from(["r1", "r2"]),
            "receiver": st.sampled_from(["r3", "r4"]),
            "loss": LOSS,
            "delay": DELAY,
        },
    ),
    max_size=2,
)
COMPOSED = settings(deadline=None, derandomize=True, max_examples=40)


def tables(
    loss=LOSSES[0], delay=DELAYS[0], limit=None, copies=0.0, order="free", links=(), air=None
):
    """The overrides that make up a channel."""
    rows = [
        "{"
        + ", ".join(
            f"{key}={{{value}}}" if key in ("loss", "delay") else f"{key}='{value}'"
            for key, value in link.items()
        )
        + "}"
        for link in links
    ]
    return [
        f"channel.loss={{{loss}}}",
        f"channel.delay={{{delay}}}",
        f"channel.duplication.rate={copies}",
        f"channel.order={order}",
        *([f"channel.rate_limit={{{limit}}}"] if limit else []),
        *([f"channel.contention={{{air}}}"] if air else []),
        f"channel.links=[{', '.join(rows)}]",
    ]


def sizes_at(tick, robots=4):
    """Some sizes, another one for each robot and tick, now and then nothing."""
    return np.array([(37 * tick + 61 * k) % 240 * ((tick + k) % 5 > 0) for k in range(robots)])


def silent_at(tick, robots=4):
    return np.array([k == 1 and 30 <= tick < 34 for k in range(robots)])


def flown(robots=4, seed=1, events=(), ticks=TICKS, silent=True, **stages):
    return Flown(
        channel(*tables(**stages), robots=robots, seed=seed, events=list(events)),
        ticks,
        sizes_bytes=lambda tick: sizes_at(tick, robots),
        distances_m=APART[:robots, :robots],
        silent=(lambda tick: silent_at(tick, robots)) if silent else None,
    )
