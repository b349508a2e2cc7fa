"""JSON schemas of the messages, for tools that read a recording without knowing this project."""

from dataclasses import fields
from typing import Any

from encircle.protocol.messages import Command, End, Observation, Pose, Radio, Setup, State

KINDS = {
    "setup": Setup,
    "observation": Observation,
    "pose": Pose,
    "command": Command,
    "end": End,
    "state": State,
    "radio": Radio,
}
_NUMBER = {"type": "number"}
_INTEGER = {"type": "integer"}
_TEXT = {"type": "string"}
_POINT = {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2}
_MAYBE_POINT = {"anyOf": [_POINT, {"type": "null"}]}


def _list(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


_HEARD = _list({"type": "array", "prefixItems": [_TEXT, _INTEGER, _INTEGER]})
_REFERENCES = _list({"type": "array", "prefixItems": [_TEXT, _INTEGER]})
_TIMING = {"type": "array", "prefixItems": [_INTEGER, _INTEGER, _HEARD]}
_SHAPES: dict[str, dict[str, Any]] = {
    "robot": _TEXT,
    "tick": _INTEGER,
    "sequence": _INTEGER,
    "tick_s": _NUMBER,
    "strategy": _TEXT,
    "parameters": {"type": "object"},
    "position": _POINT,
    "velocity": _POINT,
    "step": _POINT,
    "heading_rad": _NUMBER,
    "headings_rad": _list(_NUMBER),
    "target": _MAYBE_POINT,
    "detection": _MAYBE_POINT,
    "goal": _MAYBE_POINT,
    "estimate": _MAYBE_POINT,
    "scan": _list(_NUMBER),
    "seen": _list({"type": "array", "prefixItems": [_TEXT, _NUMBER, _NUMBER]}),
    "inbox": _list({"type": "string", "contentEncoding": "binary"}),
    "lost": _list(_TEXT),
    "sent_us": {"type": ["integer", "null"]},
    "admitted": {"anyOf": [_REFERENCES, {"type": "null"}]},
    "answered": {"type": ["integer", "null"]},
    "timing": {"anyOf": [_TIMING, {"type": "null"}]},
    "radio": _TEXT,
    "first_tick": _INTEGER,
    "answer_tick": _INTEGER,
    "mode": _TEXT,
    "xi": {"type": ["number", "null"]},
    "point": {"type": ["integer", "null"]},
    "predictor": {"type": ["string", "null"]},
    "team": _list(_TEXT),
    "relayed": _list({"type": "array", "prefixItems": [_TEXT, _INTEGER, _NUMBER, _NUMBER]}),
    "published": {"type": "boolean"},
    "refused": {"type": "object", "additionalProperties": _INTEGER},
    "reason": _TEXT,
    "robots": _list(_POINT),
    "captured": {"type": "boolean"},
    "contacts": _list(_list(_TEXT)),
    "fates": _list(_list(_INTEGER)),
    "copies": _list(_list(_INTEGER)),
}


def json_schema(channel: str) -> dict[str, Any]:
    """The schema of a channel's messages."""
    names = [f.name for f in fields(KINDS[channel])]
    properties = {"v": _INTEGER, "run": _TEXT, **{name: _SHAPES[name] for name in names}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": channel,
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
