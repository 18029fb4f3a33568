"""What one would write with scikit-image, OpenCV or SciPy to find cells, in a few lines each.

Each takes the depth where a panorama has it, else the darkness of the raw intensity, lightly blurred. None knows
anything of the wall's course or of the light, or that θ is a circle. ``…_prepared`` get what ours thresholds, and the
same cleaning afterwards: they differ from ours in the threshold or the contour alone.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage import filters, segmentation

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.circle import masked_gaussian, pad_circle
from endoct.fusion.evidence.evidence import Evidence, prepare
from endoct.fusion.segmentation.cleaning import clean
from endoct.fusion.segmentation.li_alone import bounds
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.threshold import li_threshold
from endoct.stitching.panorama import Panorama

BLUR_MM = 0.015
CONTOUR_STEPS, CELL_WEIGHT = 20, 30.0
"""For Chan and Vese's contours on prepared panoramas: steps, and the weight of deviations within a cell."""


def li_raw(panorama: Panorama) -> Mask:
    """Li's threshold on the raw intensity, cells dark (Laves 2019, taken literally)."""
    return panorama.valid & (panorama.intensity < li_threshold(panorama.intensity[panorama.valid]))


def li_depth(panorama: Panorama) -> Mask:
    """Li's threshold on the raw depth, or on the raw intensity where there is none."""
    return _above(panorama, filters.threshold_li)


def otsu(panorama: Panorama) -> Mask:
    """Otsu's threshold (scikit-image)."""
    return _above(panorama, filters.threshold_otsu)


def otsu_prepared(panorama: Panorama) -> Mask:
    """Otsu's threshold on what ours thresholds, cleaned as ours."""
    return _prepared(panorama, filters.threshold_otsu)


def triangle_prepared(panorama: Panorama) -> Mask:
    """The triangle threshold on what ours thresholds, cleaned as ours."""
    return _prepared(panorama, filters.threshold_triangle)


def k_means(panorama: Panorama) -> Mask:
    """Two clusters of depth, or of intensity (OpenCV)."""
    image = _image(panorama)
    values = np.ascontiguousarray(image[panorama.valid][:, np.newaxis])
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    centres = cv2.kmeans(values, 2, np.zeros((0, 1), np.int32), criteria, 3, cv2.KMEANS_PP_CENTERS)[2]
    return np.asarray(panorama.valid & (image > centres.mean()))


def chan_vese_prepared(panorama: Panorama) -> Mask:
    """Chan and Vese's active contours, morphological (scikit-image), on what ours thresholds and on the circle.

    They start from the triangle threshold; the cells are cleaned as ours.
    """
    p, evidence = SegmentParameters(), prepare(panorama)
    values = _smooth_and_capped(evidence, p)
    known = values[evidence.valid]
    image = np.where(evidence.valid, values, np.median(known))
    around = image.shape[1] // 8
    start = pad_circle((image > filters.threshold_triangle(known)).astype(np.int8), around)
    mask = segmentation.morphological_chan_vese(
        pad_circle(image, around), CONTOUR_STEPS, init_level_set=start, smoothing=1, lambda2=CELL_WEIGHT
    )
    cells = mask[:, around:-around] > 0
    return clean(cells & evidence.valid, evidence.dz_mm, evidence.column_mm, p) & evidence.valid


def watershed(panorama: Panorama) -> Mask:
    """A watershed of the gradient, with markers well in front of and behind Otsu's threshold (scikit-image)."""
    image = _image(panorama)
    values = image[panorama.valid]
    threshold = float(filters.threshold_otsu(values))
    front, behind = float(values[values <= threshold].mean()), float(values[values > threshold].mean())
    markers = np.zeros(image.shape, np.int32)
    markers[image < 0.5 * (front + threshold)] = 1
    markers[image > 0.5 * (behind + threshold)] = 2
    return np.asarray(panorama.valid & (segmentation.watershed(filters.sobel(image), markers) == 2))


def _image(panorama: Panorama) -> Image:
    """Return depth, or negative intensity, blurred; invalid samples are as the median."""
    values = -panorama.intensity if panorama.depth_mm is None else panorama.depth_mm
    grid = panorama.grid
    blurred = masked_gaussian(values, panorama.valid, BLUR_MM / grid.dz_mm, BLUR_MM / grid.dtheta_mm)
    filled = np.where(panorama.valid, blurred, np.median(blurred[panorama.valid]))
    return np.asarray(filled, dtype=np.float32)


def _above(panorama: Panorama, threshold: Callable[[NDArray[np.float32]], float]) -> Mask:
    image = _image(panorama)
    return np.asarray(panorama.valid & (image > threshold(image[panorama.valid])))


def _prepared(panorama: Panorama, threshold: Callable[[NDArray[np.float32]], float]) -> Mask:
    p, evidence = SegmentParameters(), prepare(panorama)
    values = _smooth_and_capped(evidence, p)
    mask = evidence.valid & (values > threshold(values[evidence.valid]))
    return clean(mask, evidence.dz_mm, evidence.column_mm, p) & evidence.valid


def _smooth_and_capped(evidence: Evidence, p: SegmentParameters) -> Image:
    """Return the evidence smoothed and capped at both ends, as our own segmentation has it."""
    sigmas = p.smooth_mm / evidence.dz_mm, p.smooth_mm / evidence.column_mm
    smooth = masked_gaussian(evidence.values, evidence.valid, *sigmas)
    return np.asarray(np.clip(smooth, *bounds(evidence, smooth, p)), dtype=np.float32)
