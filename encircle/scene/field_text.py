"""A model's fields in words: its kind, and what differs from the defaults.

The texts are made from the fields, so that a new loss model needs no change here.
"""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

ITEMS_MAX = 12
"""A longer list is told by its length."""


def value_text(value: Any) -> str:
    """A model as the fields that differ from the default, its kind first."""
    if isinstance(value, BaseModel):
        fields = type(value).model_fields
        first = [str(getattr(value, name)) for name in ("model", "kind") if name in fields]
        rest = {
            name: getattr(value, name)
            for name in fields
            if name not in ("model", "kind")
            and getattr(value, name) != fields[name].get_default(call_default_factory=True)
        }
        return ", ".join([*first, items_text(rest)] if rest else first) or "as by default"
    if isinstance(value, list | tuple) and len(value) > ITEMS_MAX:
        return f"{len(value)} values"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(map(value_text, value)) + ")"
    return f"{value:g}" if isinstance(value, float) else str(value)


def items_text(tree: Mapping[str, Any]) -> str:
    """Names and values, as in ``rate = 0.3, burst_packets = 4``."""
    return ", ".join(f"{key} = {value_text(value)}" for key, value in tree.items())
