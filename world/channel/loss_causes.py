"""Why a packet was lost. The codes stand negated in a packet's fate: never change one."""

from enum import IntEnum


class Cause(IntEnum):
    """A cause of loss. Of several that apply, ``world/channel/channel.py`` says which is named."""

    LOSS = 1
    BURST_LOSS = 2
    SENDER_SILENT = 3
    RECEIVER_SILENT = 4
    OUT_OF_RANGE = 5
    DISTANCE_LOSS = 6
    TRACE_LOSS = 7
    OUTAGE = 8
    PARTITION = 9
    QUEUE_FULL = 10
    WEAK_SIGNAL = 11
    CONTENTION = 12


CAUSES = {int(cause): cause.name.lower().replace("_", "-") for cause in Cause}
"""The names by which results count losses, by code."""
