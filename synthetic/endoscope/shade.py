"""How steeply bone rises along the bore next to every place of a wall: which light can reach it, in any frame."""

import numpy as np

from endoct.stitching.arrays import Image
from endoct.synthetic.bone.maps import WallMaps

EVERY_COLUMN = 2
"""Columns of the wall's maps to one of the shade's."""
REACH = 1.2
"""How far along the bore bone is looked for that may cast a shadow, in mm for each mm of depth: no light comes in at a
steeper slant."""
GROWS = 1.1
"""Distances that are looked at lie one row apart at first, then in this ratio."""
COLUMNS_AT_ONCE = 64


def shade_of(wall: WallMaps) -> Image:
    """Return the steepest rise of bone towards the bore's axis, mm/mm, float32 (n_z, n_theta/2, 2).

    At smaller z and at larger z of each place; a ray that comes along the bore at dz/dr is blocked where their product
    is over 1.
    """
    relief = np.ascontiguousarray(wall.relief_mm[:, ::EVERY_COLUMN])
    least, most = wall.relief_range_mm
    shade = np.zeros((*relief.shape, 2), np.float32)
    rows = _distances(min(relief.shape[0] - 1, int(REACH * (most - least) / wall.dz_mm)))
    for first in range(0, relief.shape[1], COLUMNS_AT_ONCE):
        part = np.ascontiguousarray(relief[:, first : first + COLUMNS_AT_ONCE])
        before, behind = np.zeros_like(part), np.zeros_like(part)
        for k in rows:
            rise = part[k:] - part[:-k]
            rise *= np.float32(1 / (k * wall.dz_mm))
            np.maximum(before[k:], rise, out=before[k:])
            np.maximum(behind[:-k], -rise, out=behind[:-k])
        shade[:, first : first + COLUMNS_AT_ONCE, 0] = before
        shade[:, first : first + COLUMNS_AT_ONCE, 1] = behind
    return shade


def _distances(most: int) -> list[int]:
    rows, at = [], 1.0
    while at <= most:
        rows.append(int(at))
        at = max(at + 1, at * GROWS)
    return rows
