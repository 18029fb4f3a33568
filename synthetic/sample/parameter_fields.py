"""Fields of parameters: numbers with their bounds, what they are drawn from, unit and source."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

Travel = Literal["in", "out"]
Stated = Literal["in", "out", "unknown"]
Factor = Annotated[float, Field(ge=-10, le=10)]
Harmonic = tuple[Factor, Factor]
"""Factors of the cosine and of the sine."""
Place = Annotated[float, Field(ge=-200, le=200)]
"""Places count mm along a bore, which is shorter than 100."""
Shift = Annotated[float, Field(ge=-10, le=10)]
"""Shifts count mm across the bore."""
Angle = Annotated[float, Field(ge=-1000, le=1000)]
"""Angles are in rad."""
Pixel = Annotated[float, Field(ge=-1e4, le=1e4)]
MOST_LISTED = 5000
"""A sample lists at most this many of anything."""
MOST_HARMONICS = 64
LARGEST_SEED = 2**64
STATED_ONLY = "stated only"
"""This key of a field's schema marks words that follow from what the user states and cannot be drawn."""


def drawn(low: float, high: float, about: str, allowed: tuple[float, float] | None = None) -> float:
    """Return the field of a number drawn from ``low`` to ``high`` unless the user states a range within ``allowed``.

    ``about`` holds its unit and its source.
    """
    return _field(*(allowed or (low, high)), about, {"draw": [low, high]})


def between(least: float, most: float, about: str) -> float:
    """Return the field of a number within these bounds; ``about`` holds its unit and its source."""
    return _field(least, most, about, {})


def _field(least: float, most: float, about: str, more: JsonDict) -> float:
    field: float = Field(ge=least, le=most, description=about, json_schema_extra=more)
    return field


class Parameters(BaseModel):
    """What was drawn of one thing: it knows its fields, does not change and holds no infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
