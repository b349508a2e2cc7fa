"""Keys of a run: ``encircle/{run}/robots/{id}/{channel}``, ``encircle/{run}/world/{channel}``."""

import re
from functools import lru_cache
from typing import NamedTuple

from encircle.protocol.errors import UnknownKey

ROBOT_CHANNELS = (
    *("setup", "observation", "end", "pose", "command", "alive"),
    *("observations", "answers"),
)
WORLD_CHANNELS = ("state", "radio", "intervention", "alive")
_NAME = re.compile(r"[A-Za-z0-9_-]{1,31}")


class Key(NamedTuple):
    """A parsed key; ``robot`` is None for the world's own channels."""

    run: str
    robot: str | None
    channel: str


def is_name(name: str) -> bool:
    """Whether it may stand in a key as the name of a run or a robot."""
    return _NAME.fullmatch(name) is not None


def check_name(kind: str, name: str) -> str:
    """Return a run or robot name that may stand in a key; ``ValueError`` says what is wrong."""
    if not is_name(name):
        raise ValueError(
            f"{kind} {name!r} is not a valid name: use 1 to 31 letters, digits, '-' or '_'"
        )
    return name


def robot_key(run: str, robot: str, channel: str) -> str:
    """Key of one robot's channel; ``*`` stands for any."""
    return f"encircle/{run}/robots/{robot}/{channel}"


def world_key(run: str, channel: str) -> str:
    """Key of one of the world's channels."""
    return f"encircle/{run}/world/{channel}"


@lru_cache(maxsize=1024)
def parse_key(key: str) -> Key:
    """Take a key apart; raises ``UnknownKey`` for one that is not of the protocol."""
    match key.split("/"):
        case ["encircle", run, "robots", robot, channel] if channel in ROBOT_CHANNELS:
            parsed = Key(run, robot, channel)
        case ["encircle", run, "world", channel] if channel in WORLD_CHANNELS:
            parsed = Key(run, None, channel)
        case _:
            raise _unknown(key)
    if not all(is_name(name) for name in parsed[:2] if name is not None):
        raise _unknown(key)
    return parsed


def channel_of(key: str) -> str:
    """The last part of a key, be it of the protocol or not."""
    return key.rpartition("/")[2]


def is_plain(key: str) -> bool:
    """Whether it is one key, and no expression that stands for many."""
    return "*" not in key


def _unknown(key: str) -> UnknownKey:
    return UnknownKey(f"key {key[:200]!r} is not part of the protocol")
