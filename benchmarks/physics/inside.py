"""How dense bone is inside, read from a CT and from B-scans of one bore: as images alone show it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.physics.bscans import decibels, gaussian_fwhm, plain, wall_row
from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.field import world_of
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.ct_scan import TISSUE_HU, Scan, scan
from endoct.synthetic.draw import draw
from endoct.synthetic.oct.beams import BONE_INDEX
from endoct.synthetic.oct.bscan import render_bscans
from endoct.synthetic.oct.sweep import build_appearance
from endoct.synthetic.sample.parameters import Ct, Sample
from endoct.synthetic.sample.presets import PRESETS

SEED = 1000
CT = Ct(voxel_mm=0.15, psf_mm=0.2, noise_hu=0.0, bone_hu=1500.0)
SIGMA_MM = 0.2 / 2.3548  # of its point spread
ROWS = 5, 65  # of a B-scan below the wall: 0.3 mm of path
ASCANS = 40  # averaged: 0.16 mm of wall
NOT_BONE_VOXELS = 12  # around the cochlea and what else is no bone


@dataclass(frozen=True, eq=False)
class Inside:
    """Relative densities (slice, place) from the CT and from B-scans, and the CT's correlation.

    ``length_mm``: over which that falls to 1/e, measured; ``expected_mm``: of the field, widened by the point spread.
    """

    of_ct: NDArray[np.float64]
    of_oct: NDArray[np.float64]
    length_mm: float
    expected_mm: float

    @property
    def slope(self) -> float:
        """By how much the OCT's brightness changes with the CT's density, relative."""
        ct, oct_ = self.of_ct - self.of_ct.mean(), self.of_oct - self.of_oct.mean()
        return float(np.sum(ct * oct_) / np.sum(ct * ct)) * float(self.of_ct.mean() / self.of_oct.mean())

    @property
    def correlation(self) -> float:
        """Of both."""
        return float(np.corrcoef(self.of_ct.ravel(), self.of_oct.ravel())[0, 1])


def inside(scale_mm: float = 0.6, contrast: float = 0.2, every: int = 1) -> Inside:
    """Return what a CT and B-scans, one of ``every`` so many, show of solid bone without channels."""
    sample = solid(scale_mm, contrast)
    picture = scan(sample, CT, drilled=False)
    n_ascans, slices = PRESETS[sample.preset].n_ascans, range(0, PRESETS[sample.preset].n_slices, every)
    wall = build_wall(sample)
    first = round(wall_row(sample))
    rows = np.arange(first + ROWS[0], first + ROWS[1])
    bscans = render_bscans(sample, wall, build_appearance(sample, wall), slices)
    levels = np.stack([decibels(sample, bscan)[rows] for bscan in bscans])
    intensity = (10 ** (levels / 10)).reshape(len(slices), rows.size, -1, ASCANS)
    turn = 2 * np.pi * np.arange(n_ascans).reshape(-1, ASCANS).mean(axis=1) / n_ascans
    theta = sample.oct.theta_origin_rad + sample.oct.sense * turn
    depth = (rows - wall_row(sample)) * sample.oct.axial_pixel_mm / BONE_INDEX
    radius = sample.bore.diameter_mm / 2 + depth[:, None]
    z_mm = np.array([sample.oct.z_mm[i] for i in slices])[:, None, None]
    x, y, z = np.broadcast_arrays(radius * np.cos(theta), radius * np.sin(theta), z_mm)
    density = _density_at(sample, picture, np.stack([x, y, z], axis=-1)).mean(axis=1)
    length, expected = _length_mm(picture), float(np.sqrt(scale_mm**2 + 4 * (SIGMA_MM**2 + CT.voxel_mm**2 / 12)))
    return Inside(density, intensity.mean(axis=(1, 3)), length, expected)


def solid(scale_mm: float, contrast: float) -> Sample:
    """Return a bore through solid bone of that density, as plain as can be."""
    known = {
        "network.pneumatised": (0.0, 0.0), "density.channel_mm": (0.0, 0.0),
        "density.scale_mm": (scale_mm, scale_mm), "density.contrast": (contrast, contrast),
    }  # fmt: skip
    bone = draw("mastoid", SEED, ranges=known).bore
    # light falls slowly, so that all rows count alike
    sample = plain(seed=SEED, wall_db=24.0, attenuation_mm=5.0, roll_off_db=6.0)
    bore = {"bone": "network", "network": bone.network, "density": bone.density}
    return sample.model_copy(update={"bore": sample.bore.model_copy(update=bore)})


def _density_at(sample: Sample, picture: Scan, places: Coordinates) -> NDArray[np.float64]:
    """Return density, 1 for that of ``CT``, of places (…, 3) in the bore, read from the picture."""
    pose = world_of(sample)
    index = np.linalg.solve(
        picture.lattice.steps_mm.T, (places @ pose[:3, :3].T + pose[:3, 3] - picture.lattice.origin_mm)[..., None]
    )[..., 0]
    hu = ndimage.map_coordinates(picture.hu.astype(np.float64), np.moveaxis(index, -1, 0), order=1)
    return np.asarray((hu - TISSUE_HU) / (CT.bone_hu - TISSUE_HU))


def _length_mm(picture: Scan) -> float:
    """Return the length over which the correlation of the bone's Hounsfield units falls to 1/e."""
    bone = ndimage.distance_transform_cdt(picture.label == 1) > NOT_BONE_VOXELS
    values = np.where(bone, picture.hu - picture.hu[bone].mean(), 0)
    # up to where correlation is 0.3: of pairs of which both are bone
    value, lags = [], np.arange(1, 8)
    for lag in lags:
        along = [
            (np.sum(values * np.roll(values, lag, axis)), np.sum(bone & np.roll(bone, lag, axis))) for axis in range(3)
        ]
        value.append(float(np.mean([total / count for total, count in along])))
    variance = float(np.mean(values[bone] ** 2))
    fwhm = gaussian_fwhm(lags * CT.voxel_mm, np.array(value) / variance)
    return fwhm / (2 * float(np.sqrt(np.log(2))))
