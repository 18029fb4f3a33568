"""The evidence in a B-scan for the wall's surface at every depth.

It is the power over that of the noise, summed behind a depth with weights that fall off as bone returns less and
less. To first order, that is the log-likelihood ratio of faint bone against noise alone. Summing over many samples
brings out a wall that no single sample shows and that speckle hides in every single A-scan.

:class:`Background` holds the levels of a recording: of noise, of the wall, and of the lines that the detector
draws.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters

HIDDEN_SHARE = 0.6  # of the wall's contrast: nothing is seen under a line as bright as that


@dataclass(frozen=True, eq=False)
class Background:
    """Levels of a recording, in its (logarithmic) samples.

    Attributes: ``noise`` and ``noise_sigma`` of the dark space between capillary and wall; ``wall``, the typical
    level just below the wall's surface; ``line_excess``, float32 (n_depth,), how far the detector's fixed lines stand
    out of the darkness, 0 where there are none; ``floor``, float32 (n_depth,), by how much noise is brighter at each
    depth than ``noise``; ``noise_power``, the mean power of noise over its median power, 1 / ln 2 unless it was
    processed. But for ``floor``, all refer to samples less ``floor``.
    """

    noise: float
    noise_sigma: float
    wall: float
    line_excess: Image
    floor: Image
    noise_power: float = 1 / math.log(2)

    @property
    def contrast(self) -> float:
        """How far the wall stands out of the noise, in samples of the recording; more than 0."""
        return max(self.wall - self.noise, 1e-6)

    @property
    def lines(self) -> Mask:
        """At which depths there is a fixed line, bool (n_depth,)."""
        return self.line_excess > 0

    @property
    def hidden(self) -> Mask:
        """At which depths a line is as bright as the wall, so that nothing is seen under it, bool (n_depth,)."""
        return np.asarray(self.line_excess > HIDDEN_SHARE * self.contrast)

    def from_row(self, first: int) -> "Background":
        """Return the background of B-scans cropped to depths from sample ``first`` on."""
        return replace(self, line_excess=self.line_excess[first:], floor=self.floor[first:])


LN_POWER_PER_SIGMA = 1.139  # ln of exponentially distributed power, as speckle and noise have, over its σ (from MAD)
MOST_POWER = 6.0  # times the power from which samples count as bone: a glint counts for no more
HAZE_SHARE = 0.2  # of the wall's contrast
MOST_LN_POWER = 20.0  # far beyond, and no overflow
LEAST_SIGMA_SHARE = 0.15  # of the wall's contrast: even where there is hardly any noise, there is texture
LOOK_MM2 = 6.4e-5  # of wall, about three samples: the area of one independent sample of noise and speckle
PATCH_MM = (0.05, 0.05)  # along θ and depth: averaged over that, noise is no longer as bright as bone
NEVER = np.float32(-1e6)
AT_ONCE = 8


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
    sigma = spread_of_noise(background)
    # the power from which on a sample counts as bone: above noise and, where bone is bright, above faint haze as well
    haze = float(np.exp(LN_POWER_PER_SIGMA * HAZE_SHARE * background.contrast / sigma))
    bone = max((1 + parameters.least_signal) * background.noise_power, haze)
    together = len(level) // first_row.size
    visible = np.flatnonzero(~background.hidden)
    if not visible.size:
        visible = np.arange(background.hidden.size)
    evidence = _evidence(
        relative_power(level, background.noise, sigma),
        start,
        visible,
        np.searchsorted(visible, first_row),
        np.float32(1 / bone),
        np.float32(spacing.depth_mm * spacing.column_mm / LOOK_MM2),
        np.float32(np.exp(-spacing.depth_mm / parameters.wall_decay_mm)),
        max(1, round(PATCH_MM[0] / (spacing.column_mm * together))) | 1,
        max(1, round(PATCH_MM[1] / spacing.depth_mm)),
    )
    if visible.size == background.hidden.size:
        return evidence
    # the last column of what is visible stands for none
    return np.take(evidence, np.searchsorted(visible, np.arange(background.hidden.size + 1)), axis=1)


@compiled
def _evidence(
    power: Image,
    start: int,
    visible: NDArray[np.intp],
    first_row: NDArray[np.intp],
    per_bone: np.float32,
    weight: np.float32,
    decay: np.float32,
    patch_columns: int,
    patch_rows: int,
) -> Image:
    """The evidence in the ``visible`` rows of ``power`` (n_theta, n_depth), of which ``first_row`` counts.

    What lies behind a row counts for it, a bright patch before it counts against it. :data:`AT_ONCE` columns are summed
    up along depth together, so that no sum has to wait for the one before it.
    """
    n_columns, n_rows = first_row.size, visible.size
    signal = np.empty((n_rows, AT_ONCE), np.float32)
    behind, sums = np.empty((n_rows, AT_ONCE), np.float32), np.empty((n_rows, AT_ONCE))
    evidence = np.empty((n_columns, n_rows + 1), np.float32)
    above = np.empty((n_columns, n_rows))
    for group in range(0, n_columns, AT_ONCE):
        for k in range(AT_ONCE):
            column = (group + k) % n_columns
            signal[: first_row[column], k] = 0
            ascan = _signal(power, start, column, n_columns, per_bone)
            for row in range(first_row[column], n_rows):
                signal[row, k] = ascan[visible[row]] * weight
        _sum_behind(signal, decay, behind)
        _sum_above(signal, patch_rows, sums)
        for k in range(AT_ONCE):
            column = (group + k) % n_columns
            evidence[column, : first_row[column]] = NEVER
            evidence[column, n_rows] = 0
            for row in range(first_row[column], n_rows):
                evidence[column, row] = behind[row, k]
            for row in range(n_rows):
                above[column, row] = sums[row, k]
    _take_patches(evidence, above, patch_columns, 1 / (patch_columns * patch_rows))
    return evidence


@compiled
def _signal(power: Image, start: int, column: int, n_columns: int, per_bone: np.float32) -> Image:
    """By how much each row outshines the least of bone, summed over the columns of the circle that are ``column``."""
    n_theta, n_depth = power.shape
    together = n_theta // n_columns
    most, one = np.float32(MOST_POWER), np.float32(1)
    signal = np.zeros(n_depth, np.float32)
    for k in range(together):
        ascan = power[(start + column * together + k) % n_theta]
        for row in range(n_depth):
            signal[row] += min(ascan[row] * per_bone, most) - one
    return signal


@compiled
def _sum_behind(signal: Image, decay: np.float32, behind: Image) -> None:
    """Write what lies at each row and behind it, weights falling off by ``decay``, both (row, :data:`AT_ONCE`)."""
    total = np.zeros(AT_ONCE, np.float32)
    for row in range(len(signal) - 1, -1, -1):
        for k in range(AT_ONCE):
            total[k] = signal[row, k] + decay * total[k]
            behind[row, k] = total[k]


@compiled
def _sum_above(signal: Image, n_rows: int, sums: Coordinates) -> None:
    """Write sums over so many rows that end at each row, both (row, :data:`AT_ONCE`); the first row is repeated."""
    total = np.empty(AT_ONCE)
    for k in range(AT_ONCE):
        total[k] = np.float64(signal[0, k]) * n_rows
    for row in range(len(signal)):
        old = max(row - n_rows, 0)
        for k in range(AT_ONCE):
            total[k] += np.float64(signal[row, k]) - np.float64(signal[old, k])
            sums[row, k] = total[k]


@compiled
def _take_patches(evidence: Image, above: Coordinates, n_columns: int, share: float) -> None:
    """Take from ``evidence`` what patches before each row hold: ``share`` of so many columns of ``above`` around it."""
    around, n_rows = above.shape
    reach = n_columns // 2
    patch = np.zeros(n_rows)
    for column in range(-reach, reach + 1):
        for row in range(n_rows):
            patch[row] += above[column % around, row]
    for column in range(around):
        before = np.float32(0)
        for row in range(n_rows):
            before += max(np.float32(patch[row] * share), np.float32(0))
            evidence[column, row + 1] -= before
        after, gone = above[(column + reach + 1) % around], above[(column - reach) % around]
        for row in range(n_rows):
            patch[row] = patch[row] + after[row] - gone[row]


def relative_power(level: Image, noise: float, sigma: float) -> Image:
    """Return the power of logarithmic samples over the noise's median."""
    power = np.subtract(level, np.float32(noise), dtype=np.float32)
    power *= np.float32(LN_POWER_PER_SIGMA / sigma)
    np.minimum(power, np.float32(MOST_LN_POWER), out=power)
    return np.exp(power, out=power)


def spread_of_noise(background: Background) -> float:
    """Return σ of the noise in samples of the recording, at least a share of the wall's contrast."""
    return max(background.noise_sigma, LEAST_SIGMA_SHARE * background.contrast)
