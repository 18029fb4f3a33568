"""Sizes of pixels and steps as formats of microscopes state them, as keys of a sidecar.

Such formats know lengths along columns, rows and frames, and times. They do not know what a B-scan is. The step along
rows is taken for the axial pixel; whether it is meant in air is left open.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from endoct.modalities.reading.format import Stated
from endoct.modalities.reading.remarks import NONE, Remarks

_PREFIXES = {"m": 1e3, "cm": 10.0, "mm": 1.0, "µm": 1e-3, "μm": 1e-3, "um": 1e-3, "nm": 1e-6, "Å": 1e-7, "in": 25.4}
_WORDS = {"meter": 1e3, "centimeter": 10.0, "millimeter": 1.0, "micrometer": 1e-3, "nanometer": 1e-6,
          "angstrom": 1e-7, "inch": 25.4}  # fmt: skip
MM: Mapping[str, float] = _PREFIXES | _WORDS
"""A unit of length has this many millimetres; its name is that of OME's schema or Zarr's multiscales."""
SECONDS: Mapping[str, float] = {
    "s": 1.0, "ms": 1e-3, "µs": 1e-6, "μs": 1e-6, "min": 60.0, "second": 1.0, "millisecond": 1e-3, "microsecond": 1e-6,
    "minute": 60.0,
}  # fmt: skip


@dataclass(frozen=True)
class Steps:
    """What a file states: ``row_mm`` between rows, ``frame_mm`` or ``frame_s`` between frames; None where nothing."""

    row_mm: float | None = None
    frame_mm: float | None = None
    frame_s: float | None = None

    def stated(self, by: str) -> Stated:
        """Return the keys that these are, of a pullback and of an endoscope."""
        keys: dict[str, Any] = {}
        if self.row_mm is not None:
            keys["axial_pixel_mm"] = self.row_mm
        if self.frame_mm is not None:
            keys |= {"pullback_pitch_mm": self.frame_mm, "feed_pitch_mm": self.frame_mm}
        if self.frame_s is not None:
            keys["frame_rate_hz"] = 1 / self.frame_s
        return Stated(keys, by)

    @property
    def remarks(self) -> Remarks:
        """A note where the step of rows may be taken for what it is not."""
        if self.row_mm is None:
            return NONE
        note = f"The file states {self.row_mm:g} mm between rows. Of B-scans that counts as axial_pixel_mm, in air."
        return Remarks(notes=(note,))


def in_units(value: object, unit: object, units: Mapping[str, float]) -> float | None:
    """Return a step in mm or s by its unit; None where there is no positive number, or the unit is no such."""
    factor = units.get(unit) if isinstance(unit, str) else None
    try:
        number = float(value)  # type: ignore[arg-type]  # whatever a file has there
    except (TypeError, ValueError, OverflowError):
        return None
    return number * factor if factor is not None and 0 < number < 1e12 else None
