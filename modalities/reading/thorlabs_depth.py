"""How far depth samples of a ThorImage file lie apart: its header says so up to three times, in some medium."""

from endoct.modalities.reading.remarks import NONE, Remarks, doubted
from endoct.modalities.reading.thorlabs_header import Header

ALIKE = 0.01
"""Lengths that say the same may differ by this share."""
LEAST_PIXEL_MM, MOST_PIXEL_MM = 1e-4, 0.2
"""Depth samples lie so far apart; what a header says beyond is of something else."""


def axial_pixel_mm(header: Header, range_z_mm: float | None, n_depth: int, name: str) -> tuple[float | None, Remarks]:
    """Return the distance of ``n_depth`` samples in air, mm; None where it is not said, or not to be believed.

    ``range_z_mm``: what is said of the data; ``name``: of the file, for doubts.
    """
    said = {"RangeZ of its data": range_z_mm and range_z_mm / n_depth}
    if header.size_z in (None, n_depth):
        said |= {"SizeReal": header.depth_mm and header.depth_mm / n_depth, "PixelSpacing": header.depth_pixel_mm}
    pixels = {where: pixel for where, pixel in said.items() if pixel}
    if not pixels:
        return None, NONE
    pixel_mm, index = next(iter(pixels.values())), header.refractive_index
    if not all(alike(pixel_mm, other) for other in pixels.values()):
        listed = ", ".join(f"{1000 * pixel:.4g} µm by {where}" for where, pixel in pixels.items())
        what = f"The header of {name} gives several distances of depth samples, none of which was taken: {listed}."
        return None, doubted("thorlabs-depth", what)
    if index is None or index == 1:
        return _plausible(pixel_mm), NONE
    what = f"The header of {name} applies a refractive index of {index:g} to the whole image"
    if not 1 < index <= 2:
        return None, doubted("thorlabs-index", f"{what}, which none has: its depths were not taken.", index, 1.0)
    what += ": depths are divided by it. It should be that of what fills the bore; where that is another, state "
    return _plausible(pixel_mm * index), doubted("thorlabs-index", f"{what}medium_index.", index, 1.0)


def _plausible(axial_mm: float) -> float | None:
    return axial_mm if LEAST_PIXEL_MM <= axial_mm <= MOST_PIXEL_MM else None


def alike(number: float, other: float) -> bool:
    """Say whether two numbers are the same, as programs round them."""
    return abs(number - other) <= ALIKE * max(abs(number), abs(other))
