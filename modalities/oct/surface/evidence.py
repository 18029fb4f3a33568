"""How strongly a B-scan speaks for the wall's surface at every depth.

Power over that of the noise, summed behind a depth with the weight that falls as bone returns less and less: the
log-likelihood ratio, to first order, of faint bone against noise alone. A wall that no single sample shows, and
speckle hides in every A-scan, so comes out of the sum of many.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from endoct.modalities.oct.calibration import Background
from endoct.modalities.oct.parameters import OctParameters
from endoct.stitching.arrays import Image, Mask

LN_POWER_PER_SIGMA = 1.139  # ln of exponentially distributed power, as speckle and noise have, over its σ (from MAD)
MOST_POWER = 6.0  # times that from which samples speak for bone: a glint says no more than this
HAZE_SHARE = 0.2  # of the wall's contrast
MOST_LN_POWER = 20.0  # far beyond, and no overflow
LEAST_SIGMA_SHARE = 0.15  # of the wall's contrast: where the noise is all but nil, texture is not
LOOK_MM2 = 6.4e-5  # of wall, about three samples: how much gives one independent sample of noise and speckle
PATCH_MM = (0.05, 0.05)  # along θ and depth: over this much, noise is no longer as bright as bone
NEVER = -1e6


def surface_evidence(
    level: Image,
    first_row: NDArray[np.intp],
    background: Background,
    hidden: Mask,
    mm_per_px: float,
    mm_per_column: float,
    parameters: OctParameters,
    together: int,
) -> Image:
    """Return evidence for the surface at each row, and in the last column for none.

    float32 (n_theta / together, n_depth + 1), of a logarithmic B-scan ``level`` (n_theta, depth), ``together``
    columns at a time, from ``first_row`` (n_theta / together,) on. Rows that are ``hidden``, bool (depth,), speak for
    nothing: a surface under them is as likely as one right behind them.
    """
    if hidden.any() and not hidden.all():
        seen = np.flatnonzero(~hidden)
        shown_first = np.searchsorted(seen, first_row)
        nothing = np.zeros_like(hidden, shape=seen.size)
        of_seen = surface_evidence(
            level[:, seen], shown_first, background, nothing, mm_per_px, mm_per_column, parameters, together
        )
        # the last of the seen stands for none
        return np.asarray(of_seen[:, np.searchsorted(seen, np.arange(hidden.size + 1))])
    n_columns, n_depth = level.shape[0] // together, level.shape[1]
    allowed = np.arange(n_depth) >= first_row[:, None]
    signal = _signal(level, background, parameters.least_signal)
    if together > 1:
        signal = signal.reshape(n_columns, together, n_depth).sum(axis=1)
    signal *= np.float32(mm_per_px * mm_per_column / LOOK_MM2)
    signal[~allowed] = 0
    decay = np.float32(np.exp(-mm_per_px / parameters.wall_decay_mm))
    evidence = np.zeros((n_columns, n_depth + 1), np.float32)
    behind = lfilter(np.ones(1, np.float32), np.array([1, -decay], np.float32), signal[:, ::-1], axis=1)
    evidence[:, :n_depth] = np.where(allowed, behind[:, ::-1], np.float32(NEVER))
    # what is bright over a patch before the surface speaks against it
    columns = max(1, round(PATCH_MM[0] / (mm_per_column * together))) | 1
    rows = max(1, round(PATCH_MM[1] / mm_per_px))
    wide = np.concatenate([signal[-columns:], signal, signal[:columns]])
    patch = cv2.blur(wide, (rows, columns), anchor=(rows - 1, -1), borderType=cv2.BORDER_REPLICATE)
    evidence[:, 1:] -= np.cumsum(np.maximum(patch[columns:-columns], 0), axis=1)
    return evidence


def relative_power(level: Image, noise: float, sigma: float) -> Image:
    """Return the power of logarithmic samples over the noise's median."""
    ln_power = (level - np.float32(noise)) * np.float32(LN_POWER_PER_SIGMA / sigma)
    return np.asarray(np.exp(np.minimum(ln_power, np.float32(MOST_LN_POWER))), dtype=np.float32)


def spread_of_noise(background: Background) -> float:
    """Return σ of the noise in samples of the recording, at least a share of the wall's contrast."""
    return max(background.noise_sigma, LEAST_SIGMA_SHARE * _contrast(background))


def _contrast(background: Background) -> float:
    return max(background.wall - background.noise, 1e-6)


def _signal(level: Image, background: Background, least_signal: float) -> Image:
    contrast, sigma = _contrast(background), spread_of_noise(background)
    power = relative_power(level, background.noise, sigma)
    # from what power on a sample speaks for bone: over the noise; and where bone is bright, over faint haze as well
    haze = float(np.exp(LN_POWER_PER_SIGMA * HAZE_SHARE * contrast / sigma))
    power *= np.float32(1 / max((1 + least_signal) * background.noise_power, haze))
    np.minimum(power, np.float32(MOST_POWER), out=power)
    power -= 1
    return power
