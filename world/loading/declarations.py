"""What is declared of a scenario's keys: type, unit, range, default and meaning, for its page.

Everything is read off the declarations: of a model's field the type with its range and unit, and
the docstring below it; of a robot's parameter the same (``encircle.protocol.parameters``); of a
target behaviour's parameter its annotation, whose ``description`` is the meaning.
"""

import ast
import inspect
import textwrap
import types
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from encircle.protocol.parameters import Parameters, Range, Unit, declared
from encircle.world.scenario.fields import SEED_END, model_of_others, models_in

BOUNDS = {"ge": "from {}", "gt": "above {}", "le": "to {}", "lt": "below {}"}
"""What pydantic's marks of a range are called, and what they say."""
TYPE_TEXTS = {float: "number", int: "whole number", str: "text", bool: "true or false"}


class DeclaredKey(NamedTuple):
    """One key; ``values``: its range or choices; ``default``: as TOML has it, empty for none."""

    name: str
    type: str
    unit: str
    values: str
    default: str
    meaning: str


class _Type(NamedTuple):
    """What an annotation says."""

    text: str
    unit: str = ""
    values: str = ""


def keys_of_model(model: type[BaseModel]) -> list[DeclaredKey]:
    """The keys of a table, in the order of their declaration; ``TypeError`` if one has no meaning.

    What a field's docstring says counts before its ``description``, which a target behaviour has.
    """
    docstrings = field_docstrings(model)
    return [
        _key(
            name,
            _typed(field.annotation, field.metadata),
            "" if field.is_required() else _toml(field.get_default(call_default_factory=True)),
            docstrings.get(name) or field.description or "",
            is_required=field.is_required(),
        )
        for name, field in model.model_fields.items()
    ]


def keys_of_robot(names: Sequence[str]) -> list[DeclaredKey]:
    """Some of the robots' parameters."""
    hints = get_type_hints(Parameters, include_extras=True)
    docstrings = field_docstrings(Parameters)
    return [
        _key(name, _typed(hints[name], ()), _toml(declared()[name].default), docstrings[name])
        for name in names
    ]


@cache
def field_docstrings(declaring: type[Any]) -> Mapping[str, str]:
    """The docstrings below a class's fields, by field; of a class made at run time there are none.

    Python does not keep them, so they are read from the source.
    """
    try:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(declaring))).body
    except (OSError, TypeError):
        return {}
    assert isinstance(tree, ast.ClassDef)
    docstrings = {}
    for field, after in zip(tree.body, tree.body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
        ):
            docstrings[field.target.id] = one_line(str(after.value.value))
    return docstrings


def one_line(text: str) -> str:
    """A docstring as Markdown has it: one line, code in single backquotes."""
    return " ".join(text.split()).replace("``", "`")


def tables_of(model: type[BaseModel]) -> list[type[BaseModel]]:
    """A model and every model below it, once."""
    tables = [model]
    for table in tables:  # grows as it goes, by each model at most once
        below = [m for f in table.model_fields.values() for m in models_in(f.annotation)]
        if (others := model_of_others(table)) is not None:
            below.append(others)
        tables += [other for other in dict.fromkeys(below) if other not in tables]
    return tables


def _key(
    name: str, its_type: _Type, default: str, meaning: str, *, is_required: bool = False
) -> DeclaredKey:
    if not meaning:
        raise TypeError(f"{name}: has no docstring that says what it means")
    shown = "must be given" if is_required else default
    text, unit, values = its_type
    return DeclaredKey(name, text, unit, values, shown, meaning)


def _typed(annotation: Any, metadata: Sequence[Any]) -> _Type:
    """Type, unit and values of an annotation, to which ``metadata`` belongs too."""
    if get_origin(annotation) is Annotated:
        annotation, *own = get_args(annotation)
        return _typed(annotation, [*own, *metadata])
    if get_origin(annotation) in (Union, types.UnionType):
        parts = [part for part in get_args(annotation) if part is not type(None)]
        if len(parts) == 1:
            return _typed(parts[0], metadata)
        plain = [_typed(part, ()) for part in parts if not list(models_in(part))]
        return plain[0]._replace(text=f"{plain[0].text} or table") if plain else _Type("table")
    if get_origin(annotation) is Literal:
        return _Type("text", "", ", ".join(f"`{choice}`" for choice in get_args(annotation)))
    if get_origin(annotation) is dict:
        return _Type("table")
    if get_origin(annotation) is not None:
        return _listed(annotation, metadata)
    if list(models_in(annotation)):
        return _Type("table")
    unit = next((mark.symbol for mark in _flat(metadata) if isinstance(mark, Unit)), "")
    return _Type(TYPE_TEXTS[annotation], unit, _range_text(_flat(metadata)))


def _listed(annotation: Any, metadata: Sequence[Any]) -> _Type:
    parts = [part for part in get_args(annotation) if part is not Ellipsis]
    if list(models_in(annotation)):
        return _Type("list of tables")
    inner = _typed(parts[0], metadata)
    if get_origin(annotation) is tuple and len(parts) == 2:
        return _Type(f"pair of {_plural(inner.text)}", inner.unit, inner.values)
    return inner._replace(text=f"list of {_plural(inner.text)}")


def _plural(text: str) -> str:
    first, separator, rest = text.partition(" of ")
    return (first if first == "text" else first + "s") + separator + rest


def _flat(metadata: Sequence[Any]) -> Iterator[Any]:
    for mark in metadata:
        if isinstance(mark, FieldInfo):
            yield from mark.metadata
        else:
            yield mark


def _range_text(marks: Iterator[Any]) -> str:
    low = high = ""
    for mark in marks:
        if isinstance(mark, Range):
            low, high = f"from {_range_end(mark.low)}", f"to {_range_end(mark.high)}"
        for bound, text in BOUNDS.items():
            value = getattr(mark, bound, None)
            if value is not None and bound[0] == "g":
                low = text.format(_range_end(value))
            elif value is not None:
                high = text.format(_range_end(value))
    return " ".join(part for part in (low, high) if part).replace(" below", ", below")


def _toml(value: Any) -> str:
    """A value as a scenario's file has it; empty for what is left out, and for tables."""
    if value is None or isinstance(value, BaseModel | dict) or value == ():
        return ""
    if isinstance(value, str):
        return f'`"{value}"`'
    if isinstance(value, tuple):
        return f"`[{', '.join(_toml(item) for item in value)}]`".replace("``", "`")
    if isinstance(value, bool):
        return str(value).lower()
    if abs(value) >= 10_000:
        return f"{value:_.0f}"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _range_end(value: Any) -> str:
    """A bound for people: large numbers with commas."""
    if value == SEED_END:
        return "2^63"
    return f"{value:,.0f}" if abs(value) >= 10_000 else _toml(value)
