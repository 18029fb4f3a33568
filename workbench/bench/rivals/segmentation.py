"""What one would write with scikit-image, OpenCV or SciPy to find cells, in a few lines each.

Each takes the depth where a panorama has it, else the darkness of the raw intensity, lightly blurred. None knows
anything of the wall's course or of the light, or that θ is a circle. ``…_prepared`` get what ours thresholds, and the
same cleaning afterwards: they differ from ours in the threshold or the contour alone.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage import filters, morphology, segmentation

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.circle import masked_gaussian, pad_circle
from endoct.fusion.evidence.evidence import Evidence, prepare
from endoct.fusion.segmentation.cleaning import clean
from endoct.fusion.segmentation.li_alone import bounds
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.threshold import li_threshold
from endoct.stitching.panorama import Panorama

BLUR_MM = 0.015
WINDOW_MM = 1.5
"""Window of local thresholds, some three typical cells across."""
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


def multi_otsu(panorama: Panorama) -> Mask:
    """Three classes by Otsu's criterion, what is not the front one is cell (scikit-image)."""
    return _above(panorama, lambda values: filters.threshold_multiotsu(values, classes=3)[0])


def k_means(panorama: Panorama) -> Mask:
    """Two clusters of depth, or of intensity (OpenCV)."""
    image = _image(panorama)
    values = np.ascontiguousarray(image[panorama.valid][:, np.newaxis])
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    centres = cv2.kmeans(values, 2, np.zeros((0, 1), np.int32), criteria, 3, cv2.KMEANS_PP_CENTERS)[2]
    return np.asarray(panorama.valid & (image > centres.mean()))


def local_threshold(panorama: Panorama) -> Mask:
    """A threshold at the mean of a Gaussian window (scikit-image)."""
    rows, columns = _window_px(panorama)
    image = _image(panorama)
    local = filters.threshold_local(image, (rows, columns), method="gaussian", offset=-0.5 * float(image.std()))
    return np.asarray(panorama.valid & (image > local))


def adaptive_gaussian(panorama: Panorama) -> Mask:
    """OpenCV's adaptive threshold on 8 bits; its window is square in pixels."""
    image = _image(panorama)
    low, high = np.percentile(image[panorama.valid], [0.5, 99.5])
    grey = np.clip((image - low) / max(high - low, 1e-9) * 255, 0, 255).astype(np.uint8)
    block = 2 * (max(_window_px(panorama)) // 2) + 1
    mask = cv2.adaptiveThreshold(grey, 255, cv2.ADAPTIVE_THRESH_GAUSSIAN_C, cv2.THRESH_BINARY, block, -20)
    return np.asarray(panorama.valid & (mask > 0))


def chan_vese(panorama: Panorama) -> Mask:
    """Chan and Vese's active contours, morphological (scikit-image), started from Otsu's threshold."""
    image = _image(panorama)
    mask = segmentation.morphological_chan_vese(image, 40, init_level_set=otsu(panorama), smoothing=1)
    return np.asarray(panorama.valid & (mask > 0))


def chan_vese_prepared(panorama: Panorama) -> Mask:
    """The same on what ours thresholds, on the circle, started from the triangle threshold, and cleaned as ours."""
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


def top_hat(panorama: Panorama) -> Mask:
    """A white top-hat as wide as the widest cells, then Otsu's threshold (scikit-image)."""
    image = _image(panorama)
    hat = image - morphology.opening(image, np.ones(_window_px(panorama), np.uint8))
    return np.asarray(panorama.valid & (hat > filters.threshold_otsu(hat[panorama.valid])))


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


def _window_px(panorama: Panorama) -> tuple[int, int]:
    """Return the odd height and width of the window of local methods."""
    rows, columns = WINDOW_MM / panorama.grid.dz_mm, WINDOW_MM / panorama.grid.dtheta_mm
    return 2 * int(rows / 2) + 1, 2 * int(columns / 2) + 1
