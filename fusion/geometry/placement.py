"""A side's images brought onto a common grid, in the frame an alignment puts them in."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from endoct.base.arrays import Image, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import pad_circle
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.resample import column_weights, resample, row_weights
from endoct.stitching.grid import SurfaceGrid

FARTHEST_OUTLINE_MM = 1.0

FINEST_DZ_MM = 0.02
"""Rows of a common grid lie no closer unless asked to."""

SAME_BORE = 0.03
"""Nominal diameters of one bore that two people wrote down differ by no more, as a share of the larger."""

IN_PLACE = Alignment(theta_shift_rad=0.0, z_shift_mm=0.0)


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
        self._refines = to_mm.size > 1 and spacing_mm > 1.5 * float(np.median(np.diff(to_mm)))
        self._rows = row_weights(from_mm, spacing_mm, to_mm, row_extent_mm)
        old_columns = from_grid.column_of(alignment.theta_to_b(to_grid.theta_rad))
        self._columns = column_weights(from_grid.n_theta, old_columns, from_grid.n_theta / to_grid.n_theta)

    @classmethod
    def averaging(cls, from_grid: SurfaceGrid, alignment: Alignment, to_grid: SurfaceGrid) -> "Placement":
        """Return the placement of which every new row averages over its own height."""
        return cls(from_grid, alignment, to_grid, to_grid.dz_mm)

    def image(self, image: Image, valid: Mask) -> tuple[Image, Mask]:
        """Return (image, valid) on the new grid, from valid samples only."""
        return resample(image[self._flip], valid[self._flip], self._rows, self._columns)

    def known(self, image: Image, valid: Mask) -> Image:
        """Return ``image`` on the new grid, NaN where nothing of it was observed."""
        values, observed = self.image(image, valid)
        return np.where(observed, values, np.float32(np.nan))

    def mask(self, mask: Mask, valid: Mask) -> tuple[Mask, Mask]:
        """Return (mask, valid) on the new grid.

        Between old rows farther apart than new ones the outline is interpolated: what is linear in z is the signed
        distance to it on the wall (Raya and Udupa 1990, Shape-based interpolation), not the mask. Else a sample is
        true where at least half of what was observed of it is.
        """
        if self._refines:
            distance, observed = self.image(signed_distance(mask & valid, self._sample_mm), valid)
            return (distance > 0) & observed, observed
        share, observed = self.image(mask.astype(np.float32), valid)
        return (share >= 0.5) & observed, observed


@dataclass(frozen=True, eq=False)
class Sampling:
    """How a side comes onto a common grid: the grid of its own samples, and ``where`` in A's frame that was placed."""

    grid: SurfaceGrid
    where: Alignment

    @property
    def spacing_mm(self) -> float:
        """Distance of its rows in A's frame, mm."""
        return self.where.z_scale * self.grid.dz_mm

    def onto(self, grid: SurfaceGrid) -> Placement:
        """Return what takes images on its samples to ``grid``."""
        return Placement.averaging(self.grid, self.where, grid)


def signed_distance(mask: Mask, sample_mm: tuple[float, float]) -> Image:
    """Return the distance to the outline of ``mask`` in mm, positive inside, at most ``FARTHEST_OUTLINE_MM``."""
    pad = min(int(np.ceil(FARTHEST_OUTLINE_MM / sample_mm[1])), mask.shape[1])
    padded = pad_circle(mask, pad)
    inside = distance_transform_edt(padded, sampling=sample_mm) if not padded.all() else np.full(padded.shape, np.inf)
    outside = distance_transform_edt(~padded, sampling=sample_mm) if padded.any() else np.full(padded.shape, np.inf)
    distance = np.where(padded, inside, -outside)[:, pad : pad + mask.shape[1]]
    return np.clip(distance, -FARTHEST_OUTLINE_MM, FARTHEST_OUTLINE_MM).astype(np.float32)


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
