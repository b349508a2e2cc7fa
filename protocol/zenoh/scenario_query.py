"""What a world says of its run when it is asked: the scenario, the seed, and the robots' setups.

Whoever looks on needs them, and may come at any time. So the world answers a Zenoh query on a key
of its own, with one msgpack map. It takes no part in the run and in no digest, and a world of other
make need not answer. Whether the scenario can be run is for whoever reads it to find out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeGuard

import msgpack

from encircle.protocol import VERSION
from encircle.protocol.errors import MalformedMessage, OversizedMessage, WrongVersion
from encircle.protocol.keys import is_name
from encircle.protocol.zenoh.answers import unpacked_answer

CHANNEL = "scenario"
"""The last part of the key, after ``world/``."""
BYTES_MAX = 4 * 1024 * 1024
SETUPS_MAX = 256
SEED_MAX = 2**63 - 1


@dataclass(frozen=True, slots=True)
class RunDescription:
    """A world's answer. ``scenario``: its resolved scenario, as JSON.

    ``setups``: each robot's Setup for tick 0, encoded, in robot order; none if the world has them
    no more.
    """

    run: str
    seed: int
    scenario: str
    setups: tuple[bytes, ...] = ()


def encode_description(described: RunDescription) -> bytes:
    """The answer as bytes; ``OversizedMessage`` if no answer may be that long."""
    payload: bytes = msgpack.packb(
        {
            "v": VERSION,
            "run": described.run,
            "seed": described.seed,
            "scenario": described.scenario,
            "setups": list(described.setups),
        }
    )
    if len(payload) > BYTES_MAX:
        raise OversizedMessage(f"a scenario of {len(payload)} bytes, at most {BYTES_MAX} may be")
    return payload


def description_replier(
    describe: Callable[[], RunDescription], version: Callable[[], int] = lambda: 0
) -> Callable[[], bytes]:
    """A function that makes the answer, and keeps it as long as ``version`` is the same.

    An answer that would be too long is empty, which is none to ``decode_description``.
    """
    made: dict[int, bytes] = {}

    def reply() -> bytes:
        now = version()
        if now not in made:
            made.clear()
            try:
                made[now] = encode_description(describe())
            except OversizedMessage:
                made[now] = b""
        return made[now]

    return reply


def decode_description(payload: bytes) -> RunDescription:
    """Decode an answer; ``OversizedMessage``, ``MalformedMessage`` or ``WrongVersion``."""
    body = unpacked_answer(payload, BYTES_MAX)
    if body.get("v") != VERSION:
        raise WrongVersion(f"the world speaks version {body.get('v')!r:.20}, not {VERSION}")
    run, seed, setups = (body.get(name) for name in ("run", "seed", "setups"))
    if not (
        type(run) is str
        and is_name(run)
        and type(seed) is int
        and 0 <= seed <= SEED_MAX
        and type(body.get("scenario")) is str
        and _are_setups(setups)
    ):
        raise MalformedMessage("the answer lacks run, seed, scenario or setups")
    return RunDescription(run, seed, body["scenario"], tuple(setups))


def _are_setups(value: Any) -> TypeGuard[list[bytes]]:
    return (
        type(value) is list
        and len(value) <= SETUPS_MAX
        and all(type(setup) is bytes for setup in value)
    )
