"""What a learner does: an array of numbers from -1 to 1 as a policy's decision.

The first two are the step, as parts of the longest one; the brain shortens what is longer and keeps
the robot from collisions, as for any policy. Those that follow are told to the peers, if there are
any: each as a whole number from -127 to 127 in one byte, in the robot's pose packet and through the
same channel. While nothing is known of the target, the robot does what the default search does.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from encircle.agents.policies.interface import Decision, View

KEY = "learned"
"""What a payload is told under."""
LEVELS = 127
PAYLOAD_MAX = 1000
"""So many numbers fit into what a policy may say."""
STEP = 2
"""How many numbers of an action are the step."""
MODE = "learned"


def decision(
    view: View, action: Sequence[float] | NDArray[Any], *, searches: bool = True
) -> Decision:
    """The decision that an action (2 + k,) stands for; ``ValueError`` if it is none.

    ``searches``: do what the default search does while nothing is known of the target, whatever the
    step of the action is.
    """
    numbers = checked(action)
    told = told_as(numbers[STEP:])
    if searches and view.search is not None:
        return view.search._replace(say=told)
    full_m, (x, y) = view.parameters.step_m_max, view.position
    step = (numbers[0] * full_m, numbers[1] * full_m)
    return Decision(MODE, step, (x + step[0], y + step[1]), say=told)


def checked(action: Any, size: int | None = None) -> list[float]:
    """The numbers of an action as floats; ``ValueError`` says what they must be.

    ``size``: how many they are to be, at least 2 if it is left out.
    """
    try:
        array = np.asarray(action, float)
    except (TypeError, ValueError):
        raise ValueError(f"{action!r}: must be numbers from -1 to 1") from None
    if array.ndim != 1 or (len(array) < STEP if size is None else len(array) != size):
        wanted = f"({size},)" if size else f"(k,), k at least {STEP}"
        raise ValueError(f"shape {array.shape}: must be {wanted}")
    numbers: list[float] = array.tolist()
    for place, number in enumerate(numbers):
        if not (isfinite(number) and -1.0 <= number <= 1.0):
            raise ValueError(f"[{place}] = {number}: must be from -1 to 1")
    return numbers


def told_as(numbers: Sequence[float]) -> dict[str, bytes] | None:
    """What a robot says to tell numbers from -1 to 1; nothing for none."""
    if not numbers:
        return None
    return {KEY: bytes([round(LEVELS * number) % 256 for number in numbers])}


def spoken(say: Mapping[str, Any], count: int) -> list[float] | None:
    """The numbers in what a peer said; None if it did not tell so many."""
    told = say.get(KEY)
    if type(told) is not bytes or len(told) != count:
        return None
    # -128 is said by nobody who says what an action is; it is taken for -127.
    return [max(-1.0, ((byte + 128) % 256 - 128) / LEVELS) for byte in told]
