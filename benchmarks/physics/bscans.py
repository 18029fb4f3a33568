"""What the OCT makes of a plain bore: speckle, noise, roll-off, point spread and attenuation, from rendered pixels.

The bore is smooth, round and without cells, the catheter on its axis, so that every row of a B-scan is one depth.
Levels are in dB, 0 dB is the mean of the noise.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from scipy.special import erf

from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.oct.beams import BONE_INDEX
from endoct.synthetic.oct.bscan import render_bscan
from endoct.synthetic.oct.sweep import Appearance, build_appearance
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS, PresetName

RAYLEIGH_SKEW = -1.1395  # of the logarithm of an exponential: −2·ζ(3)/(π²/6)^1.5
RAYLEIGH_DB = 5.5697  # its standard deviation, (10/ln 10)·π/√6
RAYLEIGH_BIAS_DB = 2.5068  # its mean under the logarithm of its mean, 10·γ/ln 10
NOTHING_DB = -80.0
EDGES = 36  # of the knife-edge target, a turn


def plain(preset: PresetName = "quick", seed: int = 1000, **oct_: Any) -> Sample:
    """Return the sample of a smooth bore without cells, recorded by a catheter on its axis; ``oct_`` as wanted."""
    drawn = draw(preset, seed, ranges={"bore.cell_fraction": (0.0, 0.0), "bore.bone": ("phantom",)})
    n = PRESETS[drawn.preset].n_slices
    bore = {
        "cells": (), "taper_mm": 0.0, "tilt_rad": 0.0, "wander_mm": 0.0, "roughness_mm": 0.0,
        "drill_mark_depth_mm": 0.0, "texture": 0.0, "smear": 0.0,
    }  # fmt: skip
    quiet = {
        "offset_mm": (0.0,) * n, "start_angle_rad": (0.0,) * n, "turn_length": (1.0,) * n, "lost_ascans": (),
        "rotation_error_rad": (((0.0, 0.0),),) * n, "sheath": (), "shadows": (), "n_glints": 0, "flare_db": 0.0,
        "patchiness_db": 0.0, "detector_line_db": NOTHING_DB, "catheter_face_db": NOTHING_DB,
        "inner_face_db": NOTHING_DB, "outer_face_db": NOTHING_DB, "wall_db": NOTHING_DB, "tail_db": NOTHING_DB,
        "scan": "step", "z_advance_mm": 0.0, "first_sample_mm": 0.0, "glass_mm": 0.1,
        "capillary_outer_diameter_mm": 1.7, "excess_noise_db": 8.0, "floor_count": 60.0, "db_per_count": 0.3,
        "focus_mm": drawn.bore.diameter_mm / 2 + (drawn.oct.glass_index - 1) * 0.1, "floor_bands_db": 0.0,
    }  # fmt: skip
    return drawn.model_copy(
        update={
            "bore": drawn.bore.model_copy(update=bore),
            "oct": drawn.oct.model_copy(update=quiet | oct_),
        }
    )


def decibels(sample: Sample, bscan: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the level over the mean noise of every pixel, dB; the floor's count is that of its mean logarithm."""
    return (bscan.astype(np.float64) - sample.oct.floor_count) * sample.oct.db_per_count - RAYLEIGH_BIAS_DB


def rendered(sample: Sample, slices: int = 1, appearance: Appearance | None = None) -> NDArray[np.float64]:
    """Return some B-scans of a plain sample side by side, dB (depth, A-scan)."""
    wall = build_wall(sample)
    look = appearance or build_appearance(sample, wall)
    return np.concatenate([decibels(sample, render_bscan(sample, wall, look, i)) for i in range(slices)], axis=1)


def outer_path_mm(sample: Sample) -> float:
    """Return the optical path along a radius to the outer face."""
    return sample.oct.capillary_outer_diameter_mm / 2 + (sample.oct.glass_index - 1) * sample.oct.glass_mm


def wall_row(sample: Sample) -> float:
    """Return the depth row of the wall: the bore's radius and the glass' delay."""
    path = sample.bore.diameter_mm / 2 + (sample.oct.glass_index - 1) * sample.oct.glass_mm
    return (path - sample.oct.first_sample_mm) / sample.oct.axial_pixel_mm


@dataclass(frozen=True)
class Speckle:
    """Contrast of the intensity; standard deviation (dB) and skew of its logarithm."""

    contrast: float
    sigma_db: float
    skew: float

    @classmethod
    def of(cls, level_db: NDArray[np.float64]) -> "Speckle":
        """Measure rows that are homogeneous along themselves; the trend from row to row is taken away."""
        intensity = 10 ** (level_db / 10)
        intensity /= intensity.mean(axis=1, keepdims=True)
        level = level_db - level_db.mean(axis=1, keepdims=True)
        sigma = float(level.std())
        return cls(float(intensity.std()), sigma, float(np.mean(level**3)) / sigma**3)


