"""Where the bore wall lies in one B-scan."""

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.calibration import Background
from endoct.modalities.oct.parameters import OctParameters
from endoct.stitching.arrays import Image, Mask

Rows = NDArray[np.intp]

SPECKLE_MM2 = 0.025 * 0.008  # lateral times axial resolution: how much wall gives one independent sample
MOST_SIGMAS = 3.0
BRIGHT_MM = (0.025, 0.03)  # along θ and depth
LEAST_SIGMA_SHARE = 0.15  # of the wall's contrast: where the noise is all but nil, texture is not
LEAST_THRESHOLD_SHARE = 0.2
HIDDEN_SHARE = 0.6


def without_lines(level: Image, background: Background) -> Image:
    """Return a logarithmic B-scan (θ, depth) without the detector's fixed lines.

    Where a line is fainter than the wall, the span between line and wall is stretched to that between noise and
    wall. Where it is not, it hides what lies under it, and the rows are interpolated from those beside.
    """
    excess = background.line_excess
    if not excess.any():
        return level
    contrast = max(background.wall - background.noise, 1e-6)
    hidden = excess > HIDDEN_SHARE * contrast
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


def brightest(image: Image, first_row: Rows) -> Rows:
    """Return the index of the maximum from ``first_row`` (n,) on of every A-scan of ``image`` (n, depth).

    Laves 2019, Extracting mastoid pattern, taken literally.
    """
    beyond = np.arange(image.shape[1]) >= first_row[:, None]
    return np.asarray(np.argmax(np.where(beyond, image, -np.inf), axis=1))


def first_edge(
    image: Image,
    first_row: Rows,
    background: Background,
    mm_per_px: float,
    mm_per_column: float,
    parameters: OctParameters,
) -> Rows:
    """Return the row of the wall's surface in every A-scan of ``image`` (θ, depth); n_depth where there is none.

    A surface has darkness before it, from ``first_row`` (n_theta,) on, and brightness for ``wall_window_mm`` behind
    it. The evidence for every row is summed over samples, and the path through θ with the most evidence is found
    by dynamic programming; changing depth costs evidence in proportion, but a jump (the rim of a cell) costs no
    more than ``jump_cost``. The path closes over the turn.
    """
    nearest = int(first_row.min())
    beyond = np.ascontiguousarray(image[:, nearest:])
    evidence = _evidence(beyond, first_row - nearest, background, mm_per_px, mm_per_column, parameters)
    return nearest + _best_path(evidence, parameters.slope_cost_per_mm * mm_per_px, parameters.jump_cost)


def _evidence(
    image: Image,
    first_row: Rows,
    background: Background,
    mm_per_px: float,
    mm_per_column: float,
    parameters: OctParameters,
) -> Image:
    """Evidence for the surface at each row, and in the last column for none, float32 (n_theta, n_depth + 1)."""
    n_theta, n_depth = image.shape
    contrast = max(background.wall - background.noise, 1e-6)
    sigma = max(background.noise_sigma, LEAST_SIGMA_SHARE * contrast)
    threshold = background.noise + max(
        parameters.noise_sigmas * background.noise_sigma, LEAST_THRESHOLD_SHARE * contrast
    )
    signal = np.clip((image - np.float32(threshold)) * np.float32(1 / sigma), -MOST_SIGMAS, MOST_SIGMAS)
    signal *= np.float32(mm_per_px * mm_per_column / SPECKLE_MM2)
    row = np.arange(n_depth)
    allowed = row >= first_row[:, None]
    signal[~allowed] = 0
    window = max(3, round(parameters.wall_window_mm / mm_per_px))
    total = np.zeros((n_theta, n_depth + 1), np.float32)
    np.cumsum(signal, axis=1, out=total[:, 1:])
    evidence = np.zeros((n_theta, n_depth + 1), np.float32)
    evidence[:, :n_depth] = total[:, np.minimum(row + window, n_depth)] - total[:, :n_depth]
    evidence[:, :n_depth][~allowed] = -1e6
    # what is bright over more than a speckle before the surface speaks against it
    columns, rows = max(1, round(BRIGHT_MM[0] / mm_per_column)) | 1, max(1, round(BRIGHT_MM[1] / mm_per_px)) | 1
    wide = np.concatenate([signal[-columns:], signal, signal[:columns]])
    bright = np.maximum(cv2.blur(wide, (rows, columns), borderType=cv2.BORDER_REPLICATE)[columns:-columns], 0)
    evidence[:, 1:] -= np.cumsum(bright, axis=1)
    return evidence


def _best_path(evidence: Image, slope_cost: float, jump_cost: float) -> Rows:
    """The closed path of states (columns of ``evidence``) over all rows that gathers the most evidence.

    One turn is extended at both ends by a quarter, so that where the path starts and ends does not matter.
    """
    n_theta, n_states = evidence.shape
    lead = n_theta // 4
    order = np.arange(-lead, n_theta + lead) % n_theta
    ramp = (slope_cost * np.arange(n_states)).astype(np.float32)
    gathered = np.empty((order.size, n_states), np.float32)
    best = evidence[order[0]].copy()
    rising, falling = np.empty(n_states, np.float32), np.empty(n_states, np.float32)
    for step, theta in enumerate(order):
        if step:
            np.add(best, ramp, out=rising)
            np.maximum.accumulate(rising, out=rising)
            rising -= ramp
            np.subtract(best, ramp, out=falling)
            np.maximum.accumulate(falling[::-1], out=falling[::-1])
            falling += ramp
            jump = best.max() - jump_cost
            np.maximum(rising, falling, out=rising)
            np.maximum(rising, jump, out=best)
            best += evidence[theta]
            best -= best.max()
        gathered[step] = best
    path = np.empty(order.size, np.intp)
    state = int(np.argmax(gathered[-1]))
    every = np.arange(n_states, dtype=np.float32)
    for step in range(order.size - 1, -1, -1):
        if step < order.size - 1:
            cost = np.minimum(np.abs(every - state) * np.float32(slope_cost), np.float32(jump_cost))
            state = int(np.argmax(gathered[step] - cost))
        path[step] = state
    return path[lead : lead + n_theta]
