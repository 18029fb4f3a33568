"""One annulus a frame from what was measured in each: the radii belong to the probe, only the place moves."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter

from endoct.modalities.endoscope.mirror.annulus import FAINTEST_SUPPORT, Annulus, Followed
from endoct.stitching.arrays import Coordinates, Mask
from endoct.stitching.robust import robust_sigmas

MOST_CHANGE = 0.05
MOST_BLUR = 0.3


def settle_annuli(followed: Sequence[Followed], reference: Annulus, given: bool) -> tuple[list[Annulus], Mask]:
    """Return one annulus a frame with the same radii in all, and which of them were measured, bool (n,).

    The radii belong to the probe and are the recording's medians, or the ``given`` ones; so is the way from
    one centre to the other. Only the place moves. Where a frame's rims were lost, or lie apart from its
    neighbours', the place is interpolated.
    """
    inner = np.array([(f.annulus.inner_x_px, f.annulus.inner_y_px, f.annulus.inner_px) for f in followed])
    outer = np.array([(f.annulus.outer_x_px, f.annulus.outer_y_px, f.annulus.outer_px) for f in followed])
    located = np.array([f.support for f in followed]) >= FAINTEST_SUPPORT
    for measured, expected in ((inner[:, 2], reference.inner_px), (outer[:, 2], reference.outer_px)):
        if not given:  # where the annulus wanders, a mean image has its small rim too large; the frames agree
            near = located & (np.abs(measured / expected - 1) < MOST_BLUR)
            expected = float(np.median(measured[near])) if near.any() else expected
        located = located & (np.abs(measured - expected) < max(MOST_CHANGE * expected, 1.0))
    if not located.any():
        return [reference] * len(followed), located
    between = np.median(inner[located, :2] - outer[located, :2], axis=0)
    inner_px, outer_px = float(np.median(inner[located, 2])), float(np.median(outer[located, 2]))
    if given:
        inner_px, outer_px = reference.inner_px, reference.outer_px
    place = (outer[:, :2] + inner[:, :2] - between) / 2
    located &= ~_outlying(place, located, tolerance_px=0.01 * outer_px)
    index = np.arange(len(followed))
    x, y = (np.interp(index, index[located], place[located, axis]) for axis in (0, 1))
    return [
        Annulus(float(a + between[0]), float(b + between[1]), inner_px, float(a), float(b), outer_px)
        for a, b in zip(x, y, strict=True)
    ], located


def _outlying(place: Coordinates, found: Mask, tolerance_px: float) -> Mask:
    """Say which places lie apart from the median of the nine around them."""
    course = np.where(found[:, None], place, np.median(place[found], axis=0))
    away = np.abs(course - median_filter(course, size=(min(9, len(course)), 1), mode="nearest"))
    spread = robust_sigmas(away)
    outlying: Mask = (away > np.maximum(tolerance_px, 6 * spread)).any(axis=1)
    return outlying
