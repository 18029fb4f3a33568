"""What was drawn into the picture behind the camera: text, a clock, a logo, a mask. It hides the wall where it lies.

An overlay is opaque: its pixels stand still, to what a codec makes of them, while the wall goes by around them. So does
what is saturated, and dirt that lets no light through. But their edges are soft, as light ends smoothly and dirt is out
of focus. The sharp edges of the probe, rims and specular rings, run around the ring. So an overlay is known by sharp
edges that do not run around the ring, next to pixels that stand still. They are looked for in what the slopes of all
frames have in common: of the wall, that is next to nothing. Connected with them, all belongs to it that stands still,
as strokes and boxes do. So does what has corners in most of the frames, as the changing digits of a clock do.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.ranks import medians, quantiles
from endoct.modalities.endoscope.mirror.annulus import Annulus

FEWEST_FRAMES = 6
"""Fewer do not show what stands still while the wall goes by."""
SHARP = 0.1
"""An edge is sharp from this slope on, in full scales a pixel of the reduced images: a step by a quarter has it."""
ACROSS = 0.25
"""An edge does not run around where the sine of its angle with the circle around the ring's centre is larger."""
MOST_FRAMES = 0.8
STILL, COUNT = 0.25, 1.5 / 255
"""A pixel stands still that departs from its median by no more than the larger of these.

They are parts of the ring's median departure, and of full scale."""
WINDOW_PX = 9
"""Slopes of several directions within this window make a corner; letters are about twice as high."""
CORNER, BY_MEDIAN = 2e-4, 8.0
"""A window holds a corner by the mean square of its slope, across the direction where that is least.

It must be more than the first, and than its median in the ring times the second."""
FEWEST_PX = 12
RIM_PX, EDGE_PX = 3, 3
"""Nothing is looked for so near to a rim. An overlay's edge, blurred by a codec, reaches so far around it."""


def find_overlay(images: Sequence[Image], annulus: Annulus) -> Mask | None:
    """Return what was drawn over the ring, bool (row, column); None where nothing was, or too few images show it.

    ``images``: grey, float32 of full scale 1. In all of them the ring lies about where ``annulus`` has it, and between
    them the wall moves on.
    """
    whole = _ring(annulus, images[0].shape, -RIM_PX)
    if len(images) < FEWEST_FRAMES or not whole.any():
        return None
    rows, columns = _around(annulus, images[0].shape)
    part, ring = [np.ascontiguousarray(image[rows, columns]) for image in images], whole[rows, columns]
    slopes = list(thread_map(_slopes, part))
    still = _still(part, ring)
    edges = ring & _grown(still, 1) & _edges(_medians(slopes), annulus, rows, columns)
    if not edges.any():
        return None
    corners = _medians([_weakest(slope) for slope in slopes])
    busy = corners > max(BY_MEDIAN * float(np.median(corners[ring])), CORNER)
    found = _connected((edges | still | busy) & ring, edges)
    if not found.any():
        return None
    overlay = np.zeros(images[0].shape, np.bool_)
    overlay[rows, columns] = _grown(found, EDGE_PX)
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


def _edges(slope: Image, annulus: Annulus, rows: slice, columns: slice) -> Mask:
    """Say where ``slope`` (2, row, column) of the part of the image is sharp and no edge that runs around the ring."""
    y, x = np.mgrid[rows, columns]
    x, y = x - np.float32(annulus.outer_x_px), y - np.float32(annulus.outer_y_px)
    across = np.abs(slope[0] * y - slope[1] * x) / np.maximum(np.hypot(x, y), 1)
    size = np.hypot(*slope)
    return np.asarray((size > SHARP) & (across > ACROSS * size))


def _weakest(slope: Image) -> Image:
    """Return the mean square of the slope in the window around every pixel, across the direction where it is least."""
    xx, yy, xy = (cv2.boxFilter(slope[a] * slope[b], -1, (WINDOW_PX, WINDOW_PX)) for a, b in ((0, 0), (1, 1), (0, 1)))
    return np.asarray((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy))


def _still(images: Sequence[Image], ring: Mask) -> Mask:
    """Say which pixels keep their brightness in most images: a wall that goes by is seldom as bright in so many."""
    away = np.abs(np.stack(images) - _medians(images)).reshape(len(images), -1)
    usual, most = (quantiles(away, share).reshape(ring.shape) for share in (0.5, MOST_FRAMES))
    return np.asarray(most <= max(STILL * float(np.median(usual[ring])), COUNT))


def _medians(images: Sequence[Image]) -> Image:
    return medians(np.stack(images).reshape(len(images), -1)).reshape(images[0].shape)


def _grown(mask: Mask, by_px: int) -> Mask:
    square = np.ones((2 * by_px + 1, 2 * by_px + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), square), np.bool_)


def _connected(mask: Mask, seeds: Mask) -> Mask:
    """Return those parts of ``mask``, apart by more than the gap between two letters, that hold enough seeds."""
    n, labels = cv2.connectedComponents(_grown(mask, EDGE_PX).astype(np.uint8))
    enough = np.bincount(labels[seeds], minlength=n) >= FEWEST_PX
    return np.asarray(mask & enough[labels])
