"""An alignment in the JSON of a result."""

from dataclasses import asdict, fields
from typing import Annotated

from pydantic import Field

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result.part import Number, Part

_Row = Annotated[tuple[Number, Number, Number], Field(strict=False)]
_Matrix = Annotated[tuple[_Row, _Row, _Row], Field(strict=False)]


class StoredAlignment(Part):
    """An :class:`~endoct.fusion.geometry.alignment.Alignment` as it is stored; None for what was not stored."""

    theta_shift_rad: Number
    z_shift_mm: Number
    z_scale: Number
    mirrored: bool
    z_reversed: bool
    confidence: Number
    correlation: Number | None = None
    ratio: Number | None = None
    chance: Number | None = None
    overlap_mm2: Number | None = None
    uneven_rad: Number | None = None
    twist_rad_per_mm: Number | None = None
    covariance: _Matrix | None = None

    @classmethod
    def of(cls, alignment: Alignment | None) -> "StoredAlignment | None":
        """Return ``alignment`` as it is stored."""
        return None if alignment is None else cls(**asdict(alignment))

    def to_alignment(self) -> Alignment:
        """Return the alignment that was stored; what was not stored is as of one that nobody measured."""
        known = {field.name: getattr(self, field.name) for field in fields(Alignment)}
        return Alignment(**{name: value for name, value in known.items() if value is not None})
