"""Lines at one depth in every A-scan, which the detector draws and not the specimen; and B-scans without them."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import label, percentile_filter, uniform_filter1d

from endoct.modalities.oct.calibration import Background
from endoct.modalities.oct.face.lines import Points
from endoct.stitching.arrays import Image, Mask

LINE_SIGMAS = 1.0
SKIRT_SIGMAS = 0.12
LINE_WIDTH_MM = 0.15
LINE_BACKGROUND_MM = 0.35
LINE_BEYOND_MM = (0.07, 0.13)  # behind a line and its echo, nearer than the end of what bone there returns
DARK_SHARE = 0.2
HIDDEN_SHARE = 0.6
LINE_BESIDE_MM = (0.05, 0.12)
JUDGED_ASCANS = 512


def fixed_line_excess(ascans: Image, mm_per_px: float) -> Image:
    """How far a depth row stands out everywhere at once: the detector's fixed lines with their skirts, else 0.

    Judged where the row is dark, that is where it is dark a little deeper: bone interferes with a line and so can
    make it fainter as well as brighter.
    """
    near, far = (max(1, round(reach / mm_per_px)) for reach in LINE_BEYOND_MM)
    deeper = np.pad(uniform_filter1d(ascans, far - near, axis=1), ((0, 0), (0, far)), mode="edge")[:, far:]
    dark = deeper <= np.quantile(deeper, DARK_SHARE, axis=0)
    level = np.nanmedian(np.where(dark, ascans, np.nan), axis=0)
    excess = level - percentile_filter(level, 25, round(LINE_BACKGROUND_MM / mm_per_px) | 1, mode="nearest")
    sigma = max(1.4826 * float(np.median(np.abs(ascans - np.median(ascans, axis=0)))), 1e-6)
    return _lines_with_skirts(excess, sigma, mm_per_px)


def with_lines_of(level: Image, background: Background, mm_per_px: float) -> Background:
    """Return ``background`` with the lines that one logarithmic B-scan (θ, depth) alone holds among its own.

    A spectrometer's mean over a turn is taken off every A-scan. A face that is bright while it hardly changes its
    depth stands in that mean, and so, faintly, in every A-scan of the turn. Such a line is seen in the darkest A-scans
    too, and neither before nor behind it is it as bright; of what stands at its own depth in every A-scan, this holds
    for nothing.
    """
    some = without_lines(level[:: max(1, len(level) // JUDGED_ASCANS)], background)
    dark = np.quantile(np.ascontiguousarray(some.T), DARK_SHARE, axis=1)  # a third faster than along the columns
    near, far = (round(reach / mm_per_px) for reach in LINE_BESIDE_MM)
    padded = np.pad(uniform_filter1d(dark, far - near, mode="nearest"), far, mode="edge")
    middle = (near + far) // 2
    beside = np.maximum(padded[far - middle :][: dark.size], padded[far + middle :][: dark.size])
    excess = _lines_with_skirts(dark - beside, max(background.noise_sigma, 1e-6), mm_per_px)
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


def hidden_rows(background: Background) -> Mask:
    """Return at which depths, bool (depth,), a line is as bright as the wall, so that nothing is seen under it."""
    return np.asarray(background.line_excess > HIDDEN_SHARE * max(background.wall - background.noise, 1e-6))


def without_lines(level: Image, background: Background) -> Image:
    """Return a logarithmic B-scan (θ, depth) without the detector's fixed lines.

    Where a line is fainter than the wall, the span between line and wall is stretched to that between noise and
    wall. Where it is not, it hides what lies under it, and the rows are interpolated from those beside.
    """
    excess = background.line_excess
    if not excess.any():
        return level
    contrast = max(background.wall - background.noise, 1e-6)
    hidden = hidden_rows(background)
    gain = contrast / (contrast - np.where(hidden, 0, excess))
    shown = np.flatnonzero((excess > 0) & ~hidden)
    cleaned = level.copy()
    darkness = np.float32(background.noise)
    cleaned[:, shown] = darkness + (level[:, shown] - darkness - excess[shown]) * gain[shown].astype(np.float32)
    return bridge_rows(cleaned, hidden)


def bridge_rows(image: Image, hidden: Mask) -> Image:
    """Return ``image`` (θ, depth) with the rows ``hidden``, bool (depth,), interpolated from the rows beside them."""
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


def points_off(fixed_line: Mask, points: Points, mm_per_px: float) -> Points:
    """Return ``points`` without those in rows of ``fixed_line``, bool (n_depth,).

    Where a face crosses such a line, the line's points pass for a face seen by a turn gone very uneven.
    """
    row = np.clip(np.round(points.depth_mm / mm_per_px), 0, fixed_line.size - 1).astype(np.intp)
    kept = ~fixed_line[row]
    return Points(points.angle_rad[kept], points.depth_mm[kept], points.strength[kept])
