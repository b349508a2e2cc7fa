"""What pydantic finds wrong, in plain sentences: the key, its value, and what would be right.

Every model that reads what a person wrote goes through here, so that one module knows
pydantic's kinds of error. Its own messages are never shown: they name Python's types, and not what
to change in the file. Unknown keys come with the known one that is nearest.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, get_args, get_origin

from pydantic import BaseModel, ValidationError

from encircle.protocol.errors import did_you_mean, suggestion
from encircle.world.scenario.fields import model_of_others, models_in, shown

Path = tuple[str | int, ...]
TEXT, WHOLE, NUMBER = "must be text", "must be a whole number", "must be a number"
LIST, TABLE, TRUTH = "must be a list", "must be a table", "must be true or false"
MISSING = "is missing"
PROBLEM_TEXTS: dict[str, str | Callable[[Mapping[str, Any]], str]] = {
    "string_type": TEXT,
    "string_sub_type": TEXT,
    "string_unicode": TEXT,
    "int_type": WHOLE,
    "int_parsing": WHOLE,
    "int_parsing_size": WHOLE,
    "int_from_float": WHOLE,
    "float_type": NUMBER,
    "float_parsing": NUMBER,
    "decimal_type": NUMBER,
    "decimal_parsing": NUMBER,
    "finite_number": "must be a number that is neither infinite nor NaN",
    "bool_type": TRUTH,
    "bool_parsing": TRUTH,
    "none_required": "must be left out",
    "tuple_type": LIST,
    "list_type": LIST,
    "set_type": LIST,
    "iterable_type": LIST,
    "is_instance_of": lambda context: f"must be a {context['class']}",
    "dict_type": TABLE,
    "mapping_type": TABLE,
    "model_type": TABLE,
    "model_attributes_type": TABLE,
    "dataclass_type": TABLE,
    "union_tag_not_found": lambda context: f"must have {_bare(context['discriminator'])}",
    "missing": MISSING,
    "greater_than": lambda context: f"must be above {context['gt']}",
    "greater_than_equal": lambda context: f"must be at least {context['ge']}",
    "less_than": lambda context: f"must be below {context['lt']}",
    "less_than_equal": lambda context: f"must be at most {context['le']}",
    "multiple_of": lambda context: f"must be a multiple of {context['multiple_of']}",
    "literal_error": lambda context: f"must be {context['expected']}",
    "enum": lambda context: f"must be {context['expected']}",
    "union_tag_invalid": lambda context: f"must be one of {context['expected_tags']}",
    "too_short": lambda context: f"must have {_items(context['min_length'])} or more",
    "too_long": lambda context: f"must have no more than {_items(context['max_length'])}",
    "string_too_short": lambda context: f"must have {context['min_length']} characters or more",
    "string_too_long": lambda context: f"must have {context['max_length']} characters or fewer",
    "string_pattern_mismatch": lambda context: f"must be like the pattern {context['pattern']}",
    "value_error": lambda context: str(context["error"]),
    "assertion_error": lambda context: str(context["error"]),
}
OTHERWISE = "cannot be used here"
KEYS_NAMED_MAX = 3
SLIP_LIKENESS_MIN = 0.85
"""The likeness of names that differ by a letter or two."""
KEY = "[key]"
"""Where pydantic's location of an error ends with this, it is the key before it that is wrong."""
UNKNOWN_KEY = "unknown key"
_ABSENT = object()
"""Stands for the value of a key that is missing."""


def problems_in(
    error: ValidationError, model: type[BaseModel], tree: Any, other_keys: Sequence[str] = ()
) -> dict[Path, str]:
    """Every problem by its path in what was read: a sentence with key, value, and what is right.

    ``tree``: what was validated; ``other_keys``: dotted keys that the model does not know of.
    """
    problems: dict[Path, tuple[Any, list[str]]] = {}
    for one in error.errors(include_url=False):
        path = _path(one["loc"], tree, one["type"])
        value, must = one["input"], _sentence(one)
        if one["type"] == "extra_forbidden":
            must = _of_another(path, model, tree) or (
                UNKNOWN_KEY + _known_key(path, model, other_keys)
            )
        elif one["type"] == "missing" and path and isinstance(path[-1], str):
            value, must = _ABSENT, _missing(path, model, tree)
        elif one["type"] == "missing" and path:
            # Of a list of fixed length, which is right or wrong as a whole.
            path, must = path[:-1], f"must have more than {_items(len(value))}"
        elif KEY in one["loc"] or one["type"] == "invalid_key":
            path = _path(one["loc"][: -2 if KEY in one["loc"] else -1], tree, "")
            value, must = _value_at(tree, path), "must be a table whose keys are text"
        elif one["type"] in ("union_tag_invalid", "literal_error"):
            path, value, must = _choice(one, path)
        elif must == TABLE:
            must += _as_in(path, model)
        if (before := problems.setdefault(path, (value, [])))[1].count(must) == 0:
            before[1].append(must)
    return {path: _line(path, value, musts) for path, (value, musts) in problems.items()}


def _line(path: Path, value: Any, musts: Sequence[str]) -> str:
    key = ".".join(map(str, path))
    if value is _ABSENT:
        return f"{key}: {musts[0]}"
    must = musts[0] + "".join(f", or {other.removeprefix('must be ')}" for other in musts[1:])
    return f"{key} = {shown(value)}: {must}" if key else f"{shown(value)}: {must}"


def _sentence(one: Any) -> str:
    text = PROBLEM_TEXTS.get(one["type"], OTHERWISE)
    return text if isinstance(text, str) else text(one.get("ctx", {}))


