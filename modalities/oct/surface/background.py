"""The background of a recording, and B-scans without it: the noise, and the lines that the detector draws.

Each B-scan is rid of them in one pass over its samples.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, maximum_filter1d, uniform_filter1d

from endoct.base.arrays import Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric import ranks
from endoct.modalities.oct.face.face_circle import Circle

HIDDEN_SHARE = 0.6
"""Nothing is seen under a line with this share of the wall's contrast."""
LN_POWER_PER_SIGMA = 1.139
"""Logarithm (ln) of exponentially distributed power, as speckle and noise have, over its σ (from MAD)."""
MOST_LN_POWER = 20.0
"""Powers are cut off here, far beyond any that occur, so that none overflows."""
LEAST_SIGMA_SHARE = 0.15
"""Even where there is hardly any noise, texture scatters by this share of the wall's contrast."""
LINE_SIGMAS = 1.0
"""A line stands out by more than this σ of the noise."""
SKIRT_SIGMAS = 0.12
"""The skirts of a line stand out by more than this σ of the noise."""
LINE_WIDTH_MM = 0.15
"""A line is no wider than that, its skirts included."""
DARK_SHARE = 0.2
"""A depth is judged by this part of its A-scans, the darkest."""
LINE_AROUND_MM = (0.05, 0.12)
"""A line of one B-scan is compared with what lies so far before and behind it."""
JUDGED_ASCANS = 512
"""It is judged by at least so many of its A-scans, where it has as many."""
TURNING_MM = 0.04
"""It lies so near to where a face is nearest or farthest."""


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


def relative_power(level: Image, noise: float, sigma: float) -> Image:
    """Return the power of logarithmic samples over the noise's median."""
    power = np.subtract(level, np.float32(noise), dtype=np.float32)
    power *= np.float32(LN_POWER_PER_SIGMA / sigma)
    np.minimum(power, np.float32(MOST_LN_POWER), out=power)
    return np.exp(power, out=power)


def spread_of_noise(background: Background) -> float:
    """Return σ of the noise in samples of the recording, at least a share of the wall's contrast."""
    return max(background.noise_sigma, LEAST_SIGMA_SHARE * background.contrast)


def bridge_rows(image: Image, hidden: Mask) -> Image:
    """Return ``image`` (θ, depth) with the rows ``hidden``, bool (depth,), interpolated from their neighbours.

    As it is where none of them is hidden, or all are.
    """
    seen, row = np.flatnonzero(~hidden), np.flatnonzero(hidden)
    if not (seen.size and row.size):
        return image
    after = np.searchsorted(seen, row)
    low, high = seen[np.maximum(after - 1, 0)], seen[np.minimum(after, seen.size - 1)]
    share = np.where(low == high, 0.5, (row - low) / np.maximum(high - low, 1))
    filled = image.copy()
    filled[:, row] = (1 - share) * image[:, low] + share * image[:, high]
    return filled


def without_lines(samples: NDArray[Any], background: Background) -> Image:
    """Return a logarithmic B-scan (θ, depth) as if noise were equally bright at all depths, without fixed lines.

    Where a line is fainter than the wall, the span between line and wall is stretched to that between noise and
    wall. Where it is not, it hides what lies under it, and its rows are interpolated from their neighbours. The levels
    are float32.
    """
    excess = background.line_excess
    contrast, hidden = background.contrast, background.hidden
    gain = contrast / (contrast - np.where(hidden, 0, excess))
    faint = np.flatnonzero(background.lines & ~hidden)
    levels = np.empty(samples.shape, np.float32)
    _level(samples, background.floor, faint, np.float32(background.noise), excess, gain.astype(np.float32), levels)
    return bridge_rows(levels, hidden)


@compiled
def _level(
    samples: NDArray[Any],
    floor: Image,
    rows: NDArray[np.intp],
    darkness: np.float32,
    excess: Image,
    gain: Image,
    levels: Image,
) -> None:
    """Write ``samples`` less ``floor`` to ``levels``; in ``rows``, what exceeds ``darkness`` times ``gain``."""
    for column in range(len(samples)):
        own = levels[column]
        for row in range(floor.size):
            own[row] = np.float32(samples[column, row]) - floor[row]
        for row in rows:
            own[row] = darkness + (own[row] - darkness - excess[row]) * gain[row]


def with_lines_of(
    samples: NDArray[Any], background: Background, face: Circle, glass_path_mm: float, mm_per_px: float
) -> Background:
    """Return ``background`` with the lines added that only this one B-scan, logarithmic (θ, depth), holds.

    A spectrometer's mean over a turn is subtracted from every A-scan. The capillary's faces are part of that mean where
    they hardly change their depth: where they are nearest and farthest. So they appear there, faintly, in every A-scan
    of the turn. They are the outer ``face``, and the inner one ``glass_path_mm`` before it, 0 where that is not seen.
    Such a line shows in the darkest A-scans too, and is brighter than what lies before and behind it.
    """
    some = without_lines(samples[:: max(1, len(samples) // JUDGED_ASCANS)], background)
    near, far = (round(reach / mm_per_px) for reach in LINE_AROUND_MM)
    turning = _turning_points(face, glass_path_mm, samples.shape[1], mm_per_px)
    rows = np.flatnonzero(maximum_filter1d(turning, 4 * far + 1))  # these, and what they are compared with
    dark = np.zeros(turning.size, np.float32)
    dark[rows] = ranks.quantiles(some[:, rows], DARK_SHARE)
    padded = np.pad(uniform_filter1d(dark, far - near, mode="nearest"), far, mode="edge")
    middle = (near + far) // 2
    around = np.maximum(padded[far - middle :][: dark.size], padded[far + middle :][: dark.size])
    excess = np.where(turning, dark - around, 0)
    excess = lines_with_skirts(excess, max(background.noise_sigma, 1e-6), mm_per_px)
    return replace(background, line_excess=np.maximum(background.line_excess, excess)) if excess.any() else background


def _turning_points(face: Circle, glass_path_mm: float, n_depth: int, mm_per_px: float) -> Mask:
    """Which depths lie near the nearest or the farthest one of either face, bool (n_depth,)."""
    depth_mm = np.arange(n_depth) * mm_per_px
    outer = face.axis_depth_mm + face.radius_mm + face.offset_mm * np.array([-1, 1])
    ends = np.concatenate([outer, outer - glass_path_mm])
    return np.asarray(np.abs(depth_mm[:, None] - ends).min(axis=1) < TURNING_MM)


def lines_with_skirts(excess: Image, sigma: float, mm_per_px: float) -> Image:
    """Return ``excess`` (n_depth,) where it is that of a line or of its skirts, of noise ``sigma``; 0 elsewhere."""
    core = excess > LINE_SIGMAS * sigma
    line = core.copy()
    skirts, count = label(excess > SKIRT_SIGMAS * sigma)
    for k in range(1, count + 1):
        rows = skirts == k
        if core[rows].any() and np.count_nonzero(rows) <= LINE_WIDTH_MM / mm_per_px:
            line |= rows
    return np.where(line, np.maximum(excess, 0), 0).astype(np.float32)