def bone_and_noise() -> tuple[Speckle, Speckle, NDArray[np.float64], NDArray[np.float64]]:
    """Return the statistics of bone 24 dB over the noise and of the noise, and the levels they were taken from."""
    sample = plain(wall_db=24.0, attenuation_mm=2.0, floor_count=110.0)
    level = rendered(sample, slices=4)
    first = round(wall_row(sample))
    bone, noise = level[first + 5 : first + 45], level[40 : first - 40]
    return Speckle.of(bone), Speckle.of(noise), bone - bone.mean(axis=1, keepdims=True), noise - noise.mean()


def grain() -> tuple[Coordinates, Coordinates, Coordinates, Coordinates]:
    """Return how the intensity of speckle correlates: lag in depth (mm of air), values, lag along the wall, values.

    Normed to 1 at lag 0. Theory: for a point spread with intensity FWHM w, a Gaussian of FWHM √2·w.
    """
    sample = plain(wall_db=24.0, attenuation_mm=2.0, axial_resolution_mm=0.012)
    level = rendered(sample, slices=4)
    first = round(wall_row(sample))
    intensity = 10 ** (level[first + 8 : first + 120] / 10)
    intensity = intensity / intensity.mean(axis=1, keepdims=True) - 1
    n = PRESETS[sample.preset].n_ascans
    deep = [float(np.mean(intensity[: len(intensity) - k] * intensity[k:])) for k in range(9)]
    turns = intensity.reshape(len(intensity), -1, n)
    along = [float(np.mean(turns * np.roll(turns, k, axis=2))) for k in range(25)]
    step = sample.bore.diameter_mm * np.pi / n
    return (
        sample.oct.axial_pixel_mm * np.arange(9.0),
        np.array(deep) / deep[0],
        step * np.arange(25.0),
        np.array(along) / along[0],
    )


def gaussian_fwhm(lag: Coordinates, value: Coordinates) -> float:
    """Return the full width at half maximum of a Gaussian through (lag, value) where it is over 0.3."""
    use = (value > 0.3) & (lag > 0)
    slope = float(np.sum(lag[use] ** 2 * np.log(value[use])) / np.sum(lag[use] ** 4))
    return 2 * float(np.sqrt(np.log(2) / -slope))


def roll_off_curve(rows: Coordinates, roll_off_db: float = 8.0) -> tuple[Coordinates, Coordinates]:
    """Return the level of the outer face moved to depth ``rows``, and what sinc² × Gauss says, in dB.

    sinc²(x/n) is the spectrometer's pixel, n its samples; a Gauss in x adds up to ``roll_off_db`` at full depth n/2.
    """
    found = []
    base = plain("learning", outer_face_db=45.0, roll_off_db=roll_off_db)
    n = 2 * PRESETS["learning"].n_depth
    wall = build_wall(base)
    look = build_appearance(base, wall)
    for row in rows:
        first_mm = outer_path_mm(base) - row * base.oct.axial_pixel_mm
        sample = base.model_copy(update={"oct": base.oct.model_copy(update={"first_sample_mm": first_mm})})
        level = decibels(sample, render_bscan(sample, wall, look, 0))
        near = level[max(0, round(row) - 5) : round(row) + 6]
        found.append(10 * np.log10(np.mean(np.sum(10 ** (near / 10), axis=0))))
    sinc_db = 20 * np.log10(np.sinc(rows / n))
    gauss_db = -(roll_off_db + 20 * np.log10(np.sinc(0.5))) * (2 * rows / n) ** 2
    theory = sinc_db + gauss_db
    # all share one factor: the face's own course over the turn and the width of its line
    return np.array(found) - float(np.mean(np.array(found) - theory)), theory


def axial_spread(resolution_mm: float) -> tuple[Coordinates, Coordinates, float]:
    """Return place (mm from the peak) and intensity (peak 1) of the outer face's line, and its FWHM in mm."""
    base = plain("learning", outer_face_db=40.0, axial_resolution_mm=resolution_mm)
    n = PRESETS["learning"].n_slices
    # a little off the axis, so that the line crosses rows at every fraction of one
    oct_ = base.oct.model_copy(update={"offset_mm": (0.05,) * n, "offset_direction_rad": (0.0,) * n, "glint_rad": 1.0})
    sample = base.model_copy(update={"oct": oct_})
    level = rendered(sample)
    alpha = oct_.theta_origin_rad + oct_.sense * 2 * np.pi * np.arange(level.shape[1]) / level.shape[1]
    across, outer, inner = 0.05 * np.sin(alpha), oct_.capillary_outer_diameter_mm / 2, outer_path_mm(sample)
    inner = outer - oct_.glass_mm
    glass = np.sqrt(outer**2 - (across / oct_.glass_index) ** 2) - np.sqrt(inner**2 - (across / oct_.glass_index) ** 2)
    path = np.sqrt(inner**2 - across**2) - 0.05 * np.cos(alpha) + oct_.glass_index * glass
    row = (path - oct_.first_sample_mm) / oct_.axial_pixel_mm
    near = np.rint(row).astype(int)[None, :] + np.arange(-8, 9)[:, None]
    intensity = 10 ** (level[near, np.arange(row.size)] / 10)
    intensity /= intensity.sum(axis=0)  # the face's own course over the turn
    place = (near - row) * oct_.axial_pixel_mm
    use = np.abs(place) < 0.6 * resolution_mm
    curvature, peak = np.polyfit(place[use] ** 2, np.log(intensity[use]), 1)
    bins = np.arange(-1.5, 1.501, 0.1) * resolution_mm
    index = np.digitize(place.ravel(), bins)
    known = [i for i in range(1, bins.size) if np.any(index == i)]
    middle = np.array([place.ravel()[index == i].mean() for i in known])
    mean = np.array([intensity.ravel()[index == i].mean() for i in known])
    return middle, mean / np.exp(peak), 2 * float(np.sqrt(np.log(2) / -curvature))


