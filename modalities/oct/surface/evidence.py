"""The evidence in a B-scan for the wall's surface at every depth.

It is the power over that of the noise, summed behind a depth with weights that fall off as bone returns less and less:
to first order, the log-likelihood ratio of faint bone against noise alone. Summing over many samples brings out a wall
that no single sample shows and that speckle hides in every single A-scan.
"""

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.background import Background
from endoct.stitching.arrays import Image
from endoct.stitching.compiled import compiled

LN_POWER_PER_SIGMA = 1.139  # ln of exponentially distributed power, as speckle and noise have, over its σ (from MAD)
MOST_POWER = 6.0  # times the power from which samples count as bone: a glint counts for no more
HAZE_SHARE = 0.2  # of the wall's contrast
MOST_LN_POWER = 20.0  # far beyond, and no overflow
LEAST_SIGMA_SHARE = 0.15  # of the wall's contrast: even where there is hardly any noise, there is texture
LOOK_MM2 = 6.4e-5  # of wall, about three samples: the area of one independent sample of noise and speckle
PATCH_MM = (0.05, 0.05)  # along θ and depth: averaged over that, noise is no longer as bright as bone
NEVER = np.float32(-1e6)


def surface_evidence(
    level: Image,
    start: int,
    first_row: NDArray[np.intp],
    background: Background,
    spacing: Spacing,
    parameters: OctParameters,
) -> Image:
    """Return evidence for the surface at each row, and in the last column for none; float32 (n_columns, n_depth + 1).

    ``level``, float32 (n_theta, n_depth), is a logarithmic B-scan of which so many of the circle's columns are taken
    together, from column ``start`` on, that n_columns are left; ``spacing`` is that of single ones. A surface lies at
    ``first_row`` (n_columns,) or behind it. Rows that ``background`` calls hidden give no evidence: a surface under
    them is as likely as one right behind them.
    """
    hidden = background.hidden
    if not hidden.any() or hidden.all():
        return _evidence(level, start, first_row, background, spacing, parameters)
    visible = np.flatnonzero(~hidden)
    first_visible = np.searchsorted(visible, first_row)
    evidence = _evidence(np.take(level, visible, axis=1), start, first_visible, background, spacing, parameters)
    # the last column of what is visible stands for none
    return np.take(evidence, np.searchsorted(visible, np.arange(hidden.size + 1)), axis=1)


def _evidence(
    level: Image,
    start: int,
    first_row: NDArray[np.intp],
    background: Background,
    spacing: Spacing,
    parameters: OctParameters,
) -> Image:
    together = len(level) // first_row.size
    signal = _signal(level, background, parameters.least_signal)
    weight = np.float32(spacing.depth_mm * spacing.column_mm / LOOK_MM2)
    decay = np.float32(np.exp(-spacing.depth_mm / parameters.wall_decay_mm))
    columns = max(1, round(PATCH_MM[0] / (spacing.column_mm * together))) | 1
    rows = max(1, round(PATCH_MM[1] / spacing.depth_mm))
    return _gathered(signal, start, first_row, weight, decay, columns, rows)


@compiled
def _gathered(
    signal: Image,
    start: int,
    first_row: NDArray[np.intp],
    weight: np.float32,
    decay: np.float32,
    patch_columns: int,
    patch_rows: int,
) -> Image:
    """The evidence of ``signal`` (n_theta, n_depth): what lies behind a row counts for it, a bright patch before it
    counts against it.
    """
    n_theta, n_depth = signal.shape
    n_columns = first_row.size
    together = n_theta // n_columns
    taken = np.zeros((n_columns, n_depth), np.float32)
    above = np.empty((n_columns, n_depth))  # sums over the rows of a patch that ends at each row
    evidence = np.empty((n_columns, n_depth + 1), np.float32)
    for column in range(n_columns):
        own = taken[column]
        first = min(first_row[column], n_depth)
        for k in range(together):
            other = signal[(start + column * together + k) % n_theta]
            for row in range(first, n_depth):
                own[row] += other[row]
        behind = np.float32(0)
        evidence[column, n_depth] = 0
        for row in range(n_depth - 1, first - 1, -1):
            own[row] *= weight
            behind = own[row] + decay * behind
            evidence[column, row] = behind
        evidence[column, :first] = NEVER
        total = np.float64(own[0]) * patch_rows
        for row in range(n_depth):
            total += np.float64(own[row]) - np.float64(own[max(row - patch_rows, 0)])
            above[column, row] = total
    reach = patch_columns // 2
    patch = np.zeros(n_depth)
    for column in range(-reach, reach + 1):
        patch += above[column % n_columns]
    share = 1 / (patch_columns * patch_rows)
    for column in range(n_columns):
        before = np.float32(0)
        for row in range(n_depth):
            before += max(np.float32(patch[row] * share), np.float32(0))
            evidence[column, row + 1] -= before
        patch += above[(column + reach + 1) % n_columns]
        patch -= above[(column - reach) % n_columns]
    return evidence


def relative_power(level: Image, noise: float, sigma: float) -> Image:
    """Return the power of logarithmic samples over the noise's median."""
    power = np.subtract(level, np.float32(noise), dtype=np.float32)
    power *= np.float32(LN_POWER_PER_SIGMA / sigma)
    np.minimum(power, np.float32(MOST_LN_POWER), out=power)
    return np.exp(power, out=power)


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
