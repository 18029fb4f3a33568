"""Whether cells end short along z on the side that sees light: what is lit and smooth there looks like wall."""

import numpy as np

from endoct.base.doubt import Doubt
from endoct.fusion.wall.both_sides import BothSides

REACH_MM = 0.5
"""Ends of one cell lie no farther apart on both sides."""
LEAST_SHORT_MM = 0.08
"""Cells that are shorter by less are not doubted: those of sound pairs are by up to half of it."""
LEAST_ARC_MM = 3.0
"""With fewer ends of cells, taken together along θ, nothing is said."""
MOSTLY = 2.0
"""One end is named where cells end short there by so many times what they do at the other."""


def short_ends_mm(sides: BothSides) -> tuple[float, float]:
    """Return by how much cells end short of those by depth toward smaller and toward larger z, in the median.

    They are negative where cells end beyond those by depth, and NaN where too few end there on both sides.
    """
    light, depth = sides.cells[sides.light_side], sides.cells[sides.depth_side]
    both = sides.observed[0] & sides.observed[1]
    reach = max(2, round(REACH_MM / sides.grid.dz_mm))
    inward = np.arange(1 - reach, reach)
    medians = []
    for down in (slice(None, None, -1), slice(None)):
        light_so, depth_so, both_so = light[down], depth[down], both[down]  # an end is toward higher rows
        row, column = np.nonzero(depth_so[:-1] & ~depth_so[1:] & both_so[:-1] & both_so[1:])
        at = np.clip(row[:, np.newaxis] - inward, 0, len(light) - 1)
        is_light = light_so[at, column[:, np.newaxis]]
        ends = np.abs(np.where(is_light[:, 1:] & ~is_light[:, :-1], inward[1:], 2 * inward[-1]))
        nearest = ends.argmin(axis=1)
        seen = ends[np.arange(row.size), nearest] < 2 * inward[-1]
        enough = np.count_nonzero(seen) * sides.grid.dtheta_mm >= LEAST_ARC_MM
        medians.append(float(np.median(inward[1:][nearest[seen]])) * sides.grid.dz_mm if enough else np.nan)
    return medians[0], medians[1]


def doubt_of_short_ends(sides: BothSides, names: tuple[str, str]) -> Doubt | None:
    """Return the doubt about the side that sees light, by ``names``, where its cells end short along z; else None.

    Both ends count together, since an alignment may share out between them what is missing at one.
    """
    smaller_mm, larger_mm = short_ends_mm(sides)
    short_mm = smaller_mm + larger_mm
    if not short_mm >= LEAST_SHORT_MM:
        return None
    one_end = max(smaller_mm, larger_mm) >= MOSTLY * min(smaller_mm, larger_mm)
    where = f", mostly at the end toward {'larger' if larger_mm > smaller_mm else 'smaller'} z" if one_end else ""
    what = (
        f"Cells are {short_mm:.2f} mm shorter along z than those of {names[sides.depth_side]}{where}. "
        "Floors that are lit there may have been taken for wall."
    )
    side = names[sides.light_side]
    return Doubt("cells-end-short", what, side=side, value=short_mm, unit="mm", expected=(0.0, LEAST_SHORT_MM))
