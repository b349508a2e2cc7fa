"""Tables of which one key, ``model``, says which keys the others are.

Each model is a class with its own keys, and pydantic chooses among them by the name (a
discriminated union). Two things are added here. A table without a name is one of the default
model. And a key of another model that says nothing, since it holds null or its default, is passed
over: scenarios recorded by earlier versions have the keys of all models in each table.
"""

from collections.abc import Callable, Mapping
from typing import Any, get_args

from encircle.world.scenario.fields import Model

MODEL = "model"
FORMER_DEFAULTS: Mapping[str, Any] = {"std_s": 0.0}
"""Of keys that have no default any more."""


def models_by_name(*models: type[Model]) -> dict[str, type[Model]]:
    """Models by the name that each takes as its ``model``."""
    return {get_args(model.model_fields[MODEL].annotation)[0]: model for model in models}


def completed(default: str, models: Mapping[str, type[Model]]) -> Callable[[Any], Any]:
    """What is done to a table before it is checked: see this module's first lines."""
    defaults: dict[str, list[Any]] = {key: [None, value] for key, value in FORMER_DEFAULTS.items()}
    for model in models.values():
        for key, field in model.model_fields.items():
            unset = None if field.is_required() else field.default
            unset = list(unset) if isinstance(unset, tuple) else unset
            defaults.setdefault(key, [None]).append(unset)

    def complete(table: Any) -> Any:
        if not isinstance(table, Mapping):
            return table
        name = table.get(MODEL, default)
        own = models[name].model_fields if isinstance(name, str) and name in models else table
        kept = {
            key: value
            for key, value in table.items()
            if key in own or value not in defaults.get(key, ())
        }
        return {**kept, MODEL: name}

    return complete
