"""Images of the wall that tiles are cut from: windows of them are read or averaged."""

import math
import threading
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.zarr.window import StoredImage
from endoct.workbench.page.wall import TILE_PX, Indices, Pixels, Placing, Spans, TileWall, column_spans, row_spans

MOST_OVERVIEW_SAMPLES = 1_500_000
"""Samples of the overview that coarse tiles are cut from, so that none of them reads the whole image."""
SAMPLES_AT_ONCE = 500_000
"""Samples that are read at a time for an overview or a tile."""


@dataclass(frozen=True, eq=False)
class Averaged:
    """``values`` float32 and how much of each was ``observed``, a share; values are 0 where nothing was."""

    values: Image
    observed: Image

    @property
    def known(self) -> Mask:
        """Where at least half of a value was observed."""
        return self.observed >= 0.5


@dataclass(frozen=True, eq=False)
class Overview:
    """An image, ``averaged`` over so many rows ``down`` and columns ``across``."""

    down: int
    across: int
    averaged: Averaged


@dataclass(frozen=True, eq=False)
class Plane:
    """An image on disk with what of it was observed, and where it lies on the wall.

    ``observed`` None: wherever the image is finite.
    """

    image: StoredImage
    observed: StoredImage | None
    placing: Placing
    radius_mm: float
    _overview: "list[Overview]" = field(default_factory=list, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def means(self, wall: TileWall, level: int, pixels: Pixels) -> Averaged:
        """Return ``pixels`` of the wall at ``level``: each the mean of the observed samples in it, or the nearest."""
        rows = row_spans(self.placing, wall, level, pixels)
        columns = column_spans(self.placing, wall, level, pixels)
        overview, placing = self.overview(), self.placing
        thinned_mm = (placing.row_height_mm, overview.down), (placing.dtheta_mm(self.radius_mm), overview.across)
        if all(by == 1 or wall.pixel_mm(level) >= by * sample_mm for sample_mm, by in thinned_mm):
            n_z, n_theta = self.image.shape
            rows, columns = _coarser(rows, overview.down, n_z), _coarser(columns, overview.across, n_theta)
            return _means(overview.averaged, rows, columns)
        return self._from_store(rows, columns)

    def at(self, theta_rad: float, z_mm: float) -> float | None:
        """Return the value of the sample at a place, None where nothing was observed there."""
        row = int(np.argmin(np.abs(self.placing.row_mm - z_mm)))
        if abs(self.placing.row_mm[row] - z_mm) > 0.75 * self.placing.row_height_mm:
            return None
        column = math.floor((theta_rad - self.placing.theta0_rad) / self.placing.dtheta_rad + 0.5)
        found = self._read(slice(row, row + 1), slice(column, column + 1))
        return float(found.values[0, 0]) if found.observed[0, 0] else None

    def own_rows(self, wall: TileWall, level: int, most_rows: int) -> tuple[Coordinates, Averaged]:
        """Return the image at its own rows, z of each in mm ascending, in the columns of the wall at ``level``.

        Where there are more than ``most_rows``, or the overview has fewer, each is the mean of some.
        """
        overview, (n_z, n_theta) = self.overview(), self.image.shape
        columns = column_spans(self.placing, wall, level, Pixels((0, 1), (0, wall.width_px(level))))
        n_coarse = -(-n_z // overview.down)
        start = np.arange(0, n_coarse, max(1, -(-n_coarse // most_rows)))
        stop = np.append(start[1:], n_coarse)
        first = start * overview.down
        row_mm = np.add.reduceat(self.placing.row_mm, first) / np.diff(np.append(first, n_z))
        return row_mm, _means(overview.averaged, Spans(start, stop), _coarser(columns, overview.across, n_theta))

    def overview(self) -> Overview:
        """Return the whole image, thinned; it is made at the first call."""
        with self._lock:
            if not self._overview:
                self._overview.append(self._new_overview())
            return self._overview[0]

    def _new_overview(self) -> Overview:
        n_z, n_theta = self.image.shape
        down, across = thinning(self.image.shape, self.placing.row_height_mm, self.placing.dtheta_mm(self.radius_mm))
        high = max(down, SAMPLES_AT_ONCE // n_theta // down * down)
        tops = range(0, n_z, high)
        parts = [
            _block_means(self._read(slice(top, min(top + high, n_z)), slice(0, n_theta)), down, across) for top in tops
        ]
        values, observed = ([getattr(part, name) for part in parts] for name in ("values", "observed"))
        return Overview(down, across, Averaged(np.concatenate(values), np.concatenate(observed)))

    def _from_store(self, rows: Spans, columns: Spans) -> Averaged:
        """Return means over samples that are read in parts: a coarse tile covers millions of them."""
        top, bottom = int(rows.start.min()), int(max(rows.stop.max(), rows.start.min() + 1))
        left, right = int(columns.start.min()), int(columns.stop.max())
        n_parts = min(rows.start.size, max(1, (bottom - top) * (right - left) // SAMPLES_AT_ONCE))
        if n_parts > 1:
            starts, stops = (np.array_split(of, n_parts) for of in (rows.start, rows.stop))
            parts = [self._from_store(Spans(*of), columns) for of in zip(starts, stops, strict=True)]
            return Averaged(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("values", "observed")))
        read = self._read(slice(top, bottom), slice(left, right))
        return _means(read, Spans(rows.start - top, rows.stop - top), Spans(columns.start - left, columns.stop - left))

    def _read(self, rows: slice, columns: slice) -> Averaged:
        """Return samples along z and θ, which goes on around the circle."""
        values = self._stored(self.image, rows, columns).astype(np.float32)
        observed = np.isfinite(values)
        if self.observed is not None:
            observed &= self._stored(self.observed, rows, columns).astype(np.bool_)
        return Averaged(np.where(observed, values, np.float32(0)), observed.astype(np.float32))

    def _stored(self, image: StoredImage, rows: slice, columns: slice) -> NDArray[Any]:
        placing, n_theta = self.placing, self.placing.n_theta
        if placing.z_reversed:
            rows = slice(placing.stored_row(rows.stop - 1), placing.stored_row(rows.start) + 1)
        if placing.mirrored:
            columns = slice(1 - columns.stop, 1 - columns.start)
        first = columns.start // n_theta * n_theta
        parts = [
            image.read(rows, slice(max(columns.start - turn, 0), min(columns.stop - turn, n_theta)))
            for turn in range(first, columns.stop, n_theta)
        ]
        found = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        return found[:: -1 if placing.z_reversed else 1, :: -1 if placing.mirrored else 1]


def thinning(shape: tuple[int, int], tall_mm: float, wide_mm: float) -> tuple[int, int]:
    """Return how many (rows, columns) of an image of ``shape`` an overview has one sample for.

    The axis along which samples are finer is thinned first, but neither beyond the pixels of the coarsest tiles.
    """
    n_z, n_theta = shape
    down = across = 1
    coarsest_mm = wide_mm * n_theta / TILE_PX
    while -(-n_z // down) * -(-n_theta // across) > MOST_OVERVIEW_SAMPLES:
        taller_mm, wider_mm = 2 * tall_mm * down, 2 * wide_mm * across
        if min(taller_mm, wider_mm) > coarsest_mm:
            break
        down, across = (2 * down, across) if taller_mm < wider_mm else (down, 2 * across)
    return down, across


def _coarser(spans: Spans, by: int, n: int) -> Spans:
    """Return spans for means of ``by`` of ``n`` samples each, which go on around; the last may have fewer."""
    coarse = -(-n // by)
    last = spans.stop - 1
    start = spans.start // n * coarse + spans.start % n // by
    stop = last // n * coarse + last % n // by + 1
    return Spans(start, np.where(spans.stop > spans.start, stop, start))


def _block_means(of: Averaged, down: int, across: int) -> Averaged:
    """Return the means of the observed samples in blocks; the last of a row or column may be smaller."""
    if down * across == 1:
        return of
    blocks = [np.arange(0, n, by) for n, by in zip(of.values.shape, (down, across), strict=True)]
    rows, columns = blocks
    # what was not observed is 0 in both
    sums, weights = (
        np.add.reduceat(np.add.reduceat(image, columns, axis=1), rows, axis=0) for image in (of.values, of.observed)
    )
    sizes = [np.diff(np.append(first, n)) for first, n in zip(blocks, of.values.shape, strict=True)]
    means = np.divide(sums, weights, out=np.zeros_like(sums), where=weights > 0)
    return Averaged(means, (weights / np.outer(*sizes)).astype(np.float32))


def _means(of: Averaged, rows: Spans, columns: Spans) -> Averaged:
    """Return the mean of the observed samples in every span; columns go on around."""
    return Averaged(*_means_and_shares(of.values, of.observed, rows.start, rows.stop, columns.start, columns.stop))


@compiled
def _means_and_shares(
    values: Image, observed: Image, top: Indices, bottom: Indices, left: Indices, right: Indices
) -> tuple[Image, Image]:
    n_theta = values.shape[1]
    means, shares = np.zeros((top.size, left.size), np.float32), np.zeros((top.size, left.size), np.float32)
    for row in range(top.size):
        if row > 0 and top[row] == top[row - 1] and bottom[row] == bottom[row - 1]:
            for column in range(left.size):  # magnified
                means[row, column], shares[row, column] = means[row - 1, column], shares[row - 1, column]
            continue
        for column in range(left.size):
            total = weights = 0.0
            for i in range(top[row], bottom[row]):
                for j in range(left[column], right[column]):
                    weight = observed[i, j % n_theta]
                    total += values[i, j % n_theta] * weight
                    weights += weight
            if weights > 0:
                means[row, column] = total / weights
                shares[row, column] = weights / ((bottom[row] - top[row]) * (right[column] - left[column]))
    return means, shares
