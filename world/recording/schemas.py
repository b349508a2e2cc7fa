"""JSON schemas of the messages, for tools that read a recording without knowing this project.

They follow from the declarations in ``encircle.protocol.messages``.
"""

import re
from typing import Any

from encircle.protocol.messages import (
    Command,
    End,
    Intervention,
    Observation,
    Pose,
    Radio,
    Setup,
    State,
)
from encircle.protocol.wire.declaration import DeclaredField, declared_fields

KINDS: dict[str, type[Any]] = {
    "setup": Setup,
    "observation": Observation,
    "pose": Pose,
    "command": Command,
    "end": End,
    "state": State,
    "radio": Radio,
    "intervention": Intervention,
}
_HEADER: dict[str, dict[str, Any]] = {"v": {"type": "integer"}, "run": {"type": "string"}}
_MARKDOWN_LINK = re.compile(r"\[([^\]]+)\]\(#[^)]*\)")


def json_schema(channel: str) -> dict[str, Any]:
    """The schema of a channel's messages."""
    fields = declared_fields(KINDS[channel])
    properties = dict(_HEADER)
    for field in fields:
        properties[field.name] = field.type.schema | {"description": _description(field)}
    required = [*_HEADER, *(field.name for field in fields if not field.may_be_left_out)]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": channel,
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def _description(field: DeclaredField) -> str:
    """The field's meaning without links, which lead nowhere from a recording, and its unit."""
    meaning = _MARKDOWN_LINK.sub(r"\1", field.meaning)
    return f"{meaning} ({field.unit})" if field.unit else meaning
