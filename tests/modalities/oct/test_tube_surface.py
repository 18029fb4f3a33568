"""The surface of a wall in speckle, by the mean of many A-scans: however bright it is, and whatever lies on it."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from endoct.base.arrays import Image
from endoct.modalities.oct.tube_surface import half_rise_px

DEPTH_MM, HALF, N_BEAMS = 0.005, 24, 2000
COHERENCE_PX = 1.1


def beams(signal_db: float, skin: float, off_px: NDArray[np.float64], rng: np.random.Generator) -> Image:
    """Power of A-scans whose middle sample lies ``off_px`` behind a wall, ``skin`` brighter at its surface."""
    place = off_px[:, None] + np.arange(-HALF - 8, HALF + 9)
    behind_mm = np.maximum(place, 0) * DEPTH_MM
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
    off_px = rng.uniform(-2, 2, N_BEAMS)
    power = beams(signal_db, skin, off_px, rng)
    power[::200] *= 1000  # glints
    assert half_rise_px(power, off_px, DEPTH_MM) == pytest.approx(0, abs=0.35)


def test_no_surface_where_there_is_only_noise() -> None:
    rng = np.random.default_rng(4)
    off_px = rng.uniform(-2, 2, N_BEAMS)
    assert np.isnan(half_rise_px(beams(-30, 0, off_px, rng), off_px, DEPTH_MM))