def knife_edge(slices: int = 12) -> tuple[Coordinates, Coordinates, float, float]:
    """Return place (mm along the wall) and mean intensity over an edge of bone, its FWHM and that asked for, in mm.

    Half of the wall is black, in 36 sectors; the intensity across their edges is the integral of the lateral point
    spread: ½ + ½·erf for a Gaussian one, whose width is fitted.
    """
    sample = plain(wall_db=24.0, attenuation_mm=2.0, floor_count=110.0)
    n_map = 36 * 512
    bright = (np.arange(n_map) * EDGES // n_map) % 2 == 0
    wall_db = np.repeat(np.where(bright, 0.0, NOTHING_DB)[None, :].astype(np.float32), 4, axis=0)
    look = replace(build_appearance(sample, build_wall(sample)), wall_db=wall_db, glint_db=np.full_like(wall_db, -60))
    level = rendered(sample, slices, look)
    n = PRESETS[sample.preset].n_ascans
    first = round(wall_row(sample))
    intensity = (10 ** (level[first + 5 : first + 105] / 10)).mean(axis=0)
    theta = sample.oct.theta_origin_rad + sample.oct.sense * 2 * np.pi * np.arange(n) / n
    sector = 2 * np.pi / EDGES
    within = np.mod(theta, 2 * sector)
    # distance into the bright sector from its nearer edge, by symmetry
    place = np.where(
        within < sector, np.minimum(within, sector - within), -np.minimum(within - sector, 2 * sector - within)
    )
    place_mm = np.tile(place, slices) * sample.bore.diameter_mm / 2
    bins = np.arange(-0.05, 0.0501, 0.004)
    index = np.digitize(place_mm, bins)
    mean = np.array([intensity[index == i].mean() for i in range(1, bins.size)])
    middle = np.array([place_mm[index == i].mean() for i in range(1, bins.size)])

    def edge(x: Coordinates, low: float, high: float, sigma: float) -> Coordinates:
        return np.asarray(low + (high - low) * (0.5 + 0.5 * erf(x / (np.sqrt(2) * sigma))))

    (low, high, sigma), _ = curve_fit(edge, middle, mean, p0=(1.0, mean.max(), 0.01))
    fwhm = 2 * np.sqrt(2 * np.log(2)) * float(abs(sigma))
    return middle, (mean - low) / (high - low), fwhm, sample.oct.lateral_resolution_mm


def attenuation(length_mm: float) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return depth in bone (mm), the mean level there (dB) and what Beer and Lambert and the roll-off say.

    Noise, which adds 1 to the intensity, is taken away; what lies beyond full depth folds back, in theory too.
    """
    sample = plain(wall_db=30.0, attenuation_mm=length_mm)
    level = rendered(sample, slices=6)
    first = int(np.ceil(wall_row(sample))) + 5
    rows = np.arange(first, level.shape[0] - 5)
    found = (10 ** (level[rows] / 10)).mean(axis=1) - 1
    n = 2 * level.shape[0]

    def expected(row: Coordinates) -> Coordinates:
        depth = (row - wall_row(sample)) * sample.oct.axial_pixel_mm / BONE_INDEX
        blur_db = (sample.oct.roll_off_db + 20 * np.log10(np.sinc(0.5))) * (2 * row / n) ** 2
        return np.asarray(30.0 + 20 * np.log10(np.sinc(row / n)) - blur_db - 10 * np.log10(np.e) * depth / length_mm)

    depth = (rows - wall_row(sample)) * sample.oct.axial_pixel_mm / BONE_INDEX
    theory = 10 * np.log10(10 ** (expected(rows) / 10) + 10 ** (expected(n - rows) / 10))
    use = theory > 8
    return depth[use], 10 * np.log10(np.maximum(found[use], 1e-3)), theory[use]
