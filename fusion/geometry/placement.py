"""Images of the wall brought onto other rows and columns, in the frame where an alignment puts them.

Rows and columns are resampled separately, each by a sparse matrix, from what was observed only. Where new samples lie
closer than the old ones they are interpolated linearly. Where they lie farther apart, each is the mean over its extent.

Bores far wider than those in bone are seen as one of 2.5 mm. A cell in bone has its size whether the bore has 2.2 mm or
2.8 mm, so lengths are in mm there. In a hole forty times as wide, a length in mm is a share of the bore.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from endoct.base.arrays import Coordinates, Image, Mask, read_view
from endoct.base.compute.compiled import compiled
from endoct.base.errors import EndoctError
from endoct.base.numeric.distance import signed_distance
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

REFERENCE_RADIUS_MM = 1.25
WIDEST_IN_BONE_MM = 5.0
"""Up to this radius, lengths are in mm."""
FARTHEST_ROW = 0.75
"""How far, in row spacings, a place may lie from the nearest row and still count as observed."""
FARTHEST_OUTLINE_MM = 1.0
FINEST_DZ_MM = 0.02
"""Rows of a common grid lie no closer unless asked to."""
SAME_BORE = 0.03
"""Two nominal diameters of one bore differ by no more than this share of the larger."""
HALF = np.float32(0.5 - 1e-6)
IN_PLACE = Alignment(theta_shift_rad=0.0, z_shift_mm=0.0)


def bore_scale(radius_mm: float) -> float:
    """Return how many times as wide as one of 2.5 mm a bore is to be seen; 1 for every bore in bone."""
    return radius_mm / REFERENCE_RADIUS_MM if radius_mm > WIDEST_IN_BONE_MM else 1.0


def scaled_grid(grid: SurfaceGrid, factor: float) -> SurfaceGrid:
    """Return ``grid`` with every length times ``factor``."""
    rows = None if grid.rows_mm is None else tuple(factor * z for z in grid.rows_mm)
    lengths = {name: factor * getattr(grid, name) for name in ("z0_mm", "dz_mm", "radius_mm")}
    return replace(grid, **lengths, rows_mm=rows)


def scaled_panorama(panorama: Panorama, factor: float) -> Panorama:
    """Return ``panorama`` with its places and depths times ``factor``; values per frame stay."""

    def scaled(image: Image | None) -> Image | None:
        return None if image is None else np.float32(factor) * image

    return replace(
        panorama,
        grid=scaled_grid(panorama.grid, factor),
        depth_mm=scaled(panorama.depth_mm),
        parallax_depth_mm=scaled(panorama.parallax_depth_mm),
        parallax_error_mm=scaled(panorama.parallax_error_mm),
    )


def row_weights(from_mm: Coordinates, spacing_mm: float, to_mm: Coordinates, extent_mm: float) -> sparse.csr_array:
    """Return the matrix (n_to, n_from) that takes rows at ``from_mm`` (ascending) to rows at ``to_mm``.

    ``spacing_mm`` is the nominal distance of the old rows, ``extent_mm`` the height of a new one. Rows of the
    matrix sum to one inside, to less where the new row lies partly beyond the ends, to zero in gaps.
    """
    index = np.arange(from_mm.size, dtype=np.float64)
    low, high = (_index_of(to_mm + side * extent_mm / 2, from_mm, spacing_mm, index) for side in (-1, 1))
    middle = _index_of(to_mm, from_mm, spacing_mm, index)
    taps, weights = _taps(low, middle, high)
    inside = (taps >= 0) & (taps < from_mm.size)
    nearest = from_mm[np.clip(np.rint(middle).astype(np.intp), 0, from_mm.size - 1)]
    near = np.abs(nearest - to_mm) <= max(FARTHEST_ROW * spacing_mm, extent_mm / 2)
    return _matrix(np.clip(taps, 0, from_mm.size - 1), weights * inside * near[:, np.newaxis], from_mm.size)


def column_weights(n_from: int, to_columns: Coordinates, extent: float) -> sparse.csr_array:
    """Return the matrix (n_to, n_from) that takes ``n_from`` columns of a circle to ``to_columns``.

    ``to_columns`` are fractional indices of the old columns; ``extent`` is the width of a new column in old ones.
    """
    taps, weights = _taps(to_columns - extent / 2, to_columns, to_columns + extent / 2)
    return _matrix(np.mod(taps, n_from), weights, n_from)


def resample(image: Image, valid: Mask, rows: sparse.csr_array, columns: sparse.csr_array) -> tuple[Image, Mask]:
    """Return (image, valid) on new rows and columns, from valid samples only.

    A new sample is valid where at least half of it was observed; elsewhere the image is 0.
    """
    # equally many taps for every column, so that they can be taken one after the other
    taps, weights = (part.reshape(columns.shape[0], -1).T for part in (columns.indices, columns.data))
    across = np.ascontiguousarray(taps, dtype=np.int32), np.ascontiguousarray(weights)
    down = rows.indptr.astype(np.int32), rows.indices.astype(np.int32), rows.data  # int64 where SciPy likes
    filled = np.diff(rows.indptr) > 0
    first = rows.indptr[:-1][filled]
    reach = np.maximum.reduceat(rows.indices, first) - np.minimum.reduceat(rows.indices, first) if first.size else [0]
    image, valid = read_view(image.astype(np.float32, copy=False)), read_view(valid)
    return _resampled(image, valid, across, down, int(np.max(reach)) + 1)


@compiled
def _resampled(
    image: Image,
    valid: Mask,
    across: tuple[NDArray[np.int32], Image],
    down: tuple[NDArray[np.int32], NDArray[np.int32], Image],
    n_held: int,
) -> tuple[Image, Mask]:
    """What :func:`resample` returns; the last ``n_held`` old rows are kept as they lie on the new columns."""
    starts, old_rows, down_weights = down
    n_to, n = starts.size - 1, across[0].shape[1]
    new, observed = np.empty((n_to, n), np.float32), np.empty((n_to, n), np.bool_)
    held, held_row = np.empty((2, n_held, n), np.float32), np.full(n_held, -1)
    total, share = np.empty(n, np.float32), np.empty(n, np.float32)
    for row in range(n_to):
        total[:], share[:] = 0, 0
        for k in range(starts[row], starts[row + 1]):
            old, weight = old_rows[k], down_weights[k]
            value, known = held[0, old % n_held], held[1, old % n_held]
            if held_row[old % n_held] != old:
                held_row[old % n_held] = old
                _row_across(image[old], valid[old], across, value, known)
            for column in range(n):
                total[column] += weight * value[column]
                share[column] += weight * known[column]
        for column in range(n):
            observed[row, column] = share[column] >= HALF
            mean = total[column] / share[column]
            new[row, column] = mean if share[column] >= HALF else np.float32(0)
    return new, observed


@compiled
def _row_across(row: Image, valid: Mask, across: tuple[NDArray[np.int32], Image], value: Image, known: Image) -> None:
    """Fill ``value`` and ``known`` with sums of weights times valid samples, and of these weights, on new columns."""
    taps, weights = across
    observed, masked = np.empty(row.size, np.float32), np.empty(row.size, np.float32)
    for column in range(row.size):
        observed[column] = valid[column]
        masked[column] = row[column] if valid[column] else np.float32(0)
    value[:], known[:] = 0, 0
    for k in range(taps.shape[0]):
        for column in range(value.size):  # innermost, since this loop can be made of vectors
            value[column] += weights[k, column] * masked[taps[k, column]]
            known[column] += weights[k, column] * observed[taps[k, column]]


def rolled(image: Image, valid: Mask, by_columns: Coordinates) -> tuple[Image, Mask]:
    """Return (image, valid) with each row moved on along θ by that many columns, (n_z,), interpolated linearly."""
    n_theta = image.shape[1]
    at = np.arange(n_theta) - by_columns[:, np.newaxis]
    left = np.floor(at)
    aside = (at - left).astype(np.float32)
    before = np.mod(left, n_theta).astype(np.intp)
    after = np.where(before == n_theta - 1, 0, before + 1)
    one, two = (np.take_along_axis(image, columns, axis=1) for columns in (before, after))
    known = np.take_along_axis(valid, before, axis=1) & ((aside == 0) | np.take_along_axis(valid, after, axis=1))
    return np.where(known, one + (two - one) * aside, np.float32(0)), known


def _index_of(z_mm: Coordinates, from_mm: Coordinates, spacing_mm: float, index: Coordinates) -> Coordinates:
    """Return the fractional row index of ``z_mm``, continued with the nominal spacing beyond the ends."""
    inner = np.interp(z_mm, from_mm, index)
    beyond = z_mm - np.clip(z_mm, from_mm[0], from_mm[-1])
    return np.asarray(inner + beyond / spacing_mm, dtype=np.float64)


def _taps(low: Coordinates, middle: Coordinates, high: Coordinates) -> tuple[NDArray[np.intp], Coordinates]:
    """Return old indices and their weights (n_to, k) for new samples that reach from ``low`` to ``high``."""
    if float(np.median(high - low)) <= 1.0:
        first = np.floor(middle)
        fraction = middle - first
        taps = first[:, np.newaxis] + np.arange(2)
        return taps.astype(np.intp), np.stack([1 - fraction, fraction], axis=1)
    first = np.floor(low + 0.5)  # old sample k reaches from k − ½ to k + ½
    n_taps = int(np.ceil(np.max(high - low))) + 1
    taps = first[:, np.newaxis] + np.arange(n_taps)
    reach = np.minimum(high[:, np.newaxis], taps + 0.5) - np.maximum(low[:, np.newaxis], taps - 0.5)
    return taps.astype(np.intp), np.clip(reach, 0, None) / (high - low)[:, np.newaxis]


def _matrix(taps: NDArray[np.intp], weights: Coordinates, n_from: int) -> sparse.csr_array:
    n_to, n_taps = taps.shape
    starts = np.arange(0, n_to * n_taps + 1, n_taps)
    return sparse.csr_array((weights.ravel().astype(np.float32), taps.ravel(), starts), shape=(n_to, n_from))


class Placement:
    """Takes images on ``from_grid``, moved by ``alignment``, to ``to_grid``, whose rows may be uneven as well.

    ``row_extent_mm`` says over how much of z a new row averages (0: interpolated at its centre).
    """

    def __init__(
        self, from_grid: SurfaceGrid, alignment: Alignment, to_grid: SurfaceGrid, row_extent_mm: float
    ) -> None:
        self._flip = slice(None, None, -1 if alignment.z_reversed else 1)
        from_mm, to_mm = alignment.z_to_a(from_grid.z_mm)[self._flip], to_grid.z_mm
        spacing_mm = alignment.z_scale * from_grid.dz_mm
        self._sample_mm = from_grid.dz_mm, from_grid.dtheta_mm
        self._farthest_mm = FARTHEST_OUTLINE_MM * bore_scale(from_grid.radius_mm)
        self._refines = to_mm.size > 1 and spacing_mm > 1.5 * float(np.median(np.diff(to_mm)))
        self._rows = row_weights(from_mm, spacing_mm, to_mm, row_extent_mm)
        old_columns = from_grid.column_of(alignment.rigid.theta_to_b(to_grid.theta_rad))
        roll_rad = (-1.0 if alignment.mirrored else 1.0) * alignment.roll_rad(from_grid.z_mm)
        self._rolled = None if alignment.bend is None else roll_rad[self._flip] / from_grid.dtheta_rad
        self._columns = column_weights(from_grid.n_theta, old_columns, from_grid.n_theta / to_grid.n_theta)

    @classmethod
    def averaging(cls, from_grid: SurfaceGrid, alignment: Alignment, to_grid: SurfaceGrid) -> "Placement":
        """Return the placement of which every new row averages over its own height."""
        return cls(from_grid, alignment, to_grid, to_grid.dz_mm)

    def image(self, image: Image, valid: Mask) -> tuple[Image, Mask]:
        """Return (image, valid) on the new grid, from valid samples only."""
        return resample(*self._in_order(image, valid), self._rows, self._columns)

    def known(self, image: Image, valid: Mask) -> Image:
        """Return ``image`` on the new grid, NaN where less than half of a sample was observed."""
        values, observed = resample(*self._in_order(image, valid), self._rows, self._columns)
        return np.where(observed, values, np.float32(np.nan))

    def _in_order(self, image: Image, valid: Mask) -> tuple[Image, Mask]:
        """Return (image, valid) with rows as they ascend in the new frame, each rolled by the bend of the alignment."""
        image, valid = image[self._flip], valid[self._flip]
        return (image, valid) if self._rolled is None else rolled(image, valid, self._rolled)

    def mask(self, mask: Mask, valid: Mask) -> tuple[Mask, Mask]:
        """Return (mask, valid) on the new grid.

        Where old rows lie farther apart than new ones, the outline is interpolated between them. What is linear in z
        is the signed distance to it on the wall (Raya and Udupa 1990, Shape-based interpolation). Elsewhere a sample
        is true where at least half of what was observed of it is.
        """
        if self._refines:
            distance, observed = self.image(signed_distance(mask & valid, self._sample_mm, self._farthest_mm), valid)
            return (distance > 0) & observed, observed
        share, observed = self.image(mask.astype(np.float32), valid)
        return (share >= 0.5) & observed, observed


@dataclass(frozen=True, eq=False)
class Sampling:
    """How a side comes onto a common grid: the ``grid`` of its own samples, and ``where`` that lies in A's frame."""

    grid: SurfaceGrid
    where: Alignment

    @property
    def spacing_mm(self) -> float:
        """Distance of its rows in A's frame, mm."""
        return self.where.z_scale * self.grid.dz_mm

    def onto(self, grid: SurfaceGrid) -> Placement:
        """Return what takes images on its samples to ``grid``."""
        return Placement.averaging(self.grid, self.where, grid)


