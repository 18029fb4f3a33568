"""How one would place the strips with existing libraries, in a few lines each: pair after pair, then added up.

None of them knows that θ is a circle, or that light and dirt stay with the probe. ``…_prepared`` get strips without
what every strip and every row shows alike, as ours takes it off: what they differ by from ours is the rest. Where a
library says how sure it is, a low word of its own means "I do not know".
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from skimage.registration import phase_cross_correlation

from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.errors import EndoctError
from endoct.stitching.strip import Strip
from endoct.workbench.bench.stitching import StripPoses
from endoct.workbench.bench.task import Declined

UPSAMPLED = 20
LEAST_RESPONSE = 0.05
LEAST_ECC = 0.3
ASHLAR_SIGMA_PX = 2.0
FEWEST_ROWS = 8

Move = Callable[[Image, Image, float], tuple[float, float, bool]]
"""(strip, the next one, nominal rows) → by how many rows and columns what it shows lies lower, and whether it knows."""


def phase_correlation(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """scikit-image: phase_cross_correlation on the strips as they are."""
    return _by_pairs(_images(strips), strips, nominal_pitch_mm, _skimage)


def phase_correlation_prepared(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """scikit-image: phase_cross_correlation on strips without what all of them show."""
    return _by_pairs(_prepared(strips), strips, nominal_pitch_mm, _skimage)


def cross_correlation_prepared(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """scikit-image: the same without whitening the spectrum (normalization=None)."""
    return _by_pairs(_prepared(strips), strips, nominal_pitch_mm, _skimage_plain)


def opencv_phase(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """OpenCV: phaseCorrelate with a Hanning window."""
    return _by_pairs(_images(strips), strips, nominal_pitch_mm, _opencv_phase)


def opencv_phase_prepared(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """OpenCV: phaseCorrelate with a Hanning window on strips without what all of them show."""
    return _by_pairs(_prepared(strips), strips, nominal_pitch_mm, _opencv_phase)


def opencv_ecc(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """OpenCV: findTransformECC, a translation, started at the nominal pitch."""
    return _by_pairs(_images(strips), strips, nominal_pitch_mm, _opencv_ecc)


def opencv_ecc_prepared(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """OpenCV: findTransformECC from the nominal pitch on strips without what all of them show."""
    return _by_pairs(_prepared(strips), strips, nominal_pitch_mm, _opencv_ecc)


def opencv_scans(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """OpenCV: the stitcher in its mode for scans; strips that it leaves out are not known."""
    images = [cv2.merge([grey] * 3) for grey in _grey(_images(strips))]
    stitcher = cv2.Stitcher.create(cv2.Stitcher_SCANS)
    if (status := stitcher.estimateTransform(images)) != cv2.Stitcher_OK:
        raise Declined(f"the stitcher gave up with status {status}")
    chosen = np.asarray(stitcher.component()).ravel()
    moved = {int(k): np.asarray(c.R, np.float64)[:2, 2] for k, c in zip(chosen, stitcher.cameras(), strict=True)}
    moves = [
        (*(moved[k + 1] - moved[k])[::-1], True) if k in moved and k + 1 in moved else (np.nan, np.nan, False)
        for k in range(len(images) - 1)
    ]
    return _added_up(moves, strips, nominal_pitch_mm)


def ashlar(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """ashlar: its registration of two tiles cropped to their nominal overlap, and its null for what is an error."""
    return _ashlar(_images(strips), strips, nominal_pitch_mm)


def ashlar_prepared(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """ashlar: the same on strips without what all of them show."""
    return _ashlar(_prepared(strips), strips, nominal_pitch_mm)


def _ashlar(images: Image, strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    try:
        from ashlar import utils
    except ImportError as error:
        raise EndoctError("ashlar is not installed", remedy="pip install ashlar") from error
    whole = round(nominal_pitch_mm / _row_mm(strips))
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
    moves = [register(a, b) for a, b in pairwise(images)]
    return _added_up([(rows, columns, error < largest) for rows, columns, error in moves], strips, nominal_pitch_mm)


def _skimage(a: Image, b: Image, rows: float) -> tuple[float, float, bool]:  # noqa: ARG001
    shift = phase_cross_correlation(a, b, upsample_factor=UPSAMPLED)[0]
    return float(shift[0]), float(shift[1]), True


def _skimage_plain(a: Image, b: Image, rows: float) -> tuple[float, float, bool]:  # noqa: ARG001
    shift = phase_cross_correlation(a, b, upsample_factor=UPSAMPLED, normalization=None)[0]
    return float(shift[0]), float(shift[1]), True


def _opencv_phase(a: Image, b: Image, rows: float) -> tuple[float, float, bool]:  # noqa: ARG001
    window = cv2.createHanningWindow((a.shape[1], a.shape[0]), cv2.CV_32F)
    (x, y), response = cv2.phaseCorrelate(b, a, window)
    return float(y), float(x), float(response) >= LEAST_RESPONSE


def _opencv_ecc(a: Image, b: Image, rows: float) -> tuple[float, float, bool]:
    start = np.array([[1, 0, 0], [0, 1, rows]], np.float32)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-5)
    try:
        # the template's (x, y) is the image's W(x, y)
        found, warp = cv2.findTransformECC(b, a, start, cv2.MOTION_TRANSLATION, criteria)
    except cv2.error:
        return np.nan, np.nan, False
    return float(warp[1, 2]), float(warp[0, 2]), float(found) >= LEAST_ECC


def _by_pairs(images: Image, strips: Sequence[Strip], nominal_pitch_mm: float, move: Move) -> StripPoses:
    rows = nominal_pitch_mm / _row_mm(strips)
    moves = [move(a, b, rows) for a, b in pairwise(images)]
    return _added_up(moves, strips, nominal_pitch_mm)


def _added_up(moves: list[Any], strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """Return places from moves in rows and columns; the nominal pitch and no roll where a move is not known."""
    rows, columns, known = (np.array(part) for part in zip(*moves, strict=True))
    feed: Coordinates = np.where(known, rows * _row_mm(strips), nominal_pitch_mm)
    roll: Coordinates = np.where(known, columns * float(strips[0].theta_rad[1] - strips[0].theta_rad[0]), 0.0)
    zero = np.zeros(1)
    return StripPoses(
        np.concatenate([zero, np.cumsum(feed)]),
        np.concatenate([zero, np.cumsum(roll)]),
        np.concatenate([[True], known.astype(np.bool_)]),
    )


def _row_mm(strips: Sequence[Strip]) -> float:
    return float(strips[0].z_mm[1] - strips[0].z_mm[0])


def _images(strips: Sequence[Strip]) -> Image:
    return np.stack([np.where(strip.valid, strip.intensity, 0) for strip in strips]).astype(np.float32)


def _prepared(strips: Sequence[Strip]) -> Image:
    """Return the logarithm of the strips without the median strip and the median of each row."""
    logs = np.log(np.maximum(_images(strips), 1e-3))
    logs -= np.median(logs, axis=0)
    return np.asarray(logs - np.median(logs, axis=2, keepdims=True), dtype=np.float32)


def _grey(images: Image) -> list[Any]:
    low, high = np.percentile(images, [0.5, 99.5])
    return [np.clip((image - low) / max(high - low, 1e-9) * 255, 0, 255).astype(np.uint8) for image in images]
