"""The evidence in a B-scan for the wall's surface at every depth.

It is the power over that of the noise, summed behind a depth with weights that fall off as bone returns less and less:
to first order, the log-likelihood ratio of faint bone against noise alone. Summing over many samples brings out a wall
that no single sample shows and that speckle hides in every single A-scan.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.background import Background
from endoct.stitching.arrays import Image
from endoct.stitching.circle import pad_circle

LN_POWER_PER_SIGMA = 1.139  # ln of exponentially distributed power, as speckle and noise have, over its σ (from MAD)
MOST_POWER = 6.0  # times the power from which samples count as bone: a glint counts for no more
HAZE_SHARE = 0.2  # of the wall's contrast
MOST_LN_POWER = 20.0  # far beyond, and no overflow
LEAST_SIGMA_SHARE = 0.15  # of the wall's contrast: even where there is hardly any noise, there is texture
LOOK_MM2 = 6.4e-5  # of wall, about three samples: the area of one independent sample of noise and speckle
PATCH_MM = (0.05, 0.05)  # along θ and depth: averaged over that, noise is no longer as bright as bone
NEVER = -1e6


def surface_evidence(
    level: Image, first_row: NDArray[np.intp], background: Background, spacing: Spacing, parameters: OctParameters
) -> Image:
    """Return evidence for the surface at each row, and in the last column for none; float32 (n_columns, n_depth + 1).

    ``level``, float32 (n_columns, together, n_depth), is a logarithmic B-scan with its columns taken ``together``;
    ``spacing`` is that of single ones. A surface lies at ``first_row`` (n_columns,) or behind it. Rows that
    ``background`` calls hidden give no evidence: a surface under them is as likely as one right behind them.
    """
    hidden = background.hidden
    if not hidden.any() or hidden.all():
        return _evidence(level, first_row, background, spacing, parameters)
    visible = np.flatnonzero(~hidden)
    first_visible = np.searchsorted(visible, first_row)
    evidence = _evidence(level[:, :, visible], first_visible, background, spacing, parameters)
    # the last column of what is visible stands for none
    return np.asarray(evidence[:, np.searchsorted(visible, np.arange(hidden.size + 1))])


def _evidence(
    level: Image, first_row: NDArray[np.intp], background: Background, spacing: Spacing, parameters: OctParameters
) -> Image:
    n_columns, together, n_depth = level.shape
    allowed = np.arange(n_depth) >= first_row[:, None]
    signal = _signal(level, background, parameters.least_signal)
    signal = signal.sum(axis=1) if together > 1 else signal[:, 0]
    signal *= np.float32(spacing.depth_mm * spacing.column_mm / LOOK_MM2)
    signal[~allowed] = 0
    decay = np.float32(np.exp(-spacing.depth_mm / parameters.wall_decay_mm))
    evidence = np.zeros((n_columns, n_depth + 1), np.float32)
    behind = lfilter(np.ones(1, np.float32), np.array([1, -decay], np.float32), signal[:, ::-1], axis=1)
    evidence[:, :n_depth] = np.where(allowed, behind[:, ::-1], np.float32(NEVER))
    # a bright patch before the surface counts against it
    columns = max(1, round(PATCH_MM[0] / (spacing.column_mm * together))) | 1
    rows = max(1, round(PATCH_MM[1] / spacing.depth_mm))
    wide = pad_circle(signal, columns, axis=0)
    patch = cv2.blur(wide, (rows, columns), anchor=(rows - 1, -1), borderType=cv2.BORDER_REPLICATE)
    evidence[:, 1:] -= np.cumsum(np.maximum(patch[columns:-columns], 0), axis=1)
    return evidence


def relative_power(level: Image, noise: float, sigma: float) -> Image:
    """Return the power of logarithmic samples over the noise's median."""
    ln_power = (level - np.float32(noise)) * np.float32(LN_POWER_PER_SIGMA / sigma)
    return np.asarray(np.exp(np.minimum(ln_power, np.float32(MOST_LN_POWER))), dtype=np.float32)


def spread_of_noise(background: Background) -> float:
    """Return σ of the noise in samples of the recording, at least a share of the wall's contrast."""
    return max(background.noise_sigma, LEAST_SIGMA_SHARE * background.contrast)


def _signal(level: Image, background: Background, least_signal: float) -> Image:
    sigma = spread_of_noise(background)
    power = relative_power(level, background.noise, sigma)
    # the power from which on a sample counts as bone: above noise and, where bone is bright, above faint haze as well
    haze = float(np.exp(LN_POWER_PER_SIGMA * HAZE_SHARE * background.contrast / sigma))
    power *= np.float32(1 / max((1 + least_signal) * background.noise_power, haze))
    np.minimum(power, np.float32(MOST_POWER), out=power)
    power -= 1
    return power
