"""A side's images brought onto a common grid, in the frame an alignment puts them in."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.resample import column_weights, resample, row_weights
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

FARTHEST_OUTLINE_MM = 1.0

IN_PLACE = Alignment(theta_shift_rad=0.0, z_shift_mm=0.0)


@dataclass(frozen=True, eq=False)
class Samples:
    """Where the samples of an image lie: its columns by ``grid``, its rows, even or not, at ``z_mm``, (n_z,)."""

    grid: SurfaceGrid
    z_mm: Coordinates


class Placement:
    """Takes images on the samples of ``panorama``, moved by ``alignment``, to rows and columns of another grid.

    ``z_mm`` are the new rows (uneven ones allowed), ``grid`` says the new columns, ``row_extent_mm`` over how much
    of z a new row averages (0: interpolated at its centre).
    """

    def __init__(
        self,
        panorama: Panorama | Samples,
        alignment: Alignment,
        grid: SurfaceGrid,
        z_mm: Coordinates,
        row_extent_mm: float,
    ) -> None:
        self._flip = slice(None, None, -1 if alignment.z_reversed else 1)
        from_mm = alignment.z_to_a(panorama.z_mm)[self._flip]
        spacing_mm = alignment.z_scale * panorama.grid.dz_mm
        self._sample_mm = panorama.grid.dz_mm, panorama.grid.dtheta_mm
        self._refines = z_mm.size > 1 and spacing_mm > 1.5 * float(np.median(np.diff(z_mm)))
        self._rows = row_weights(from_mm, spacing_mm, z_mm, row_extent_mm)
        old_columns = panorama.grid.column_of(alignment.theta_to_b(grid.theta_rad))
        self._columns = column_weights(panorama.grid.n_theta, old_columns, panorama.grid.n_theta / grid.n_theta)

    def image(self, image: Image, valid: Mask) -> tuple[Image, Mask]:
        """Return (image, valid) on the new grid, from valid samples only."""
        return resample(image[self._flip], valid[self._flip], self._rows, self._columns)

    def mask(self, mask: Mask, valid: Mask) -> tuple[Mask, Mask]:
        """Return (mask, valid) on the new grid.

        Between old rows farther apart than new ones the outline is interpolated: what is linear in z is the signed
        distance to it on the wall (Raya and Udupa 1990, Shape-based interpolation), not the mask. Else a sample is
        true where at least half of what was observed of it is.
        """
        if self._refines:
            distance, seen = self.image(signed_distance(mask & valid, self._sample_mm), valid)
            return (distance > 0) & seen, seen
        share, seen = self.image(mask.astype(np.float32), valid)
        return (share >= 0.5) & seen, seen


def signed_distance(mask: Mask, sample_mm: tuple[float, float]) -> Image:
    """Return the distance to the outline of ``mask`` in mm, positive inside, at most ``FARTHEST_OUTLINE_MM``."""
    pad = min(int(np.ceil(FARTHEST_OUTLINE_MM / sample_mm[1])), mask.shape[1])
    padded = np.pad(mask, ((0, 0), (pad, pad)), mode="wrap")
    inside = distance_transform_edt(padded, sampling=sample_mm) if not padded.all() else np.full(padded.shape, np.inf)
    outside = distance_transform_edt(~padded, sampling=sample_mm) if padded.any() else np.full(padded.shape, np.inf)
    distance = np.where(padded, inside, -outside)[:, pad : pad + mask.shape[1]]
    return np.clip(distance, -FARTHEST_OUTLINE_MM, FARTHEST_OUTLINE_MM).astype(np.float32)


def common_grid(a: Panorama, b: Panorama, alignment: Alignment, *, dz_mm: float, n_theta: int) -> SurfaceGrid:
    """Return the grid in A's frame that covers the rows of both sides; A's first row is one of its rows."""
    ends = np.concatenate([a.z_mm[[0, -1]], alignment.z_to_a(b.z_mm[[0, -1]])])
    before = int(np.floor((a.z_mm[0] - ends.min()) / dz_mm + 1e-6))
    after = int(np.floor((ends.max() - a.z_mm[0]) / dz_mm + 1e-6))
    z0_mm = float(a.z_mm[0]) - before * dz_mm
    return SurfaceGrid.full_circle(before + after + 1, n_theta, z0_mm=z0_mm, dz_mm=dz_mm, radius_mm=a.grid.radius_mm)


def check_same_bore(radius_a_mm: float, radius_b_mm: float) -> None:
    """Raise :class:`EndoctError` where two sides give different bore diameters."""
    if abs(radius_a_mm - radius_b_mm) > 1e-6:
        raise EndoctError(
            "the two sides are of different bores",
            found=f"bore diameters of {2 * radius_a_mm:g} and {2 * radius_b_mm:g} mm",
            expected="one bore",
            remedy="check bore_diameter_mm in both sidecars",
        )
