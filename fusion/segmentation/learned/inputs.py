"""What the learned eye looks at: the evidence of a side on even samples, and the way back to its own."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.evidence import Evidence, on_grid
from endoct.fusion.evidence.parallax import ParallaxRelief
from endoct.fusion.geometry.resample import column_weights, resample, row_weights

TRAINED_MM = 0.016
"""Samples lie so far apart in training."""
LOOKS_MM = (0.012, 0.01)
"""And so in use, where the eye looks twice: it then sees cells larger, and so the small ones too."""
FINEST_COLUMNS = 8
"""The number of columns is a multiple of this, as often as the network halves them."""
DARKEST, BRIGHTEST = 1.5, -0.75
DEEPEST_MM, NEAREST_MM = 0.6, -0.2
ERROR_MM = 0.1
"""A standard error of depth of this size halves the trust in it."""
CHANNELS = 4
MOST_OF_WALL = 0.1
"""What is darker may be a cell."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """``channels``, float32 (``CHANNELS``, n_z, n_theta): darkness, relief over ``DEEPEST_MM``, trust in that, valid.

    On rows at ``z_mm`` and columns from θ = 0, evenly spaced.
    """

    channels: NDArray[np.float32]
    z_mm: Coordinates


def inputs_of(darkness: Evidence, relief: ParallaxRelief | None, step_mm: float = TRAINED_MM) -> Inputs:
    """Return what the network is given of a side, of its ``darkness`` and ``relief`` on the same samples."""
    n_theta = FINEST_COLUMNS * max(1, round(2 * np.pi * darkness.radius_mm / step_mm / FINEST_COLUMNS))
    z_mm = np.arange(darkness.z_mm[0], darkness.z_mm[-1] + step_mm / 2, step_mm)
    even = on_grid(darkness, z_mm, n_theta)
    channels = np.zeros((CHANNELS, *even.values.shape), np.float32)
    channels[0] = np.where(even.valid, np.clip(even.values, BRIGHTEST, DARKEST), 0)
    channels[3] = even.valid
    if relief is not None:
        known = relief.known & darkness.valid

        def placed(image: Image) -> Evidence:
            values = np.where(known, image, np.float32(0))
            return on_grid(replace(darkness, values=values, valid=known), z_mm, n_theta)

        behind, error = placed(relief.relief_mm), placed(relief.error_mm)
        channels[1] = np.where(behind.valid, np.clip(behind.values, NEAREST_MM, DEEPEST_MM) / DEEPEST_MM, 0)
        channels[2] = np.where(behind.valid, ERROR_MM / (ERROR_MM + error.values), 0)
    return Inputs(channels, z_mm)


def grain(inputs: Inputs) -> float:
    """Return by how much the darkness of neighbouring samples on the wall differs, robust standard deviation."""
    darkness, valid = inputs.channels[0], inputs.channels[3] > 0
    wall = valid & (darkness < MOST_OF_WALL)
    both = wall[:, 1:] & wall[:, :-1]
    return robust_sigma(np.diff(darkness, axis=1)[both]) if both.any() else 0.0


def on_own_samples(probable: Image, inputs: Inputs, darkness: Evidence) -> Image:
    """Return what is known at the samples of ``inputs``, float32 (n_z, n_theta), at those of ``darkness``."""
    n_theta, n_own = probable.shape[1], darkness.values.shape[1]
    theta_rad = darkness.theta0_rad + 2 * np.pi / n_own * np.arange(n_own)
    step_mm = float(inputs.z_mm[1] - inputs.z_mm[0]) if inputs.z_mm.size > 1 else darkness.dz_mm
    rows = row_weights(inputs.z_mm, step_mm, darkness.z_mm, 0.0)
    columns = column_weights(n_theta, theta_rad * n_theta / (2 * np.pi), 0.0)
    whole: Mask = np.ones(probable.shape, np.bool_)
    return resample(probable, whole, rows, columns)[0]
