"""Made-up networks: clocks that disagree, and what becomes of each message."""

import numpy as np

OFFSETS_US = {"r1": 0, "r2": 3_600_000_000, "r3": -7_000_000, "r4": 12_345}


DRIFTS = {"r1": 5e-5, "r2": -9e-5, "r3": 0.0, "r4": 2e-5}


def delays_us(sender: str, receiver: str, channel: str, number: int) -> int:
    """Another delay for every link, with queues, slower to the robots than back."""
    base = {"observation": 2000, "command": 900, "pose": 1300}[channel]
    generator = np.random.default_rng([number, *f"{sender}{receiver}{channel}".encode()])
    return base + int(generator.exponential(600))


def lossy(sender: str, receiver: str, channel: str, number: int) -> int | None:
    """A fifth of all packets is lost, and no other message."""
    return lossier(sender, receiver, channel, number) or (
        None if channel == "pose" else delays_us(sender, receiver, channel, number)
    )


def lossier(sender: str, receiver: str, channel: str, number: int) -> int | None:
    """A fifth of everything is lost."""
    generator = np.random.default_rng([9, number, *f"{sender}{receiver}{channel}".encode()])
    return None if generator.random() < 0.2 else delays_us(sender, receiver, channel, number)
