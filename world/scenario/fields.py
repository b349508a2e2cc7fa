"""What the scenario's models are built of: their base, and fields with units and ranges.

A field is declared once: its type carries range and unit, the docstring below it the meaning.
``docs/scenario.md`` is made of these (``encircle.world.loading.describe``).
"""

from collections.abc import Iterator
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field

from encircle.protocol.parameters import Unit

ROBOTS_MAX = 256
LENGTH_M_MAX = 1e5
DELAY_S_MAX = 600.0
SEED_END = 2**63

Coordinate = Annotated[
    float, Field(ge=-LENGTH_M_MAX, le=LENGTH_M_MAX, allow_inf_nan=False), Unit("m")
]
Position = tuple[Coordinate, Coordinate]
Length = Annotated[float, Field(gt=0.0, le=LENGTH_M_MAX, allow_inf_nan=False), Unit("m")]
Deviation = Annotated[float, Field(ge=0.0, le=LENGTH_M_MAX, allow_inf_nan=False), Unit("m")]
Seconds = Annotated[float, Field(ge=0.0, le=DELAY_S_MAX, allow_inf_nan=False), Unit("s")]
PositiveSeconds = Annotated[float, Field(gt=0.0, le=DELAY_S_MAX, allow_inf_nan=False), Unit("s")]
Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Tick = Annotated[int, Field(ge=0, le=10_000_000), Unit("tick")]
Ticks = Annotated[int, Field(ge=1), Unit("ticks")]
Replay = Literal["repeat", "shifted", "resample"]


class Model(BaseModel):
    """A part of a scenario: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


def shown(value: object) -> str:
    """A value as error messages show it: as Python would, cut short if it is long."""
    text = repr(value)
    return text if len(text) <= 80 else text[:80] + "..."


def model_of_others(model: type[BaseModel]) -> type[BaseModel] | None:
    """The model of the tables that a table may have under names of its own, None if it has none."""
    hint = get_type_hints(model, include_extras=True).get("__pydantic_extra__")
    return next(models_in(hint), None) if model.model_config.get("extra") == "allow" else None


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """The models of which an annotation's value can be, or hold some."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) is not Literal:
        for part in get_args(annotation):
            yield from models_in(part)
