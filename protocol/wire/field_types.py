"""Types of message fields: the check of a value, its JSON schema, and its words in the tables.

A message is a frozen dataclass whose annotations are made of the types below, such as ``Count``,
``Point | None`` or ``tuple[Text, ...]``. ``field_type`` takes an annotation apart and puts together
what the codec, the recording and the documentation need; so a type is written down once.
"""

import math
import types
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple, TypeAlias, Union, get_args, get_origin

from encircle.protocol.wire import checks
from encircle.protocol.wire.limits import (
    COUNT_MAX,
    LIST_MAX,
    NUMBER_MAX,
    SAY_BYTES_MAX,
    TEXT_MAX,
)
from encircle.protocol.wire.payload import FrozenMap, payload

Schema: TypeAlias = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)  # annotations must be hashable, schemas are not
class FieldType:
    """A type of values on the wire.

    ``text`` and ``plural`` are its words in the tables of docs/protocol.md. ``has_map``: whether a
    value holds a map, in which a name could come twice.
    """

    text: str
    plural: str
    schema: Schema
    check: checks.Check
    has_map: bool = False


class Items(NamedTuple):
    """How many items a list may have; stands in the annotation of the list."""

    items_max: int
    items_min: int = 0


class CheckedBy(NamedTuple):
    """A quicker check than the one that follows from the annotation; it must judge the same."""

    check: checks.Check


_NUMBER: Schema = {
    "type": "number",
    "exclusiveMinimum": -NUMBER_MAX,
    "exclusiveMaximum": NUMBER_MAX,
}
_TEXTS: Schema = {"type": "array", "items": {"type": "string"}, "maxItems": LIST_MAX}
_BINARY: Schema = {"type": "string", "contentEncoding": "binary"}
_COUNT: Schema = {"type": "integer", "minimum": 0, "maximum": COUNT_MAX}

Real: TypeAlias = Annotated[float, FieldType("real", "reals", _NUMBER, checks.number)]
Duration: TypeAlias = Annotated[
    float,
    FieldType("real above 0", "reals above 0", _NUMBER | {"exclusiveMinimum": 0}, checks.duration),
]
Length: TypeAlias = Annotated[
    float,
    FieldType(
        "real of at least 0",
        "reals of at least 0",
        {"type": "number", "minimum": 0, "exclusiveMaximum": NUMBER_MAX},
        checks.length,
    ),
]
Angle: TypeAlias = Annotated[
    float,
    FieldType(
        "real from -pi to pi",
        "reals from -pi to pi",
        {"type": "number", "minimum": -math.pi, "maximum": math.pi},
        checks.angle,
    ),
]
Count: TypeAlias = Annotated[int, FieldType("count", "counts", _COUNT, checks.count)]
Integer: TypeAlias = Annotated[
    int,
    FieldType(
        "whole number",
        "whole numbers",
        {"type": "integer", "minimum": -COUNT_MAX, "maximum": COUNT_MAX},
        checks.integer,
    ),
]
Text: TypeAlias = Annotated[
    str, FieldType("text", "texts", {"type": "string", "maxLength": TEXT_MAX}, checks.text)
]
Boolean: TypeAlias = Annotated[
    bool, FieldType("boolean", "booleans", {"type": "boolean"}, checks.boolean)
]
Point: TypeAlias = Annotated[
    tuple[float, float],
    FieldType(
        "point",
        "points",
        {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2},
        checks.point,
    ),
]
Robots: TypeAlias = Annotated[
    tuple[str, ...],
    FieldType(f"list of at most {LIST_MAX} texts", "lists of texts", _TEXTS, checks.texts),
]
Team: TypeAlias = Annotated[
    tuple[str, ...],
    FieldType(f"list of at most {LIST_MAX} names", "lists of names", _TEXTS, checks.team),
]
Packets: TypeAlias = Annotated[
    tuple[bytes, ...],
    FieldType(
        "list of bytes", "lists of bytes", {"type": "array", "items": _BINARY}, checks.packets
    ),
]
PlainMap: TypeAlias = Annotated[
    Mapping[str, Any],
    FieldType(
        "map, text to reals, texts, bytes, booleans, nil, lists and maps of these",
        "maps",
        {"type": "object"},
        checks.parameters,
        has_map=True,
    ),
]

Payload: TypeAlias = Annotated[
    FrozenMap,
    FieldType(
        f"map as below, of at most {SAY_BYTES_MAX:,} bytes",
        "maps as below",
        {"type": "object"},
        payload,
        has_map=True,
    ),
]


def field_type(annotation: Any) -> FieldType:
    """The type that an annotation stands for; ``TypeError`` for one that stands for none."""
    metadata = getattr(annotation, "__metadata__", ())
    for item in reversed(metadata):
        if isinstance(item, FieldType):
            return item
    items = next((item for item in metadata if isinstance(item, Items)), None)
    composed = _composed(annotation.__origin__ if metadata else annotation, items)
    quicker = next((item.check for item in metadata if isinstance(item, CheckedBy)), None)
    return composed if quicker is None else replace(composed, check=quicker)


def _composed(annotation: Any, items: Items | None) -> FieldType:
    """The type of ``X | None``, a list, a row, a named tuple or a map; ``items`` is for lists."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin in (Union, types.UnionType) and parts[1:] == (type(None),):
        return _optional(field_type(parts[0]))
    if origin is tuple and parts[-1] is Ellipsis:
        return _list(field_type(parts[0]), items)
    if origin is tuple:
        return _row([field_type(part) for part in parts], None)
    if isinstance(annotation, type) and hasattr(annotation, "_fields"):
        return _row([field_type(part) for part in annotation.__annotations__.values()], annotation)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _map(*map(field_type, parts))
    raise TypeError(
        f"{annotation}: no type of encircle.protocol.wire.field_types, nor made of them"
    )


def _optional(inner: FieldType) -> FieldType:
    null = {"type": "null"}
    schema: Schema = {"anyOf": [inner.schema, null]}
    if inner.schema.get("type") not in (None, "array", "object"):
        schema = inner.schema | {"type": [inner.schema["type"], "null"]}
    return FieldType(
        f"{inner.text} or null",
        f"{inner.plural} or nulls",
        schema,
        checks.optional(inner.check),
        inner.has_map,
    )


def _list(item: FieldType, items: Items | None) -> FieldType:
    schema: Schema = {"type": "array", "items": item.schema}
    if items is None:
        check, size = checks.list_of(item.check), ""
    else:
        check = checks.list_of(item.check, items.items_min, items.items_max)
        schema |= {"minItems": items.items_min, "maxItems": items.items_max}
        size = f"{items.items_min} to {items.items_max} " if items.items_min else ""
        size = size or f"at most {items.items_max} "
    text = f"list of {size}{item.plural}"
    return FieldType(text, text.replace("list", "lists", 1), schema, check, item.has_map)


def _row(parts: list[FieldType], named_tuple: Any) -> FieldType:
    schema: Schema = {
        "type": "array",
        "prefixItems": [part.schema for part in parts],
        "minItems": len(parts),
        "maxItems": len(parts),
    }
    text = f"[{', '.join(part.text for part in parts)}]"
    check = checks.row_of(text, named_tuple, *[part.check for part in parts])
    return FieldType(text, text, schema, check, any(part.has_map for part in parts))


def _map(name: FieldType, value: FieldType) -> FieldType:
    schema: Schema = {"type": "object", "additionalProperties": value.schema}
    text = f"map, {name.text} to {value.text}"
    return FieldType(text, "maps", schema, checks.map_of(name.check, value.check), has_map=True)
