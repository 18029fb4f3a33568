"""Where one strip lies on another: the edges in both, a correlation of all places, then a fraction of a sample.

Edges are left once what all strips show alike is taken away; they are made a few strips at a time and kept on disk.
"""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from typing import Protocol

import numpy as np
from scipy import fft

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.memory import Kept
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.circle import gaussian, wrap_rad
from endoct.base.numeric.least_squares import vertex
from endoct.stitching.motion.warp import Motion, Texture, refine_motion

FEWEST_FOR_FIXED_PATTERN = 8
AT_A_TIME = 2**20
"""Samples that are worked on together, of a few whole strips or of one part of all."""
LEAST_PART = 256
"""Samples of a part, at least: reading smaller ones takes longer than the work on them."""
LEAST_OVERLAP = 0.15
LEAST_CORRELATION = 0.3
LEAST_RATIO = 1.3
PEAK_MM = 0.3
LATEST = 8
"""Number of strips and spectra held, so that each is read and transformed once for all its pairs."""
Windows = list[tuple[float, float]]


class Strips(Protocol):
    """Strips, float32 (n_rows, n_theta), all of one shape: an array of them, or what reads or makes each anew."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> Image: ...


def keep_textures(
    textures: Kept[Texture], strips: Strips, valid: Mask | None, sigma_rows: float, sigma_columns: float
) -> None:
    """Append to ``textures`` the edges in every strip without what every row or every strip shows alike.

    Samples that are NaN or not ``valid``, bool (n, n_rows, n_theta), count as not observed. Edges, not areas, say where
    a strip lies. The cells themselves leave a trace of the median frame in it, which would pull every feed towards
    zero.
    """

    def visible_part(k: int) -> Image:
        sees = np.isfinite(strip := strips[k])
        return np.where(sees if valid is None else sees & valid[k], strip, np.nan).astype(np.float32)

    n, shape = len(strips), strips[0].shape
    group, part = max(1, AT_A_TIME // prod(shape)), max(LEAST_PART, AT_A_TIME // n)
    groups = [range(k, min(k + group, n)) for k in range(0, n, group)]
    parts = [slice(k, k + part) for k in range(0, prod(shape), part)]

    def put_away(blocks: Kept[Image], whole: bool) -> bool:
        """Return False if strips marked ``whole`` have gaps."""
        for those in groups:
            visible = map(visible_part, those)
            images = np.stack([(image - _nanmedians(image, whole)[:, None]).ravel() for image in visible])
            if whole and np.isnan(images).any():
                return False
            for part_of_all in parts:
                blocks.append(np.ascontiguousarray(images[:, part_of_all]))
        return True

    with ExitStack() as stack:  # every part of the first strips, then every part of the next
        blocks = stack.enter_context(Kept[Image]())
        whole = not np.isnan(visible_part(0)).any()
        if not put_away(blocks, whole):
            whole, blocks = False, stack.enter_context(Kept[Image]())
            put_away(blocks, whole)
        fixed = None
        if n >= FEWEST_FOR_FIXED_PATTERN:
            columns = (
                np.concatenate([blocks[at] for at in range(k, len(blocks), len(parts))]) for k in range(len(parts))
            )
            fixed = np.concatenate([_nanmedians(column.T, whole) for column in columns])
        blur = _Blur(sigma_rows, sigma_columns)
        for first in range(0, len(blocks), len(parts)):
            images = np.concatenate([blocks[first + k] for k in range(len(parts))], axis=1)
            if fixed is not None:
                images -= fixed
            for image in images.reshape(-1, *shape):
                textures.append(blur.edges(image))


class _Blur:
    """A blur over the samples that are seen, as far as strips see the same one after the other."""

    def __init__(self, sigma_rows: float, sigma_columns: float) -> None:
        self._sigmas = sigma_rows, sigma_columns
        self._seen: Mask | None = None
        self._share: Image

    def edges(self, image: Image) -> Texture:
        """Return ``image``, NaN where nothing is seen, without what is left of it when blurred."""
        seen = ~np.isnan(image)
        if self._seen is None or not np.array_equal(seen, self._seen):
            self._seen, self._share = seen, np.maximum(gaussian(seen.astype(np.float32), *self._sigmas), 0.01)
        edges = np.where(seen, image, np.float32(0))
        edges -= gaussian(edges, *self._sigmas) / self._share
        edges[~seen] = 0
        return edges, seen


def _nanmedians(values: Image, whole: bool) -> Image:
    """Median of every row without NaN, and 0 where there is nothing else.

    Of two in the middle the mean where the strips are ``whole``, without any NaN, else the lower.
    """
    ordered = np.array(values, order="C")
    ordered.sort(axis=1)
    if whole:
        n = ordered.shape[1]
        return np.asarray((ordered[:, (n - 1) // 2] + ordered[:, n // 2]) / 2, np.float32)
    count = np.count_nonzero(~np.isnan(ordered), axis=1)
    middle = ordered[np.arange(count.size), np.maximum((count - 1) // 2, 0)]
    return np.where(count > 0, middle, np.float32(0))


@dataclass(frozen=True, eq=False)
class Pairs:
    """How each strip lies on the one ``step`` earlier; arrays (n_pairs,) float64 unless said otherwise.

    Attributes
    ----------
    feed_mm, roll_rad: place of the later strip minus that of the earlier, each (n_pairs, 3): the mean, and the parts
        that go with cos θ and sin θ of the earlier strip.
    correlation: at the best place.
    ratio: how many times as high that is as at the best place elsewhere. Near 1 it means "I do not know".
    trusted: bool, whether correlation and ratio are high enough.
    stretch: the share by which the feed is larger in the last row than in the middle one.
    """

    step: int
    feed_mm: Coordinates
    roll_rad: Coordinates
    correlation: Coordinates
    ratio: Coordinates
    trusted: Mask
    stretch: Coordinates


@dataclass(frozen=True)
class _Place:
    """The best place of one strip on another, in rows and columns, NaN where there is no overlap to search."""

    rows: float
    columns: float
    correlation: float
    ratio: float

    @property
    def trusted(self) -> bool:
        return self.correlation >= LEAST_CORRELATION and self.ratio >= LEAST_RATIO


NOWHERE = _Place(np.nan, 0.0, 0.0, 0.0)


class Matcher:
    """Correlates strips by their spectra, pair by pair: of all of them only the energies of their rows are held."""

    def __init__(self, textures: Kept[Texture], dz_mm: float, radius_mm: float) -> None:
        self.textures, self.n = textures, len(textures)
        self.energy = np.array([np.sum(np.square(image, dtype=np.float64), axis=1) for image, _ in textures])
        self.n_rows, self.n_theta = textures[0][0].shape
        self.dz_mm = dz_mm
        self.length = fft.next_fast_len(2 * self.n_rows, real=False)
        self._spectrum, self._texture = (
            lru_cache(LATEST)(lambda k: np.asarray(fft.rfft2(textures[k][0], s=(self.length, self.n_theta)))),
            lru_cache(LATEST)(textures.__getitem__),
        )
        self.reach_rows = max(2, round(PEAK_MM / dz_mm))
        self.reach_columns = max(2, min(self.n_theta // 4, round(PEAK_MM / radius_mm / (2 * np.pi) * self.n_theta)))

    def search(self, choices: Mapping[int, list[Windows | None]]) -> list[list[list[_Place]]]:
        """Return the best place of every strip on the one some steps earlier, within a choice of windows.

        ``choices`` has them by steps, and so has the result lists of places by choice.
        """

        def places(later: int) -> list[list[_Place]]:
            self._spectrum(later)  # first, as another thread is at work on those before it
            return [
                self._places(later - step, later, [None if some is None else some[later - step] for some in windows])
                for step, windows in choices.items()
                if later >= step
            ]

        found: list[list[list[_Place]]] = [[] for _ in choices]
        for of_strip in thread_map(places, range(self.n)):
            for of_step, of_pair in zip(found, of_strip, strict=False):
                of_step.append(of_pair)
        return [[list(of_choice) for of_choice in zip(*of_pairs, strict=True)] for of_pairs in found]

    def refine(self, step: int, places: list[_Place]) -> Pairs:
        """Return the places to a fraction of a sample, with their harmonics."""

        def motion_of(k: int) -> Motion:
            start = Motion.even(places[k].rows, places[k].columns)
            if not places[k].trusted:
                return start
            (a, seen_a), (b, seen_b) = self._texture(k), self._texture(k + step)
            return refine_motion(a, b, seen_a, seen_b, start)

        motions = list(thread_map(motion_of, range(len(places))))
        return Pairs(
            step,
            feed_mm=np.array([motion.rows for motion in motions]).reshape(-1, 3) * self.dz_mm,
            roll_rad=np.array([motion.columns for motion in motions]).reshape(-1, 3) * 2 * np.pi / self.n_theta,
            correlation=np.array([place.correlation for place in places]),
            ratio=np.array([place.ratio for place in places]),
            trusted=np.array([place.trusted for place in places], np.bool_),
            stretch=np.array([m.stretch / m.rows[0] if abs(m.rows[0]) >= 1 else 0.0 for m in motions]),
        )

    def _places(self, a: int, b: int, windows: list[tuple[float, float] | None]) -> list[_Place]:
        shifts = np.arange(-(self.n_rows - 1), self.n_rows)
        overlap = (self.n_rows - np.abs(shifts)) / self.n_rows
        allowed = [overlap >= LEAST_OVERLAP for _ in windows]
        for within, window in zip(allowed, windows, strict=True):
            if window is not None:
                within &= (shifts * self.dz_mm >= window[0]) & (shifts * self.dz_mm <= window[1])
        if not np.any(allowed):
            return [NOWHERE] * len(windows)
        wanted = np.flatnonzero(np.any(allowed, axis=0))
        # as a function: an operator writes into a factor that nobody else holds, and rounds otherwise for the left one
        product = np.multiply(self._spectrum(a), np.conj(self._spectrum(b)))
        by_row = fft.ifft(product, axis=0, overwrite_x=True)
        planes = fft.irfft(by_row[shifts[wanted]], n=self.n_theta, axis=1, overwrite_x=True)
        return [
            self._place(planes[within[wanted]], shifts[within], overlap[within], a, b) if within.any() else NOWHERE
            for within in allowed
        ]

    def _place(self, plane: np.ndarray, shifts: np.ndarray, overlap: Coordinates, a: int, b: int) -> _Place:
        """Return the best place by the correlations of ``a`` and ``b``, (n_shifts, n_theta), before normalisation."""
        plane = plane / np.sqrt(np.maximum(self._energies(a, b, shifts), 1e-12))[:, None]
        # a correlation over little overlap is high by chance more often
        score = plane * np.sqrt(overlap)[:, None]
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        elsewhere = score.copy()
        near = slice(max(0, int(row) - self.reach_rows), int(row) + self.reach_rows + 1)
        around = np.arange(column - self.reach_columns, column + self.reach_columns + 1) % self.n_theta
        elsewhere[near, around] = -np.inf
        second = max(float(elsewhere.max()), 0.02)
        return _Place(
            rows=float(shifts[0]) + _vertex(score[:, column], int(row), cyclic=False),
            columns=float(wrap_rad(2 * np.pi / self.n_theta * _vertex(score[row], int(column), cyclic=True)))
            * self.n_theta
            / (2 * np.pi),
            correlation=float(plane[row, column]),
            ratio=float(score[row, column]) / second,
        )

    def _energies(self, a: int, b: int, shifts: np.ndarray) -> Coordinates:
        """Energy of both strips' rows that overlap at each shift (row of a minus row of b), multiplied."""
        sums_a, sums_b = (np.concatenate([[0.0], np.cumsum(self.energy[k])]) for k in (a, b))
        first = np.maximum(shifts, 0)
        last = np.minimum(self.n_rows + shifts, self.n_rows)
        product: Coordinates = (sums_a[last] - sums_a[first]) * (sums_b[last - shifts] - sums_b[first - shifts])
        return product


def _vertex(values: np.ndarray, at: int, *, cyclic: bool) -> float:
    """Return the place of the parabola's top through the sample ``at`` and its neighbours."""
    if not cyclic and not 0 < at < len(values) - 1:
        return float(at)
    return at + float(vertex(*map(float, (values[at - 1], values[at], values[(at + 1) % len(values)]))))
