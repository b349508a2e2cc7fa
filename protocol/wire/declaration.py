"""The declaration of a message's fields, read off its class.

A field is declared in one place, the message's class in ``encircle.protocol.messages``::

    goal: Annotated[Point | None, Field("the point it heads for", "m")]

From it follow the codec's check and the order on the wire (``encircle.protocol.codec``), the JSON
schema in recordings (``encircle.world.recording.schemas``) and the tables of docs/protocol.md
(``encircle.protocol.describe``).

A field that comes later to a kind of message may be left out: ``may_be_left_out=True``, with a
default. Then messages written before are read as ever, and one in which the field has its default
is the same bytes as before.
"""

from dataclasses import fields
from typing import Any, NamedTuple

from encircle.protocol.wire.field_types import FieldType, field_type


class Field(NamedTuple):
    """What a field means, in a sentence that may hold Markdown, and the unit of its numbers."""

    meaning: str
    unit: str = ""
    may_be_left_out: bool = False


class DeclaredField(NamedTuple):
    """All that is declared of one field. ``default`` counts where the field may be left out."""

    name: str
    type: FieldType
    unit: str
    meaning: str
    may_be_left_out: bool
    default: Any


def declared_fields(kind: type[Any]) -> tuple[DeclaredField, ...]:
    """The fields of a kind of message, in the order of the wire.

    ``TypeError`` for a field without a ``Field``, of a type that cannot be sent, or that may be
    left out and has no default of its type.
    """
    try:
        return tuple([_declared(item.name, item.type, item.default) for item in fields(kind)])
    except TypeError as error:
        raise TypeError(f"{kind.__name__}.{error}") from None


def _declared(name: str, annotation: Any, default: Any) -> DeclaredField:
    declarations = [
        item for item in getattr(annotation, "__metadata__", ()) if isinstance(item, Field)
    ]
    if len(declarations) != 1:
        raise TypeError(f"{name}: declare it as Annotated[type, Field(meaning)]")
    meaning, unit, may_be_left_out = declarations[0]
    try:
        wire_type = field_type(annotation)
        if may_be_left_out:
            wire_type.check(default)
    except TypeError as error:
        raise TypeError(f"{name}: {error}") from None
    except ValueError as error:
        raise TypeError(f"{name}: may be left out, so it needs a default, {error}") from None
    return DeclaredField(name, wire_type, unit, meaning, may_be_left_out, default)
