"""The capillary from slice to slice: what strays from its neighbours, and what lies between them."""

from typing import Literal

import numpy as np

from endoct.modalities.oct.face.circle import Capillary
from endoct.stitching.arrays import Mask

STRAY_MM = 0.08
REACH = 3  # slices either side
LEAST_OFFSET_MM = 0.006  # nearer to the axis, an offset has no direction
FREE_RAD = 0.8  # typical change of the offset's direction from slice to slice, above which turns start anywhere


def starts_anywhere(capillary: Capillary, start: Literal["auto", "triggered", "free"]) -> bool:
    """Return whether turns start anywhere, so that the catheter's offset points another way in every slice."""
    if start != "auto":
        return start == "free"
    offset = (capillary.x_mm + 1j * capillary.y_mm)[capillary.known]
    offset = offset[np.abs(offset) > LEAST_OFFSET_MM]
    if offset.size < 4:
        return False
    return bool(np.median(np.abs(np.angle(offset[1:] * np.conj(offset[:-1])))) > FREE_RAD)


def steady_slices(capillary: Capillary, free: bool) -> Mask:
    """Return in which slices the circle is known and near to a neighbour's or to the median of six, bool (n_slices,).

    Where turns start anywhere (``free``), only how far off the axis they are can be compared.
    """
    steady = capillary.known.copy()
    if free:
        places = np.stack([capillary.offset_mm, np.zeros(len(capillary))], axis=1)
    else:
        places = np.stack([capillary.x_mm, capillary.y_mm], axis=1)
    for i in range(len(places)):
        before, after = places[max(0, i - REACH) : i], places[i + 1 : i + 1 + REACH]
        before, after = before[np.isfinite(before[:, 0])], after[np.isfinite(after[:, 0])]
        around = np.concatenate([before, after])
        if len(around) >= 2:
            typical = np.concatenate([before[-1:], after[:1], np.median(around, axis=0)[None]])
            if np.min(np.hypot(*(typical - places[i]).T)) > STRAY_MM:
                steady[i] = False
    return steady


def bridged(capillary: Capillary) -> Capillary:
    """Return the capillary with unknown slices interpolated linearly between known ones; one must be known."""
    every, known = np.arange(len(capillary)), np.flatnonzero(capillary.known)
    x, y, depth = (
        np.interp(every, known, values[known]) for values in (capillary.x_mm, capillary.y_mm, capillary.axis_depth_mm)
    )
    return Capillary(x, y, depth, capillary.radius_mm)
