"""A policy that chases the target and says whatever a payload may hold, other things each tick."""

from collections.abc import Mapping
from typing import Any

from encircle.agents.policies.interface import Decision, View
from encircle.agents.policies.paper import pursue

POLICY = "tests/helpers/helpers_talker.py:talk"
"""As it is named from the root of the repository, where tests run."""


def talk(memory: Mapping[str, Any] | None, view: View) -> tuple[Mapping[str, Any], Decision]:
    """Pursue, and tell how much was heard so far, in one shape of payload after the other."""
    heard = (memory or {}).get("heard", 0) + len(view.heard)
    _, decision = pursue(None, view)
    shapes: tuple[dict[str, Any], ...] = (
        {},
        {"heard": heard},
        {"text": "\u00e9\u4e2d" * (view.tick % 40), "yes": True, "none": None},
        {"list": [[k, k / 3.0] for k in range(view.tick % 20)]},
        {"map": {"deep": {"deeper": {"deepest": [heard, -heard, 0.0]}}}},
        {"bytes": bytes(view.tick % 256), "number": -1.5e8},
    )
    said = shapes[(view.tick + heard) % len(shapes)]
    return {"heard": heard}, decision._replace(say=said)
