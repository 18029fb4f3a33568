"""B-scans made small: area averages along θ, decibels where samples are linear, and which way depth runs in them.

Averages over the columns of the panorama are all that survey and unrolling need. They are made as each B-scan is
read, once.
"""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Room
from endoct.base.numeric.ranks import quantiles
from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.frame_cache import kept_frames
from endoct.modalities.oct.parameters import OctParameters

_ROOM = Room()
ROWS_TOGETHER = 32
"""Rows of a page that are transposed together: 900 kB of 14 000 A-scans, which fit a processor's cache."""
LEAST_SHARE = 1e-3
"""A smaller part of an A-scan at a sector's edge does not count."""
MOST_COLUMNS = 2048
JUDGED_ASCANS = 64
SECTORS = 128
WINDOW = 0.05
"""This part of the depth is wider than the lines of sheath and capillary, and narrower than the visible tissue."""
UPSIDE_DOWN = 0.4
"""Depth runs the wrong way where fewer of the sectors brighten so, in the mean of several B-scans."""
STEADY = 0.1
"""What nine in ten sectors reach at a depth is no tissue: the sheath fades with depth as tissue does, and noise has
bands."""


@dataclass(frozen=True, eq=False)
class Raster:
    """How a reduced B-scan is sampled.

    Attributes: ``angle_rad``, float64 (n_columns,), the centres of its sectors from A-scan 0; ``n_depth`` samples of
    ``mm_per_px`` each, in the medium.
    """

    angle_rad: Coordinates
    n_depth: int
    mm_per_px: float

    @property
    def depth_mm(self) -> float:
        """Depth of the B-scan, mm."""
        return self.n_depth * self.mm_per_px


@dataclass(frozen=True)
class Spacing:
    """Distance of neighbouring samples of a B-scan, mm: ``depth_mm`` along a beam, ``column_mm`` along the wall."""

    depth_mm: float
    column_mm: float


def reduce_theta(samples: NDArray[np.generic], n_columns: int) -> Image:
    """Return :func:`sector_means` of a B-scan (A-scan, depth) as float32 (n_columns, depth)."""
    return np.ascontiguousarray(sector_means(samples, n_columns), dtype=np.float32)


