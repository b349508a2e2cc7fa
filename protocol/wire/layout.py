"""How a kind of message lies on the wire: its fields in their order, with checks and defaults."""

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import msgpack

from encircle.protocol.wire.checks import Check
from encircle.protocol.wire.declaration import declared_fields


@dataclass(frozen=True, slots=True)
class Layout:
    """What the codec needs to know of a kind of message.

    ``names``: ``v`` and ``run``, then the fields. ``always``: the beginning of ``names`` that no
    sender leaves out; ``defaults``: the values of the others where they are left out, and
    ``default_values`` these values alone.
    ``names_in_turn``: the fields that are always there, each followed by None in place of its
    value; ``list_header_bytes``: how many bytes msgpack's header of such a list takes.
    ``values(message)``: a tuple of the fields' values. ``map_indices``: which fields have a map
    inside, counted from the first after ``run``.
    """

    names: tuple[str, ...]
    always: tuple[str, ...]
    defaults: dict[str, Any]
    default_values: tuple[Any, ...]
    names_in_turn: tuple[str | None, ...]
    list_header_bytes: int
    values: Callable[[Any], tuple[Any, ...]]
    checks: tuple[Check, ...]
    map_indices: tuple[int, ...]


def layout_of(kind: type[Any]) -> Layout:
    """The layout that a message's class declares; ``TypeError`` for one that cannot be."""
    fields = declared_fields(kind)
    names = ("v", "run", *(field.name for field in fields))
    defaults = {field.name: field.default for field in fields if field.may_be_left_out}
    always = names[: len(names) - len(defaults)]
    if not defaults.keys().isdisjoint(always):
        raise TypeError(f"{kind.__name__}: fields that may be left out come last")
    names_in_turn = tuple([part for name in always[2:] for part in (name, None)])
    return Layout(
        names,
        always,
        defaults,
        tuple(defaults.values()),
        names_in_turn,
        len(msgpack.Packer().pack_array_header(len(names_in_turn))),
        attrgetter(*names[2:]),
        tuple(field.type.check for field in fields),
        tuple(index for index, field in enumerate(fields) if field.type.has_map),
    )
