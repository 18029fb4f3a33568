"""The levels of a recording: of noise and of the wall."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from endoct.modalities.oct.calibration import Background
from endoct.modalities.oct.face.capillary import Faces
from endoct.modalities.oct.face.slices import SliceEvidence, behind
from endoct.modalities.oct.surface.evidence import relative_power
from endoct.modalities.oct.surface.fixed_lines import bridge_rows
from endoct.stitching.arrays import Image

MOST_NOISE_POWER = 10.0  # over its median: noise hardly ever has more


def measure_levels(
    slices: Sequence[SliceEvidence],
    faces: Faces,
    line_excess: Image,
    radius_mm: float,
    gap_mm: float,
    mm_per_px: float,
) -> Background:
    """Return the noise of the dark space behind the outer face, and the wall's level: the brightest depth behind that.

    ``slices`` in the order of ``faces``; ``gap_mm`` from the outer face (``radius_mm``) to the nominal wall.
    """
    first, last = round(0.03 / mm_per_px), round((0.03 + max(0.3 * gap_mm, 0.08)) / mm_per_px)
    n_px = max(round(2.5 * gap_mm / mm_per_px), 2 * last)
    dark, bright = [], []
    for i in map(int, np.flatnonzero(~faces.bridged)):
        circle = np.array([faces.x_mm[i], faces.y_mm[i], faces.axis_depth_mm[i]])
        evidence = slices[i]
        filled = replace(evidence, ascans=bridge_rows(evidence.ascans, line_excess > 0))
        samples = behind(filled, circle, radius_mm, mm_per_px, n_px)
        band = samples[:, first:last]
        # judged by one half of the band, taken from the other: the darkest noise is darker than noise
        halves = band[:, : last - first - (last - first) // 2], band[:, (last - first) // 2 :]
        for judged, taken in (halves, halves[::-1]):
            means = judged.mean(axis=1)
            dark.append(taken[means <= np.nanpercentile(means, 40)].ravel())
        samples = np.nan_to_num(samples, nan=float(np.nanmin(samples)))
        smooth = uniform_filter1d(samples, max(1, round(0.04 / mm_per_px)), axis=1)
        bright.append(np.median(smooth[:, first:].max(axis=1)))
    noise_samples = np.concatenate(dark)
    noise_samples = noise_samples[np.isfinite(noise_samples)]
    noise = _median_between_counts(noise_samples)
    sigma = 1.4826 * _median_between_counts(np.abs(noise_samples - noise))
    power = np.minimum(relative_power(noise_samples, noise, max(sigma, 1e-6)), MOST_NOISE_POWER)
    return Background(noise, sigma, float(np.median(bright)), line_excess, float(power.mean()))


def _median_between_counts(samples: Image) -> float:
    """The median of samples that may be whole counts, each standing for all that was rounded to it."""
    ordered, half = np.sort(samples), samples.size / 2
    middle = ordered[int(half)]
    first, last = (int(np.searchsorted(ordered, middle, side)) for side in ("left", "right"))
    low = (ordered[first - 1] + middle) / 2 if first else middle
    high = (middle + ordered[last]) / 2 if last < ordered.size else middle
    return float(np.interp(half, [first, last], [low, high]))