def sector_means(samples: NDArray[Any], n_columns: int) -> NDArray[Any]:
    """Return the area average of a B-scan (A-scan, depth) over ``n_columns`` sectors, (n_columns, depth).

    ``n_columns`` is at most the number of A-scans. Their centres are :func:`sector_angles_rad`. Means of uint8 and
    uint16 are rounded to these types, others are float32. With as many columns as A-scans, ``samples`` is returned.
    """
    n_ascans, n_depth = samples.shape
    if n_ascans == n_columns:
        return samples
    if samples.dtype not in (np.uint8, np.uint16, np.float32):
        samples = samples.astype(np.float32)
    sectors = _sectors(n_ascans, n_columns)
    means = np.empty((n_columns, n_depth), samples.dtype)
    whole = samples.dtype.kind == "u"
    if samples.T.flags.c_contiguous and n_depth >= ROWS_TOGETHER:
        turned = _ROOM.array("turned", (n_ascans, ROWS_TOGETHER), samples.dtype)
        for block in range(-(-n_depth // ROWS_TOGETHER)):
            row = min(block * ROWS_TOGETHER, n_depth - ROWS_TOGETHER)
            cv2.transpose(samples.T[row : row + ROWS_TOGETHER], turned)
            _average_rows(turned, *sectors, whole, means, row)
    else:
        _average_ascans(np.ascontiguousarray(samples), *sectors, whole, means)
    return means


@lru_cache(maxsize=8)
def _sectors(n_ascans: int, n_columns: int) -> tuple[NDArray[np.intp], Image, np.float32]:
    """The first A-scan of each sector, the weights of the A-scans from there on, and what their sum is multiplied by.

    As OpenCV's INTER_AREA has them: a sector's first and last A-scan may belong to it in part.
    """
    width = n_ascans / n_columns
    if n_ascans % n_columns == 0:
        together = n_ascans // n_columns
        starts = np.arange(n_columns, dtype=np.intp) * together
        return starts, np.ones((n_columns, together), np.float32), np.float32(1 / together)
    first = np.arange(n_columns) * width
    most = int(np.ceil(width)) + 1
    starts = np.minimum(np.floor(first), n_ascans - most).astype(np.intp)
    ascan = starts[:, None] + np.arange(most)
    share = np.minimum(ascan + 1, (first + width)[:, None]) - np.maximum(ascan, first[:, None])
    return starts, np.where(share > LEAST_SHARE, share / width, 0).astype(np.float32), np.float32(1)


@compiled
def _average_rows(
    turned: NDArray[Any],
    first: NDArray[np.intp],
    weight: Image,
    scale: np.float32,
    whole: bool,
    means: NDArray[Any],
    row: int,
) -> None:
    """Write means of ``turned`` (A-scan, :data:`ROWS_TOGETHER`) into ``means`` (sector, depth) from ``row`` on.

    Four A-scans are added up before the sum is stored, since storing is what takes the time.
    """
    n_columns, most = weight.shape
    mean = np.empty(ROWS_TOGETHER, np.float32)
    for column in range(n_columns):
        start = first[column]
        mean[:] = 0
        for k in range(0, most - 3, 4):
            a, b, c, d = weight[column, k], weight[column, k + 1], weight[column, k + 2], weight[column, k + 3]
            one, two, three, four = (
                turned[start + k],
                turned[start + k + 1],
                turned[start + k + 2],
                turned[start + k + 3],
            )
            for r in range(ROWS_TOGETHER):
                mean[r] = (
                    mean[r]
                    + np.float32(one[r]) * a
                    + np.float32(two[r]) * b
                    + np.float32(three[r]) * c
                    + np.float32(four[r]) * d
                )
        for k in range(most // 4 * 4, most):
            for r in range(ROWS_TOGETHER):
                mean[r] += np.float32(turned[start + k, r]) * weight[column, k]
        for r in range(ROWS_TOGETHER):
            value = mean[r] * scale
            means[column, row + r] = np.rint(value) if whole else value


@compiled
def _average_ascans(
    ascans: NDArray[Any], first: NDArray[np.intp], weight: Image, scale: np.float32, whole: bool, means: NDArray[Any]
) -> None:
    """Write means of ``ascans`` (A-scan, depth) into ``means`` (sector, depth)."""
    n_depth = ascans.shape[1]
    n_columns, most = weight.shape
    mean = np.empty(n_depth, np.float32)
    for column in range(n_columns):
        start = first[column]
        mean[:] = 0
        for k in range(most):
            share = weight[column, k]
            for row in range(n_depth):
                mean[row] += np.float32(ascans[start + k, row]) * share
        for row in range(n_depth):
            value = mean[row] * scale
            means[column, row] = np.rint(value) if whole else value


def sector_angles_rad(n_ascans: int, n_columns: int) -> Coordinates:
    """Return the rotation angle from A-scan 0 at the centre of each sector, float64 (n_columns,), rad."""
    width = n_ascans / n_columns
    return np.asarray((np.arange(n_columns) * width + (width - 1) / 2) * (2 * np.pi / n_ascans), dtype=np.float64)


@compiled
def mean_between(image: Image, first: NDArray[np.intp], last: NDArray[np.intp]) -> Coordinates:
    """Return the mean of each A-scan over its rows from ``first`` (n,) up to but without ``last`` (n,), float64 (n,).

    ``image`` is (n, depth). Only rows within the depth range count; the mean of none is 0.
    """
    n_ascans, n_depth = image.shape
    mean = np.zeros(n_ascans)
    for ascan in range(n_ascans):
        low, high = max(first[ascan], 0), min(last[ascan], n_depth)
        for row in range(low, high):
            mean[ascan] += image[ascan, row]
        mean[ascan] /= max(high - low, 1)
    return mean


def varying(image: NDArray[Any]) -> Mask:
    """Return which A-scans of ``image`` (n, depth) are not constant, bool (n,)."""
    return np.asarray((image[:, 1:] != image[:, :1]).any(axis=1))


def rows_from(image: Image, first: NDArray[np.intp], n_rows: int) -> Image:
    """Return ``n_rows`` samples of every A-scan of ``image`` (n, depth) from ``first`` (n,) on, NaN outside it."""
    rows, last = first[:, None] + np.arange(n_rows), image.shape[1] - 1
    taken = np.take_along_axis(image, rows.clip(0, last), axis=1)
    return np.where((rows >= 0) & (rows <= last), taken, np.float32(np.nan))


def logarithmic(image: NDArray[Any], intensity: str) -> NDArray[Any]:
    """Return ``image`` on a logarithmic scale: unchanged where it already is, in dB where ``intensity`` is "linear".

    dB are float32.
    """
    if intensity == "log":
        return image
    image = np.asarray(image, dtype=np.float32)
    floor = max(float(np.mean(np.abs(image))) * 1e-6, float(np.finfo(np.float32).tiny))
    return np.asarray(10 * np.log10(np.maximum(image, floor)), dtype=np.float32)


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedBscan(Frame):
    """A B-scan of which ``samples`` are means over sectors of the turn, (n_columns, depth), in the recording's type.

    Attributes: ``n_ascans`` that were recorded; ``saturated``, whether most samples of the B-scan are.
    """

    n_ascans: int
    saturated: bool

    @property
    def image(self) -> Image:
        """The samples as float32 (n_columns, depth)."""
        return np.ascontiguousarray(self.samples, dtype=np.float32)

    @property
    def angle_rad(self) -> Coordinates:
        """The rotation angle from A-scan 0 at the centre of each sector, float64 (n_columns,), rad."""
        return sector_angles_rad(self.n_ascans, len(self.samples))


def reduced(frame: Frame, n_columns: int) -> ReducedBscan:
    """Return a B-scan as means over ``n_columns``; one that was reduced to as many already is returned as it is."""
    if isinstance(frame, ReducedBscan) and len(frame.samples) == n_columns:
        return frame
    return ReducedBscan(
        index=frame.index,
        samples=sector_means(frame.samples, n_columns),
        z_mm=frame.z_mm,
        n_ascans=ascans_of(frame),
        saturated=_saturated(frame),
    )


def ascans_of(frame: Frame) -> int:
    """Return how many A-scans of a B-scan were recorded."""
    return frame.n_ascans if isinstance(frame, ReducedBscan) else len(frame.samples)


def columns_of(frame: Frame, parameters: OctParameters) -> int:
    """Return how many columns a panorama of B-scans as ``frame`` has."""
    return min(parameters.n_theta or MOST_COLUMNS, ascans_of(frame))


def reduced_pullback(stream: FrameStream, parameters: OctParameters) -> AbstractContextManager[FrameStream]:
    """Return a stream of the :class:`ReducedBscan` of ``stream``; each is read from there when it is first needed."""
    return kept_frames(stream, lambda frame: reduced(frame, columns_of(frame, parameters)))


def _saturated(frame: Frame) -> bool:
    """Whether the median of the A-scans is the largest value of their type."""
    if isinstance(frame, ReducedBscan):
        return frame.saturated
    if frame.samples.dtype.kind != "u":
        return False
    some = frame.samples[:: max(1, len(frame.samples) // JUDGED_ASCANS)]
    return 2 * int(np.count_nonzero(some == np.iinfo(some.dtype).max)) > some.size


def share_brightening(bscan: Image) -> float:
    """Return in which share of its sectors a B-scan (A-scan, depth) brightens with depth faster than it darkens.

    Thin lines, which do both, are left out, and so is what lies at one depth all around. A sector that shows nothing
    counts as half of one.
    """
    sectors = reduce_theta(bscan, min(SECTORS, bscan.shape[0]))
    sectors = (sectors - quantiles(sectors, STEADY)).astype(np.float32)
    size = max(3, round(WINDOW * sectors.shape[1]))
    window, ends = np.ones((1, size | 1), np.uint8), cv2.BORDER_REFLECT
    opened = cv2.dilate(cv2.erode(sectors, window, borderType=ends), window, borderType=ends)
    smooth = uniform_filter1d(opened, size, axis=1)
    rise = smooth[:, size:] - smooth[:, :-size]
    return float(np.mean(0.5 + 0.5 * np.sign(rise.max(axis=1) + rise.min(axis=1))))
