"""The seeds of the benchmark: public ones, and held-out ones that follow from a submission's name.

The public seeds are the same for everybody, so that policies are compared in pairs. Whoever works
on a policy sees their results, and may come to suit them. The held-out seeds of a submission are
hashes of the benchmark's version and the submission's name. Anybody can compute them, so they
cannot be made up afterwards. A reader who doubts a result runs the policy under a name of their
own, which no submitter could have prepared for.

Public seeds are below ``HELD_OUT_MIN`` and held-out seeds are not, so no seed is both.
"""

import hashlib
from collections.abc import Iterator
from itertools import count, islice

from encircle.world.scenario.fields import SEED_END

PUBLIC_FIRST = 140_001
SEEDS = 100
"""How many seeds of either kind the benchmark has."""
HELD_OUT_MIN = 2**32
NAME_LETTERS_MAX = 60


def public_seeds(number: int = SEEDS) -> tuple[int, ...]:
    """The first ``number`` of the public seeds, at most ``SEEDS``."""
    assert 0 < number <= SEEDS, number
    return tuple(range(PUBLIC_FIRST, PUBLIC_FIRST + number))


def held_out_seeds(version: int, name: str, number: int = SEEDS) -> tuple[int, ...]:
    """The first ``number`` held-out seeds of a submission, all different.

    ``name``: as from ``checked_name``. More seeds of one name begin with the same seeds.
    """
    return tuple(islice(_drawn(version, name), number))


def _drawn(version: int, name: str) -> Iterator[int]:
    seen = set()
    for index in count():  # ends with its reader: hashes that are too small or known are rare
        text = f"encircle benchmark {version}\n{name}\n{index}"
        digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
        seed = int.from_bytes(digest, "big") % SEED_END
        if seed >= HELD_OUT_MIN and seed not in seen:
            seen.add(seed)
            yield seed


def checked_name(name: str) -> str:
    """A submission's name with single spaces between its words.

    Raises ``ValueError`` if nothing is left, if it is longer than ``NAME_LETTERS_MAX``, or if it
    holds characters that cannot be printed.
    """
    words = " ".join(name.split())
    if not words or len(words) > NAME_LETTERS_MAX or not words.isprintable():
        raise ValueError(
            f"name {name!r}: must be 1 to {NAME_LETTERS_MAX} characters that can be printed"
        )
    return words
