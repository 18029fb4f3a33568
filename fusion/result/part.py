"""What every part of a result is: a frozen record that keeps to its kinds, and knows what was stated and what was not.

A key that was not stated is absent from the JSON again; None is null, and stands where something was looked for and is
not there. Keys that no part names are kept as they came, so that results of other versions can be read and written.
"""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
WholeOrNumber = Annotated[int | float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]
"""A number that stays a whole one where it is one: the sum over nothing is 0, not 0.0."""
Count = Annotated[int, Field(ge=0, le=10**12)]
# JSON has lists only: a list is taken for a tuple, what is in it is taken strictly all the same
Interval = Annotated[tuple[Number, Number], Field(strict=False)]
Numbers = Annotated[tuple[Number, ...], Field(strict=False)]
Flags = Annotated[tuple[bool, ...], Field(strict=False)]
Texts = Annotated[tuple[str, ...], Field(strict=False)]


class Part(BaseModel):
    """A part of a result."""

    model_config = ConfigDict(strict=True, frozen=True, extra="allow", populate_by_name=True)


def as_json(value: object) -> object:
    """Return the dumped ``value`` with lists for its tuples, as JSON read back has it."""
    if isinstance(value, dict):
        return {key: as_json(inner) for key, inner in value.items()}
    return [as_json(inner) for inner in value] if isinstance(value, list | tuple) else value
