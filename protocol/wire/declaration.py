"""The declaration of a message's fields, read off its class.

A field is declared in one place, the message's class in ``encircle.protocol.messages``::

    goal: Annotated[Point | None, Field("the point it heads for", "m")] = None

From it follow the codec's check and the order on the wire (``encircle.protocol.codec``), the JSON
schema in recordings (``encircle.world.recording.schemas``) and the tables of docs/protocol.md
(``encircle.protocol.describe``).
"""

from dataclasses import fields
from typing import Any, NamedTuple

from encircle.protocol.wire.field_types import FieldType, field_type


class Field(NamedTuple):
    """What a field means, in a sentence that may hold Markdown, and the unit of its numbers."""

    meaning: str
    unit: str = ""


class DeclaredField(NamedTuple):
    """All that is declared of one field."""

    name: str
    type: FieldType
    unit: str
    meaning: str


def declared_fields(kind: type[Any]) -> tuple[DeclaredField, ...]:
    """The fields of a kind of message, in the order of the wire.

    ``TypeError`` for a field without a ``Field``, or of a type that cannot be sent.
    """
    return tuple([_declared(kind, item.name, item.type) for item in fields(kind)])


def _declared(kind: type[Any], name: str, annotation: Any) -> DeclaredField:
    declarations = [
        item for item in getattr(annotation, "__metadata__", ()) if isinstance(item, Field)
    ]
    if len(declarations) != 1:
        raise TypeError(f"{kind.__name__}.{name}: declare it as Annotated[type, Field(meaning)]")
    try:
        return DeclaredField(
            name, field_type(annotation), declarations[0].unit, declarations[0].meaning
        )
    except TypeError as error:
        raise TypeError(f"{kind.__name__}.{name}: {error}") from None
