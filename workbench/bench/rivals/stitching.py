"""How one would place the strips with existing libraries, in a few lines each: pair after pair, then added up.

None of them knows that θ is a circle, or that light and dirt stay with the probe. ``…_prepared`` get strips without
what is the same in every strip and in every row, as ours does. So they differ from ours in the rest alone. Where a
library says how sure it is, a low value means "I do not know".
"""

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import cv2
import numpy as np
from skimage.registration import phase_cross_correlation

from endoct.base.arrays import Coordinates, Image
from endoct.stitching.strip import Strip
from endoct.workbench.bench.task import Declined, NotInstalled
from endoct.workbench.bench.tasks.stitching import StripPoses

UPSAMPLED = 20
LEAST_RESPONSE = 0.05
LEAST_ECC = 0.3
ASHLAR_SIGMA_PX = 2.0
FEWEST_ROWS = 8

Shift = tuple[float, float, bool]
"""Rows and columns by which the content lies lower than in the strip before, and whether that is known."""
Pairwise = Callable[[Image, Image, float], Shift]
"""(strip, the next one, nominal rows) → the shift between them."""
UNKNOWN: Shift = (np.nan, np.nan, False)
Method = Callable[[Sequence[Strip], float], StripPoses]


def _ashlar(images: Image, strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    try:
        from ashlar import utils
    except ImportError as error:
        raise NotInstalled("ashlar") from error
    whole = round(nominal_pitch_mm / row_mm(strips))
    n = images.shape[1] - abs(whole)
    if n < FEWEST_ROWS:
        raise Declined("strips at the nominal pitch hardly overlap")

    def register(a: Image, b: Image) -> tuple[float, float, float]:
        first, second = (a[whole:], b[:n]) if whole >= 0 else (a[:n], b[-whole:])
        (rows, columns), error = utils.register(first, second, ASHLAR_SIGMA_PX, UPSAMPLED)
        return whole + float(rows), float(columns), float(error)

    # strips far apart show nothing in common: what they score is chance
    apart = len(images) // 2
    null = [register(a, b)[2] for a, b in zip(images[:-apart], images[apart:], strict=True)]
    largest = float(np.percentile(null, 1)) if null else np.inf
    registered = [register(a, b) for a, b in pairwise(images)]
    return poses_of([(rows, columns, error < largest) for rows, columns, error in registered], strips, nominal_pitch_mm)


def _skimage(
    a: Image,
    b: Image,
    rows: float,  # noqa: ARG001
    normalization: str | None = "phase",
) -> Shift:
    shift = phase_cross_correlation(a, b, upsample_factor=UPSAMPLED, normalization=normalization)[0]
    return float(shift[0]), float(shift[1]), True


def _opencv_phase(a: Image, b: Image, rows: float) -> Shift:  # noqa: ARG001
    window = cv2.createHanningWindow((a.shape[1], a.shape[0]), cv2.CV_32F)
    (x, y), response = cv2.phaseCorrelate(b, a, window)
    return float(y), float(x), float(response) >= LEAST_RESPONSE


def _opencv_ecc(a: Image, b: Image, rows: float) -> Shift:
    start = np.array([[1, 0, 0], [0, 1, rows]], np.float32)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-5)
    try:
        # the template's (x, y) is the image's W(x, y)
        found, warp = cv2.findTransformECC(b, a, start, cv2.MOTION_TRANSLATION, criteria)
    except cv2.error:
        return UNKNOWN
    return float(warp[1, 2]), float(warp[0, 2]), float(found) >= LEAST_ECC


def poses_of(shifts: Sequence[Shift], strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """Return the poses that shifts add up to; the nominal pitch and no roll where a shift is not known."""
    rows, columns, known = (np.array(part) for part in zip(*shifts, strict=True))
    feed: Coordinates = np.where(known, rows * row_mm(strips), nominal_pitch_mm)
    roll: Coordinates = np.where(known, columns * float(strips[0].theta_rad[1] - strips[0].theta_rad[0]), 0.0)
    zero = np.zeros(1)
    return StripPoses(
        np.concatenate([zero, np.cumsum(feed)]),
        np.concatenate([zero, np.cumsum(roll)]),
        np.concatenate([[True], known.astype(np.bool_)]),
    )


def row_mm(strips: Sequence[Strip]) -> float:
    """Return the distance of two rows of the strips, mm."""
    return float(strips[0].z_mm[1] - strips[0].z_mm[0])


def images_of_strips(strips: Sequence[Strip]) -> Image:
    """Return the intensity of the strips, 0 where it is not valid, float32 (n, rows, columns)."""
    return np.stack([np.where(strip.valid, strip.intensity, 0) for strip in strips]).astype(np.float32)


def prepared(strips: Sequence[Strip]) -> Image:
    """Return the logarithm of the strips without the median strip and the median of each row, float32; 0 if invalid."""
    valid = np.stack([strip.valid & (strip.intensity > 0) for strip in strips])
    logs = np.where(valid, np.log(np.maximum(images_of_strips(strips), 1e-3)), np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of places that no strip shows, and of rows without any
        logs -= np.nanmedian(logs, axis=0)
        logs -= np.nanmedian(logs, axis=2, keepdims=True)
    return np.nan_to_num(logs).astype(np.float32)


def of_images(
    images_of: Callable[[Sequence[Strip]], Image], place: Callable[[Image, Sequence[Strip], float], StripPoses]
) -> Method:
    """Return the method that prepares strips with ``images_of`` and places the images (n, rows, columns)."""
    return lambda strips, nominal_pitch_mm: place(images_of(strips), strips, nominal_pitch_mm)


def _of_pairs(images_of: Callable[[Sequence[Strip]], Image], shift: Pairwise) -> Method:
    """Return the method that finds every strip's shift from the one before."""

    def place(images: Image, strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
        rows = nominal_pitch_mm / row_mm(strips)
        return poses_of([shift(a, b, rows) for a, b in pairwise(images)], strips, nominal_pitch_mm)

    return of_images(images_of, place)


# scikit-image: phase_cross_correlation, and the same without whitening the spectrum (normalization=None)
phase_correlation = _of_pairs(images_of_strips, _skimage)
phase_correlation_prepared = _of_pairs(prepared, _skimage)
cross_correlation_prepared = _of_pairs(prepared, partial(_skimage, normalization=None))
# OpenCV: phaseCorrelate with a Hanning window
opencv_phase = _of_pairs(images_of_strips, _opencv_phase)
opencv_phase_prepared = _of_pairs(prepared, _opencv_phase)
# OpenCV: findTransformECC, a translation, started at the nominal pitch
opencv_ecc = _of_pairs(images_of_strips, _opencv_ecc)
opencv_ecc_prepared = _of_pairs(prepared, _opencv_ecc)
# ashlar: its registration of two tiles cropped to their nominal overlap, and its null for what is an error
ashlar = of_images(images_of_strips, _ashlar)
ashlar_prepared = of_images(prepared, _ashlar)
