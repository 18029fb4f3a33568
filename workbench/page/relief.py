"""The relief as one small array, from which the page builds the wall in three dimensions."""

import numpy as np

from endoct.workbench.page.plane import Plane
from endoct.workbench.page.wall import Wall

MOST_SAMPLES = 350_000
"""Of a relief: 0.7 MB, and no more corners than any machine draws smoothly."""
FINEST_LEVEL = 2
"""Whose pixels the columns are: 1024 around."""
LAST_CODE = 65_535


def relief_bytes(plane: Plane, wall: Wall, most_samples: int = MOST_SAMPLES) -> bytes:
    """Return what ``plane`` shows, in mm, at its own rows and in columns around the circle.

    All is little-endian: the numbers of rows and of columns as uint32; the values of the codes 1 and 65 535 as float32;
    z of every row in mm as float32, ascending; then codes as uint16, row by row, 0 where nothing was observed. Column j
    of n has its centre at θ = (j + ½) · 2π/n. Where there are more rows than fit, each is the mean of some.
    """
    level = min(wall.level_for(plane.placing.dtheta_mm(wall.radius_mm)), FINEST_LEVEL)
    row_mm, found = plane.own_rows(wall, level, max(2, most_samples // wall.width_px(level)))
    known = found.values[found.known]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    share = (found.values - low) / max(high - low, 1e-9)
    codes = np.where(found.known, 1 + np.rint(share * (LAST_CODE - 1)), 0).astype("<u2")
    sizes, limits = np.array(codes.shape, "<u4"), np.array([low, high], "<f4")
    return b"".join(part.tobytes() for part in (sizes, limits, row_mm.astype("<f4"), codes))
