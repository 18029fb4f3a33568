"""Numbers per frame of a side as the report plots and lists them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.numeric.circle import wrap_rad
from endoct.workbench.report.side_findings import SideFindings
from endoct.workbench.report.wording import NOTHING

MAX_COMPONENTS = 4
"""A vector per frame with more components is not plotted."""
ROUNDING = 1e-9
"""Smaller numbers are 0 but for rounding, in whatever unit."""
MOST_WITHOUT_RANGE = 4
"""Numbers that come first where a plug-in declares no usual range of any."""


@dataclass(frozen=True, eq=False)
class Number:
    """One number per frame, float64 (n_frames,): its name in the store, title, unit and usual range.

    Angles are in degrees, within half a turn of their mean, so that none jumps at 0 or 360 without need.
    """

    name: str
    values: NDArray[np.float64]
    title: str
    unit: str
    usual: tuple[float, float] | None

    @property
    def varies(self) -> bool:
        """Whether it differs from frame to frame."""
        finite = self.values[np.isfinite(self.values)]
        return finite.size > 0 and bool(np.ptp(finite) > 1e-9 * max(1.0, float(np.abs(finite).max())))

    @property
    def axis_title(self) -> str:
        """The title with the unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


def numbers_per_frame(side: SideFindings) -> list[Number]:
    """Return every number per frame, by name; a short vector as its components. Flags and places are left out."""
    numbers: list[Number] = []
    dim = side.panorama.frame_dim
    for name, one in sorted(side.panorama.per_frame.items()):  # a Zarr group keeps no order
        values, kind = one.values, one.values.dtype
        if name in (f"{dim}_z_mm", f"{dim}_index") or kind == np.bool_ or not np.issubdtype(kind, np.number):
            continue
        if values.ndim == 1:
            parts = {"": values}
        elif values.ndim == 2 and values.shape[1] <= MAX_COMPONENTS:
            parts = {f" [{k}]": values[:, k] for k in range(values.shape[1])}
        else:
            continue
        for part, own in parts.items():
            numbers.append(number_of(name + part, own.astype(np.float64), one.title + part, one.unit, one.usual))
    return [one for one in numbers if one.values.size == side.frame_z_mm.size and np.isfinite(one.values).any()]


def main_and_others(side: SideFindings) -> tuple[list[Number], list[Number]]:
    """Return the few numbers that say how good the frames are, and all others that vary."""
    numbers = numbers_per_frame(side)
    varying = [number for number in numbers if number.varies]
    main = [number for number in numbers if number.usual] or varying[:MOST_WITHOUT_RANGE]
    return main, [one for one in varying if one not in main]


def number_rows(side: SideFindings) -> Iterator[list[str]]:
    """Yield [name in the store, meaning, usual range, range here] of every number per frame."""
    for one in numbers_per_frame(side):
        unit = one.unit if one.unit in ("", "°") else f" {one.unit}"
        low, high = (float(value) for value in np.nanpercentile(one.values[np.isfinite(one.values)], (5, 95)))
        here = _between(low, high) + unit
        if one.unit == "°":  # the store, by whose name it goes, has it in rad
            here += f" ({_between(math.radians(low), math.radians(high))} rad)"
        yield [one.name, one.title, NOTHING if one.usual is None else range_text(one.usual) + unit, here]


def _between(low: float, high: float) -> str:
    return _text(low) if _text(low) == _text(high) else f"{_text(low)} to {_text(high)}"


def range_text(usual: tuple[float, float]) -> str:
    """Return "0.6 to 1", "at least 15" or "at most 3"."""
    low, high = usual
    if math.isinf(high):
        return f"at least {_text(low)}"
    return f"at most {_text(high)}" if math.isinf(low) else f"{_text(low)} to {_text(high)}"


def number_of(
    name: str, values: NDArray[np.float64], title: str, unit: str, usual: tuple[float, float] | None
) -> Number:
    """Return one number per frame, float64 (n_frames,), as people read it: an angle in degrees."""
    if unit != "rad":
        return Number(name, values, title, unit, usual)
    in_degrees = None if usual is None else (math.degrees(usual[0]), math.degrees(usual[1]))
    return Number(name, np.degrees(_around_mean(values)), title, "°", in_degrees)


def _around_mean(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles within half a turn of their mean on the circle."""
    finite = angle_rad[np.isfinite(angle_rad)]
    if not finite.size:
        return angle_rad
    mean = float(np.angle(np.exp(1j * finite).mean()))
    mean = mean if mean > -np.pi / 2 else mean + 2 * np.pi
    return np.asarray(mean + wrap_rad(angle_rad - mean))


def _text(value: float) -> str:
    return f"{0.0 if abs(value) < ROUNDING else value:.3g}".replace("-", "−")
