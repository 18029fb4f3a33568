"""Connected regions of the wall and their shapes, where θ is a circle and z ends."""

from typing import Any, Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.circle import pad_circle

T = TypeVar("T", bound=np.generic)
Labels = NDArray[np.int32]
"""The number of the region that each sample belongs to, 0 outside all."""


def morphology(mask: Mask, operation: Literal["open", "close"], rows_px: float, columns_px: float) -> Mask:
    """Return ``mask`` opened or closed with an ellipse of these radii (px): cyclic in θ, ending in z.

    Beyond the ends of z there is neither cell nor wall: nothing is removed or added because of them.
    """
    up, across = int(rows_px), int(columns_px)
    if up == 0 and across == 0:
        return mask
    y, x = np.mgrid[-up : up + 1, -across : across + 1]
    ellipse = ((y / max(rows_px, 1e-9)) ** 2 + (x / max(columns_px, 1e-9)) ** 2 <= 1 + 1e-9).astype(np.uint8)
    pad = min(2 * across, mask.shape[1])
    padded = pad_circle(mask.astype(np.uint8), pad)
    kind = cv2.MORPH_OPEN if operation == "open" else cv2.MORPH_CLOSE
    done = cv2.morphologyEx(padded, kind, ellipse, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(done[:, pad : pad + mask.shape[1]] > 0)


def eroded(mask: Mask) -> Mask:
    """Return the samples of ``mask`` with all eight neighbours in it; beyond the ends of z it goes on."""
    padded = np.pad(pad_circle(mask.astype(np.uint8), 1), ((1, 1), (0, 0)), mode="edge")
    return np.asarray(cv2.erode(padded, np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0)


def highest_within(image: Image, rows_px: float, columns_px: float) -> Image:
    """Return the highest value of ``image`` within an ellipse of these radii, at least 1 px, around each sample."""
    return np.asarray(_dilated(image, rows_px, columns_px), dtype=np.float32)


def within(mask: Mask, rows_px: float, columns_px: float) -> Mask:
    """Return the samples that lie within an ellipse of these radii, at least 1 px, of ``mask``."""
    return np.asarray(_dilated(np.ascontiguousarray(mask).view(np.uint8), rows_px, columns_px) > 0)


def _dilated(image: NDArray[Any], rows_px: float, columns_px: float) -> NDArray[Any]:
    up, across = max(1, round(rows_px)), max(1, round(columns_px))
    y, x = np.mgrid[-up : up + 1, -across : across + 1]
    ellipse = ((y / up) ** 2 + (x / across) ** 2 <= 1).astype(np.uint8)
    return cv2.dilate(pad_circle(image, across), ellipse)[:, across:-across]


def label(mask: Mask) -> tuple[Labels, int]:
    """Return (labels (n_z, n_theta), 0 outside, 1 … n; n) of connected cells, joined over the seam of θ.

    Samples that touch at a corner are connected.
    """
    pieces, region_of = _pieces(mask)
    return looked_up(region_of, pieces), int(region_of.max())


def _pieces(mask: Mask) -> tuple[Labels, Labels]:
    """Return labels of cells that are cut at the seam of θ, and, by such a label, the cell that it is a piece of."""
    n, labels = cv2.connectedComponents(np.ascontiguousarray(mask).view(np.uint8), connectivity=8, ltype=cv2.CV_32S)
    # columns −1 and 0 are neighbours: a row with itself and with the rows above and below
    last, first = np.pad(labels[:, -1], 1), labels[:, 0]
    left, right = np.stack([last[:-2], last[1:-1], last[2:]]), np.broadcast_to(first, (3, first.size))
    touch = (left > 0) & (right > 0)
    graph = sparse.coo_array((np.ones(touch.sum()), (left[touch], right[touch])), shape=(n, n))
    # the background, 0, is visited first and stays 0
    region_of = connected_components(graph, directed=False)[1]
    return np.asarray(labels), region_of.astype(np.int32)


def label_in_order(mask: Mask) -> Labels:
    """Return labels (n_z, n_theta) of connected cells over the seam of θ, from 1 in the order of their mean z."""
    labels, n = label(mask)
    if n == 0:
        return labels
    flat = labels.ravel().astype(np.intp)
    count = np.bincount(flat)
    sum_of_rows = np.bincount(flat, np.repeat(np.arange(len(labels), dtype=np.float64), labels.shape[1]))
    new = np.zeros(n + 1, np.int32)
    new[1 + np.argsort(sum_of_rows[1:] / count[1:], kind="stable")] = np.arange(1, n + 1)
    return looked_up(new, labels)


def remove_small(mask: Mask, smallest_px: float) -> Mask:
    """Return ``mask`` without connected cells of fewer than ``smallest_px`` samples."""
    if smallest_px <= 1:
        return mask
    pieces, region_of = _pieces(mask)
    keep = np.bincount(region_of, np.bincount(pieces.ravel())) >= smallest_px
    keep[0] = False
    return looked_up(keep[region_of], pieces)


def looked_up(table: NDArray[T], labels: Labels) -> NDArray[T]:
    """Return the entry of ``table`` for every label."""
    return np.take(table, labels)


def quantiles(values: Image, labels: NDArray[np.integer], n: int, share: float) -> Coordinates:
    """Return the quantile ``share`` of the finite ``values`` of every label 0 … n, NaN where there are none.

    ``values`` and ``labels`` have the same shape. The quantile is one of the values: the lower where it lies between
    two.
    """
    known = np.isfinite(values)
    count = np.bincount(labels[known], minlength=n + 1)
    first = np.cumsum(count) - count
    grouped = _grouped(values[known], labels[known], first.copy())
    lower = np.full(n + 1, np.nan)
    for k in np.flatnonzero(count):
        # sorted whole: faster than NumPy's selection, which does not use the processor's vector instructions
        lower[k] = np.sort(grouped[first[k] : first[k] + count[k]])[int(share * (count[k] - 1))]
    return lower


@compiled
def _grouped(values: Image, labels: NDArray[np.integer], free: NDArray[np.int64]) -> Image:
    """The ``values`` (n,) ordered by their labels; those of label k from the place ``free[k]`` on."""
    grouped = np.empty_like(values)
    for i in range(values.size):
        grouped[free[labels[i]]] = values[i]
        free[labels[i]] += 1
    return grouped
