"""Cells by Li's threshold alone: evidence smoothed, kept within bounds, thresholded, and cleaned on the circle.

That is all where a side is segmented by its depth. In an image, outlines and lines go on from here, or a learned eye
finds cells instead.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import masked_gaussian
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.segmentation.cleaning import clean
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.threshold import li_threshold

LEAST_RELIEF_SIGMAS = 4.0
"""The least threshold of relief, as a multiple of the wall's own spread. Li's threshold lies at 7 of these and more in
bores with cells, at 0.3 without any."""


@dataclass(frozen=True, eq=False)
class AboveLi:
    """What lies above Li's threshold.

    Attributes
    ----------
    mask: the cells, bool (n_z, n_theta), False where nothing was observed.
    threshold: in mm of relief, or a difference of logarithms.
    smooth: the evidence, smoothed, float32 (n_z, n_theta).
    low, high: the values between which the threshold was sought.
    was_raised: whether Li's threshold lay within the wall's own relief, and this one lies beyond it.
    """

    mask: Mask
    threshold: float
    smooth: Image
    low: float
    high: float
    was_raised: bool = False


def above_li(evidence: Evidence, parameters: SegmentParameters) -> AboveLi:
    """Return what lies above Li's threshold of ``evidence``, opened, closed, and without small cells.

    Where Li's threshold lies within the wall's own relief there are hardly any cells, and it is raised beyond that.
    Raises :class:`EndoctError` where all evidence is alike.
    """
    p = parameters
    smooth = masked_gaussian(
        evidence.values, evidence.valid, p.smooth_mm / evidence.dz_mm, p.smooth_mm / evidence.column_mm
    )
    low, high = bounds(evidence, smooth, p)
    prepared = np.clip(smooth, low, high)
    try:
        threshold = li_threshold(prepared[evidence.valid])
    except EndoctError as error:
        raise EndoctError(
            "a side shows no cells to threshold", found=error.found, expected="wall and cells that differ"
        ) from error
    least = _least_threshold(smooth[evidence.valid], p) if evidence.kind == "relief" else threshold
    was_raised, threshold = threshold < least, max(threshold, least)
    mask = clean(evidence.valid & (prepared > threshold), evidence.dz_mm, evidence.column_mm, p) & evidence.valid
    return AboveLi(mask, threshold, smooth, low, high, was_raised)


def bounds(evidence: Evidence, smooth: Image, parameters: SegmentParameters) -> tuple[float, float]:
    """Return the values of ``evidence``, smoothed, between which the threshold is sought: below is wall, above is cell.

    There are no cells in front of the wall, so what lies there shows the wall's own spread. Where nothing stands out
    of that spread, the floor of contrast is 0.
    """
    p = parameters
    if evidence.kind == "relief":
        return p.relief_floor_mm, p.relief_cap_mm
    contrast = smooth[evidence.valid]
    # a floor near the cap would leave nothing between them
    floor = min(p.contrast_floor_sigmas * spread_of_wall(contrast), p.contrast_cap / 2)
    return (floor if (contrast > floor).any() else 0.0), p.contrast_cap


def spread_of_wall(observed: NDArray[np.float32]) -> float:
    """Return the standard deviation of the wall's own evidence, by what lies in front of it, below 0."""
    front = observed[observed < 0]
    return robust_sigma(front) if front.size else 0.0


def _least_threshold(relief_mm: Image, parameters: SegmentParameters) -> float:
    """Return the least threshold of relief (n,), mm: Li's method splits even a wall without cells."""
    return min(LEAST_RELIEF_SIGMAS * spread_of_wall(relief_mm), parameters.relief_cap_mm / 2)
