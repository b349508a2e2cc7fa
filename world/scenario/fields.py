"""What the scenario's models are built of: their base, and fields with units and ranges."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

ROBOTS_MAX = 256

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
Position = tuple[Coordinate, Coordinate]
Length = Annotated[float, Field(gt=0.0, le=1e5, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0.0, le=600.0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Tick = Annotated[int, Field(ge=0, le=10_000_000)]
Ticks = Annotated[int, Field(ge=1)]


class Model(BaseModel):
    """A part of a scenario: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


def shown(value: object) -> str:
    """A value as error messages show it: as Python would, cut short if it is long."""
    text = repr(value)
    return text if len(text) <= 80 else text[:80] + "..."
