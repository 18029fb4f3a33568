"""Lines at one depth in every A-scan, which come from the detector and not from the specimen; B-scans without them."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import label, percentile_filter, uniform_filter1d

from endoct.modalities.oct.surface.background import Background
from endoct.stitching.arrays import Image, Mask
from endoct.stitching.robust import robust_sigma

LINE_SIGMAS = 1.0
SKIRT_SIGMAS = 0.12
LINE_WIDTH_MM = 0.15
LINE_BACKGROUND_MM = 0.35
LINE_BEYOND_MM = (0.07, 0.13)  # behind a line and its echo, but before the signal of bone there ends
DARK_SHARE = 0.2
LINE_AROUND_MM = (0.05, 0.12)
JUDGED_ASCANS = 512


def fixed_line_excess(ascans: Image, mm_per_px: float) -> Image:
    """Return how far each depth of ``ascans`` (n, depth) stands out in all of them at once, float32 (depth,).

    That is the detector's fixed lines with their skirts; elsewhere it is 0. A depth is judged in A-scans that are dark
    a little deeper, since bone interferes with a line and so can make it fainter as well as brighter.
    """
    near, far = (max(1, round(reach / mm_per_px)) for reach in LINE_BEYOND_MM)
    deeper = np.pad(uniform_filter1d(ascans, far - near, axis=1), ((0, 0), (0, far)), mode="edge")[:, far:]
    dark = deeper <= np.quantile(deeper, DARK_SHARE, axis=0)
    level = np.nanmedian(np.where(dark, ascans, np.nan), axis=0)
    excess = level - percentile_filter(level, 25, round(LINE_BACKGROUND_MM / mm_per_px) | 1, mode="nearest")
    sigma = max(robust_sigma(ascans - np.median(ascans, axis=0)), 1e-6)
    return _lines_with_skirts(excess, sigma, mm_per_px)


def with_lines_of(level: Image, background: Background, mm_per_px: float) -> Background:
    """Return ``background`` with the lines added that only this one logarithmic B-scan (θ, depth) holds.

    A spectrometer's mean over a turn is subtracted from every A-scan. A bright face that hardly changes its depth is
    part of that mean, and so appears, faintly, in every A-scan of the turn. Unlike a surface that happens to lie at one
    depth all around, such a line shows in the darkest A-scans too, and is brighter than what lies before and behind it.
    """
    some = without_lines(level[:: max(1, len(level) // JUDGED_ASCANS)], background)
    dark = np.quantile(np.ascontiguousarray(some.T), DARK_SHARE, axis=1)  # a third faster than along the columns
    near, far = (round(reach / mm_per_px) for reach in LINE_AROUND_MM)
    padded = np.pad(uniform_filter1d(dark, far - near, mode="nearest"), far, mode="edge")
    middle = (near + far) // 2
    around = np.maximum(padded[far - middle :][: dark.size], padded[far + middle :][: dark.size])
    excess = _lines_with_skirts(dark - around, max(background.noise_sigma, 1e-6), mm_per_px)
    return replace(background, line_excess=np.maximum(background.line_excess, excess)) if excess.any() else background


def _lines_with_skirts(excess: Image, sigma: float, mm_per_px: float) -> Image:
    core = excess > LINE_SIGMAS * sigma
    line = core.copy()
    skirts, count = label(excess > SKIRT_SIGMAS * sigma)
    for k in range(1, count + 1):
        rows = skirts == k
        if core[rows].any() and np.count_nonzero(rows) <= LINE_WIDTH_MM / mm_per_px:
            line |= rows
    return np.where(line, np.maximum(excess, 0), 0).astype(np.float32)


def without_lines(level: Image, background: Background) -> Image:
    """Return a logarithmic B-scan (θ, depth) without the detector's fixed lines.

    Where a line is fainter than the wall, the span between line and wall is stretched to that between noise and
    wall. Where it is not, it hides what lies under it, and its rows are interpolated from their neighbours.
    """
    excess = background.line_excess
    if not excess.any():
        return level
    contrast, hidden = background.contrast, background.hidden
    gain = contrast / (contrast - np.where(hidden, 0, excess))
    faint = np.flatnonzero(background.lines & ~hidden)
    cleaned = level.copy()
    darkness = np.float32(background.noise)
    cleaned[:, faint] = darkness + (level[:, faint] - darkness - excess[faint]) * gain[faint].astype(np.float32)
    return bridge_rows(cleaned, hidden)


def bridge_rows(image: Image, hidden: Mask) -> Image:
    """Return ``image`` (θ, depth) with the rows ``hidden``, bool (depth,), interpolated from their neighbours."""
    good = np.flatnonzero(~hidden)
    if good.size in (0, hidden.size):
        return image
    filled = image.copy()
    for row in np.flatnonzero(hidden):
        after = int(np.searchsorted(good, row))
        low, high = good[max(0, after - 1)], good[min(after, good.size - 1)]
        share = 0.5 if low == high else (row - low) / (high - low)
        filled[:, row] = (1 - share) * image[:, low] + share * image[:, high]
    return filled
