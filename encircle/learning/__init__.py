"""Learning: the hunt as a PettingZoo environment, and what a learned policy shares with it.

>>> from encircle.learning import parallel_env
>>> env = parallel_env("sim1")
>>> observations, infos = env.reset(seed=1)

``observation`` and ``decision`` need nothing but what every robot has.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from encircle.extras import missing_line

if TYPE_CHECKING:
    from encircle.learning.acting import decision
    from encircle.learning.environment import HuntEnv, parallel_env
    from encircle.learning.observing import Layout, observation
    from encircle.learning.rewards import Reward

__all__ = ["HuntEnv", "Layout", "Reward", "decision", "observation", "parallel_env"]
_ROOM = "encircle.learning"
_MODULE_OF = {
    "HuntEnv": f"{_ROOM}.environment",
    "Layout": f"{_ROOM}.observing",
    "Reward": f"{_ROOM}.rewards",
    "decision": f"{_ROOM}.acting",
    "observation": f"{_ROOM}.observing",
    "parallel_env": f"{_ROOM}.environment",
}


def __getattr__(name: str) -> Any:
    """Fetch a name when it is used first: a robot has no PettingZoo."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        module = import_module(_MODULE_OF[name])
    except ModuleNotFoundError as error:
        line = missing_line(error, "encircle.learning")
        if line is None:
            raise
        raise ImportError(line) from None
    return getattr(module, name)


def __dir__() -> list[str]:
    """All names, for completion, also those that have not been used yet."""
    return sorted({*globals(), *__all__})