def common_grid(a: Sampling, b: Sampling, *, dz_mm: float | None, n_theta: int) -> SurfaceGrid:
    """Return the grid in A's frame that covers the rows of both sides; A's first row is one of its rows.

    Without ``dz_mm`` its rows are as close as those of the finer side, but not closer than ``FINEST_DZ_MM``.
    """
    dz_mm = dz_mm or max(min(a.spacing_mm, b.spacing_mm), FINEST_DZ_MM)
    first_mm, last_mm = a.grid.z_mm[[0, -1]]
    ends = np.r_[first_mm, last_mm, b.where.z_to_a(b.grid.z_mm[[0, -1]])]
    before = int(np.floor((first_mm - ends.min()) / dz_mm + 1e-6))
    after = int(np.floor((ends.max() - first_mm) / dz_mm + 1e-6))
    z0_mm, radius_mm = float(first_mm) - before * dz_mm, a.grid.radius_mm
    return SurfaceGrid.full_circle(before + after + 1, n_theta, z0_mm=z0_mm, dz_mm=dz_mm, radius_mm=radius_mm)


def check_same_bore(radius_a_mm: float, radius_b_mm: float) -> tuple[str, ...]:
    """Return a note where two sides state slightly different diameters of their bore, nothing where they agree.

    Raises :class:`EndoctError` where the diameters differ by more than ``SAME_BORE``.
    """
    if abs(radius_a_mm - radius_b_mm) <= 1e-6:
        return ()
    a_mm, b_mm = f"{2 * radius_a_mm:g} mm", f"{2 * radius_b_mm:g} mm"
    if abs(radius_a_mm - radius_b_mm) > SAME_BORE * max(radius_a_mm, radius_b_mm):
        raise EndoctError(
            "the two sides are of bores of different diameters",
            found=f"bore_diameter_mm {a_mm} for side A and {b_mm} for side B",
            expected=f"one bore, its diameters stated within {SAME_BORE:.0%}",
            remedy="correct bore_diameter_mm where one bore was recorded; these may be recordings of two bores",
        )
    return (f"bore_diameter_mm is {b_mm} for this side and {a_mm} for the other; the comparison is on {a_mm}.",)