def _path(location: Sequence[str | int], tree: Any, kind: str) -> Path:
    """Keys and numbers of items in what was written; pydantic puts names of types in between."""
    path: list[str | int] = []
    for index, part in enumerate(location):
        is_last = index == len(location) - 1
        if isinstance(part, int):
            inside = isinstance(tree, Sequence) and not isinstance(tree, str) and part < len(tree)
            tree = tree[part] if inside else None
        elif isinstance(tree, Mapping) and part in tree:
            tree = tree[part]
        elif not (is_last and kind == "missing"):
            continue
        path.append(part)
    return tuple(path)


def _value_at(tree: Any, path: Path) -> Any:
    for part in path:
        tree = tree[part]
    return tree


def _choice(one: Any, path: Path) -> tuple[Path, Any, str]:
    """Path, value and sentence for a value that must be one of several names."""
    context, value = one["ctx"], one["input"]
    names = context.get("expected_tags") or context["expected"]
    known = [_bare(name) for name in names.replace(" or ", ", ").split(", ")]
    if one["type"] == "union_tag_invalid":
        discriminator = _bare(context["discriminator"])
        path, value = (*path, discriminator), value[discriminator]
    listed = ", ".join(known)
    return (
        path,
        value,
        f"must be {'one of ' if len(known) > 1 else ''}{listed}" + did_you_mean(value, known),
    )


def _as_in(path: Path, model: type[BaseModel]) -> str:
    """How a table is written, and some of the keys that it may have."""
    keys = list(dict.fromkeys(k for one in _tables_at(path, model) for k in one.model_fields))
    named = keys[:KEYS_NAMED_MAX]
    if not path or not all(isinstance(part, str) for part in path):
        return f" with keys such as {_either(named)}" if named else ""
    key = ".".join(map(str, path))
    written = f", as in {key} = {{...}}"
    if not named:
        return written
    return f"{written}, or set one of its keys, such as {_either([f'{key}.{k}' for k in named])}"


def _either(names: Sequence[str]) -> str:
    """As in ``a, b or c``."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last


def _missing(path: Path, model: type[BaseModel], tree: Any) -> str:
    chosen = _chosen(path, model, tree)
    return f"{MISSING}; it must be given for {chosen.described}" if chosen else MISSING


def _of_another(path: Path, model: type[BaseModel], tree: Any) -> str:
    """Of which models a key is that the table's own model does not have; empty if it is of none."""
    chosen = _chosen(path, model, tree)
    if chosen is None:
        return ""
    names = [name for name, other in chosen.others.items() if path[-1] in other.model_fields]
    if not names:
        return ""
    own = sorted({*chosen.model.model_fields} - {chosen.discriminator})
    takes = ", ".join(own) or "nothing"
    return (
        f"has no meaning for {chosen.described}, which takes {takes};"
        f" {path[-1]} is of {', '.join(map(repr, names))}"
    )


class _Chosen(NamedTuple):
    """A table's model, chosen among others by the name that stands under the discriminator."""

    discriminator: str
    name: str
    model: type[BaseModel]
    others: Mapping[str, type[BaseModel]]

    @property
    def described(self) -> str:
        """As in ``model 'burst'``."""
        return f"{self.discriminator} {self.name!r}"


def _chosen(path: Path, model: type[BaseModel], tree: Any) -> _Chosen | None:
    """Which of several models the table of a key is; None if it can be only one, or is none."""
    models = _tables_at(path[:-1], model)
    for key in models[0].model_fields if len(models) > 1 else ():
        by_name = {name: one for one in models for name in _names(one, key)}
        if len(by_name) == len(models) and all(len(_names(one, key)) == 1 for one in models):
            unnamed = next(
                (n for n, o in by_name.items() if not o.model_fields[key].is_required()), None
            )
            name = _value_at(tree, path[:-1]).get(key, unnamed)
            if name in by_name:
                return _Chosen(key, name, by_name.pop(name), by_name)
    return None


def _names(model: type[BaseModel], key: str) -> tuple[Any, ...]:
    field = model.model_fields.get(key)
    is_choice = field is not None and get_origin(field.annotation) is Literal
    return get_args(field.annotation) if field is not None and is_choice else ()


def _known_key(path: Path, model: type[BaseModel], other_keys: Sequence[str]) -> str:
    """The known key nearest to an unknown one: a slip in its own table, or its name in another."""
    key, dotted = str(path[-1]), [*keys_of(model), *other_keys]
    tables = _tables_at(path[:-1], model)
    beside = sorted({name for table in tables for name in table.model_fields})
    elsewhere = [name for name in dotted if name.rpartition(".")[2] == key]
    return (
        did_you_mean(key, beside, SLIP_LIKENESS_MIN)
        or suggestion(elsewhere)
        or did_you_mean(key, beside)
    )


def keys_of(model: type[BaseModel], before: str = "") -> list[str]:
    """Every dotted key of a model and of the tables in it, once, but for items of lists."""
    keys = []
    for name, field in model.model_fields.items():
        keys.append(before + name)
        if get_origin(field.annotation) not in (tuple, list):
            for table in models_in(field.annotation):
                keys += keys_of(table, f"{before}{name}.")
    return list(dict.fromkeys(keys))


def _tables_at(path: Path, model: type[BaseModel]) -> list[type[BaseModel]]:
    """The models that the value at a path may be of."""
    tables = [model]
    for part in path:
        if isinstance(part, str):
            fields = [table.model_fields[part] for table in tables if part in table.model_fields]
            others = [model_of_others(table) for table in tables if part not in table.model_fields]
            tables = [table for field in fields for table in models_in(field.annotation)]
            tables += [table for table in others if table is not None]
    return tables


def _items(count: int) -> str:
    return "1 item" if count == 1 else f"{count} items"


def _bare(name: str) -> str:
    return str(name).strip("'\"")
