"""What was drawn into the picture behind the camera: text, a clock, a logo, a mask. It hides the wall where it lies.

An overlay is opaque: its pixels stand still, to what a codec makes of them, while the wall goes by around them. So does
what is saturated, and dirt that lets no light through; but these have no corners. Light ends smoothly, rims and
specular rings are lines whose slope has one direction, and dirt is out of focus. So an overlay is known by corners
next to pixels that stand still, in what the slopes of all frames have in common: of the wall, that is next to nothing.
From there on all belongs to it that stands still, as strokes and boxes do, or has corners in most of the frames, as the
changing digits of a clock do.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.ranks import medians
from endoct.modalities.endoscope.mirror.annulus import Annulus

FEWEST_FRAMES = 6
"""Fewer do not show what stands still while the wall goes by."""
WINDOW_PX = 9
"""Of the reduced images: in it slopes of several directions make a corner; letters are about twice as high."""
SURE_CORNER = 1e-3
"""Mean square of the slope across any direction in a window, as parts of full scale a pixel. A step by a third of full
scale has it; below 0.0002 next to what stands still in the simulator, 0.0006 in H.264."""
LEAST_CORNER = 2e-4
BY_MEDIAN = 8.0
"""Times the median of the ring: a window in which most frames have corners."""
LEAST_RATIO = 0.08
"""Of the slopes across the weakest to those across the strongest direction; a curved rim has less."""
STILL = 0.2
"""Of the ring's median change from frame to frame: a pixel that stands still."""
COUNT = 1.5 / 255
RIM_PX, EDGE_PX = 3, 3
"""So near to a rim nothing is looked for; so far around an overlay its blurred edge reaches, as a codec leaves it."""


def find_overlay(images: Sequence[Image], annulus: Annulus) -> Mask | None:
    """Return what was drawn over the ring, bool (row, column); None where nothing was, or too few images show it.

    ``images``: grey, float32 of full scale 1, in all of which the ring lies about where ``annulus`` has it and between
    which the wall moves on.
    """
    if len(images) < FEWEST_FRAMES:
        return None
    shape = images[0].shape
    rows, columns = _around(annulus, shape)
    part = [np.ascontiguousarray(image[rows, columns]) for image in images]
    ring = _ring(annulus, shape, -RIM_PX)[rows, columns]
    slopes = list(thread_map(_slopes, part))
    least, most = _strengths(_medians(slopes))
    still = _still(part, ring)
    sure = ring & (least > SURE_CORNER) & (least > LEAST_RATIO * most) & _grown(still, 1)
    if not sure.any():
        return None
    in_frames = _medians([_strengths(slope)[0] for slope in slopes])
    busy = in_frames > max(BY_MEDIAN * float(np.median(in_frames[ring])), LEAST_CORNER)
    within = _ring(annulus, shape, RIM_PX)[rows, columns]
    overlay = np.zeros(shape, np.bool_)
    overlay[rows, columns] = _grown(_connected((sure | still | busy) & within, sure), EDGE_PX)
    return overlay


def in_pixels_of_files(overlay: Mask, shape: tuple[int, int], factor: int, pixels: float) -> Mask:
    """Return an overlay of square pixels, reduced by ``factor``, in images of ``shape`` of the files."""
    rows = np.arange(shape[0]) // factor
    columns = np.rint((np.arange(shape[1]) // factor + 0.5) / pixels - 0.5).astype(int)
    return np.asarray(
        overlay[np.ix_(*(np.clip(at, 0, n - 1) for at, n in zip((rows, columns), overlay.shape, strict=True)))]
    )


def share_of_ring(overlay: Mask, annulus: Annulus) -> float:
    """Return which part of the ring an overlay covers."""
    return float(np.mean(overlay[_ring(annulus, overlay.shape, 0.0)]))


def _around(annulus: Annulus, shape: tuple[int, ...]) -> tuple[slice, slice]:
    reach_px = annulus.outer_px + RIM_PX + WINDOW_PX + EDGE_PX
    first = [max(int(at - reach_px), 0) for at in (annulus.outer_y_px, annulus.outer_x_px)]
    last = [
        min(int(at + reach_px) + 2, n) for at, n in zip((annulus.outer_y_px, annulus.outer_x_px), shape, strict=True)
    ]
    return slice(first[0], last[0]), slice(first[1], last[1])


def _ring(annulus: Annulus, shape: tuple[int, ...], margin_px: float) -> Mask:
    """Return the ring, with ``margin_px`` more on either side."""
    row, column = np.ogrid[: shape[0], : shape[1]]
    inner, outer = (np.hypot(column - rim.x_px, row - rim.y_px) - rim.radius_px for rim in annulus.rings)
    return np.asarray((inner > -margin_px) & (outer < margin_px))


def _slopes(image: Image) -> Image:
    """Return the slope of an image along columns and rows, a pixel, float32 (2, row, column)."""
    smooth = cv2.GaussianBlur(image, (0, 0), 0.7)
    return np.stack([cv2.Sobel(smooth, cv2.CV_32F, along, 1 - along, ksize=3, scale=1 / 8) for along in (1, 0)])


def _strengths(slope: Image) -> tuple[Image, Image]:
    """Return the mean square of the slope in the window of every pixel, across the weakest and strongest direction."""
    xx, yy, xy = (cv2.boxFilter(slope[a] * slope[b], -1, (WINDOW_PX, WINDOW_PX)) for a, b in ((0, 0), (1, 1), (0, 1)))
    mean, apart = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    return np.asarray(mean - apart), np.asarray(mean + apart)


def _still(images: Sequence[Image], ring: Mask) -> Mask:
    change = _medians(list(np.abs(np.stack(images) - _medians(images))))
    return np.asarray(change <= max(STILL * float(np.median(change[ring])), COUNT))


def _medians(images: Sequence[Image]) -> Image:
    return medians(np.stack(images).reshape(len(images), -1)).reshape(images[0].shape)


def _grown(mask: Mask, by_px: int) -> Mask:
    square = np.ones((2 * by_px + 1, 2 * by_px + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), square), np.bool_)


def _connected(mask: Mask, seeds: Mask) -> Mask:
    """Return those parts of ``mask``, apart by more than the gap between two letters, that hold a seed."""
    _, labels = cv2.connectedComponents(_grown(mask, EDGE_PX).astype(np.uint8))
    return np.asarray(mask & np.isin(labels, np.unique(labels[seeds])))
