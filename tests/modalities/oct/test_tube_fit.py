"""A pullback's scales from marks that closed forms place on a tube, by a catheter off the axis, in noise."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from printed_tube import TUBE
from scipy import ndimage
from tolerances import TUBE_SCALE_REL

from endoct.base.arrays import Image
from endoct.modalities.oct.tube_fit import PITCH, SCALE, THETA, TubeModel, Z, half_rise_px
from endoct.modalities.oct.tube_marks import HELICAL, Beams, find_marks
from endoct.modalities.tube.locating import TubePose

FACE_MM, N_SLICES, N_BEAMS, DEPTH_MM = 0.85, 30, 600, 0.005
PIXEL, STEP = 1.02, 0.99
"""True over stated axial pixel, and pitch."""


def beams(rng: np.random.Generator, sense: int) -> Beams:
    """Beams from a catheter 0.15 mm off the axis, of which every A-scan's wall lies where the tube has it."""
    z_mm = 0.25 * np.arange(N_SLICES)
    beam = np.tile(2 * np.pi / N_BEAMS * np.arange(N_BEAMS), (N_SLICES, 1))
    x, y = np.full(N_SLICES, 0.15), np.full(N_SLICES, -0.02)
    reach = np.linspace(1.0, 2.4, 2801)
    gap = np.empty_like(beam)
    for k in range(N_SLICES):
        px = x[k] + (reach[:, None] - 0.15) * np.cos(beam[k])
        py = y[k] + (reach[:, None] - 0.15) * np.sin(beam[k])
        theta = 0.4 + sense * np.arctan2(py, px)
        wall = TUBE.radius_mm + TUBE.relief_mm(np.full_like(px, 1.9 + STEP * z_mm[k]), theta)
        first = np.argmax(np.hypot(px, py) > wall, axis=0)
        across = x[k] * np.sin(beam[k]) - y[k] * np.cos(beam[k])
        face = np.sqrt(FACE_MM**2 - across**2) - (x[k] * np.cos(beam[k]) + y[k] * np.sin(beam[k]))
        gap[k] = reach[first] - 0.15 - face
    gap += 0.004 * rng.standard_normal(gap.shape)
    good = rng.random(gap.shape) < 0.9
    zero, unseen = np.zeros(N_SLICES), np.zeros((N_SLICES, N_BEAMS, 0), np.float32)
    return Beams(
        beam, gap / PIXEL, good, zero, x / PIXEL, y / PIXEL, z_mm, np.zeros_like(beam), FACE_MM, unseen, DEPTH_MM
    )


@pytest.mark.parametrize("sense", [1, -1])
def test_scales_come_back(sense: int) -> None:
    recorded = beams(np.random.default_rng(sense + 5), sense)
    pose = TubePose(1.93, 1.0, 1, 0.42, sense, 0.9)
    for _ in range(2):
        model = TubeModel(recorded, find_marks(recorded, pose, TUBE), TUBE, pose)
        fit = model.fit(capillary_sigma_mm=0.0005)
        pose = replace(
            pose, z_mm=float(fit.values[Z]), scale=float(fit.values[PITCH]), theta_rad=float(fit.values[THETA])
        )
    sigma = np.sqrt(np.diag(fit.covariance))
    assert np.count_nonzero(model.marks.line == HELICAL) > 15
    assert math.exp(fit.values[SCALE]) == pytest.approx(PIXEL, rel=max(TUBE_SCALE_REL, 2 * sigma[SCALE]))
    assert sigma[SCALE] < 0.012
    assert fit.values[PITCH] == pytest.approx(STEP, rel=TUBE_SCALE_REL)
    assert np.angle(np.exp(1j * (fit.values[THETA] - 0.4))) == pytest.approx(0, abs=0.004)


def test_noise_alone_does_not_shrink_the_scale() -> None:
    """Depths err, and a smaller scale would make these errors smaller: residuals are in stated mm.

    One draw of 20 µm moves the scale by 0.4 % either way; the mean of three hardly.
    """
    pose, shrunk = TubePose(1.9, STEP, 1, 0.4, 1, 0.9), []
    for seed in range(3):
        quiet = beams(np.random.default_rng(8 + 10 * seed), 1)
        noise = 0.02 * np.random.default_rng(9 + seed).standard_normal(quiet.gap_mm.shape)
        scale, noisy = (
            TubeModel(each, find_marks(each, pose, TUBE), TUBE, pose).fit(capillary_sigma_mm=0.0005).values[SCALE]
            for each in (quiet, replace(quiet, gap_mm=quiet.gap_mm + noise))
        )
        shrunk.append(noisy - scale)
    assert np.mean(shrunk) == pytest.approx(0, abs=TUBE_SCALE_REL)


STEP_MM, HALF, N_POWERS = 0.005, 24, 2000
COHERENCE_PX = 1.1


def powers(signal_db: float, skin: float, off_px: NDArray[np.float64], rng: np.random.Generator) -> Image:
    """Power of A-scans whose middle sample lies ``off_px`` behind a wall, ``skin`` brighter at its surface."""
    place = off_px[:, None] + np.arange(-HALF - 8, HALF + 9)
    behind_mm = np.maximum(place, 0) * STEP_MM
    power = (place > 0) * (1 + skin * np.exp(-((behind_mm / 0.012) ** 2))) * np.exp(-6 * behind_mm)
    taps = np.exp(-0.5 * (np.arange(-4, 5) / COHERENCE_PX) ** 2)
    parts = np.sqrt(power) * rng.standard_normal((2, *power.shape))
    field = ndimage.convolve1d(parts, taps / np.sqrt((taps**2).sum()), axis=2)
    field = 10 ** (signal_db / 20) * field + rng.standard_normal(field.shape)
    return np.asarray((field**2).sum(axis=0)[:, 8:-8] / 2, np.float32)


@pytest.mark.parametrize("signal_db", [6.0, 25.0])
@pytest.mark.parametrize("skin", [0.0, 2.5])
def test_surface_lies_at_half_of_the_rise(signal_db: float, skin: float) -> None:
    rng = np.random.default_rng(3)
    off_px = rng.uniform(-2, 2, N_POWERS)
    power = powers(signal_db, skin, off_px, rng)
    power[::200] *= 1000  # glints
    assert half_rise_px(power, off_px, STEP_MM) == pytest.approx(0, abs=0.35)


def test_no_surface_where_there_is_only_noise() -> None:
    rng = np.random.default_rng(4)
    off_px = rng.uniform(-2, 2, N_POWERS)
    assert np.isnan(half_rise_px(powers(-30, 0, off_px, rng), off_px, STEP_MM))
