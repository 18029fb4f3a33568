"""B-scans of a wall in noise and speckle."""

import numpy as np

from endoct.base.arrays import Image
from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.surface.background import Background

N_THETA, N_DEPTH, PIXEL_MM, COLUMN_MM = 600, 200, 0.005, 0.013
SPACING = Spacing(PIXEL_MM, COLUMN_MM)
NO_LINE = np.zeros(N_DEPTH, np.float32)
BACKGROUND = Background(noise=50.0, noise_sigma=15.0, wall=110.0, line_excess=NO_LINE, floor=NO_LINE, noise_power=1.91)
SPECKLE = Background(noise=-1.59, noise_sigma=4.95, wall=10.0, line_excess=NO_LINE, floor=NO_LINE)
FIRST_ROW = np.full(N_THETA, 20)


def bscan(wall: np.ndarray, level: float = 110.0, seed: int = 0) -> Image:
    rng = np.random.default_rng(seed)
    behind = np.arange(N_DEPTH) - wall[:, None]
    mean = np.where(behind >= 0, np.maximum(level - 0.5 * behind, 50), 50)
    return (mean + rng.normal(0, 15, mean.shape)).astype(np.float32)


def speckled(power_behind: np.ndarray, wall: np.ndarray, seed: int = 0) -> Image:
    """Noise of mean power 1, and bone of ``power_behind`` (n_theta,) more behind ``wall``; dB."""
    rng = np.random.default_rng(seed)
    mean = 1 + np.where(np.arange(N_DEPTH) >= wall[:, None], power_behind[:, None], 0)
    return (10 * np.log10(rng.exponential(mean))).astype(np.float32)
