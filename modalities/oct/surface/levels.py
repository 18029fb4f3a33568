"""How bright a recording's noise and wall are."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures, samples_behind
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.background import Background
from endoct.modalities.oct.surface.evidence import relative_power
from endoct.modalities.oct.surface.line_removal import bridge_rows
from endoct.stitching.arrays import Image
from endoct.stitching.ranks import median
from endoct.stitching.robust import SIGMA_PER_MEDIAN

MOST_NOISE_POWER = 10.0  # over its median: noise hardly ever has more
CLEARANCE_MM = 0.03  # from the outer face to the first sample that shows no more of it
DARKEST_PERCENT = 40
MOST_OF_GAP = 0.75  # between glass and wall, where lines cover what is nearest to the glass
SMOOTH_MM = 0.04
CLEAR_SHARE = 0.5  # of the samples that an A-scan is judged by: of fewer, none knows how dark it is


def measure_levels(
    slices: Sequence[SliceFeatures], faces: Faces, line_excess: Image, floor: Image, acquisition: OctAcquisition
) -> Background:
    """Return the noise of the dark space behind the outer face, and the wall's level: the brightest depth behind that.

    ``slices`` in the order of ``faces``; ``line_excess``, float32 (n_depth,), of the detector's fixed lines;
    ``floor``, float32 (n_depth,), of the noise. Rows under lines do not count as noise, unless all dark space is under
    them: what :func:`bridge_rows` puts there is a mean of two samples, repeated, which is fainter in the median.
    """
    mm_per_px, gap_mm, lines = acquisition.mm_per_px, acquisition.gap_mm, line_excess > 0
    first, last = round(CLEARANCE_MM / mm_per_px), round((CLEARANCE_MM + max(0.3 * gap_mm, 0.08)) / mm_per_px)
    reach, n_px = max(round(MOST_OF_GAP * gap_mm / mm_per_px), last), max(round(2.5 * gap_mm / mm_per_px), 2 * last)

    def dark_and_bright(i: int) -> tuple[list[Image], list[Image], float]:
        features, face = slices[i], faces.capillary.circle(i)
        ascans = features.ascans - floor
        clear = replace(features, ascans=np.where(lines, np.float32(np.nan), ascans))
        filled = replace(features, ascans=bridge_rows(ascans, lines))
        samples = samples_behind(filled, face, mm_per_px, n_px)
        dark = _darkest(_foremost(samples_behind(clear, face, mm_per_px, reach)[:, first:], last - first))
        under_lines = [] if dark else _darkest(samples[:, first:last])
        samples = np.nan_to_num(samples, nan=float(np.nanmin(samples)))
        smooth = uniform_filter1d(samples, max(1, round(SMOOTH_MM / mm_per_px)), axis=1)
        return dark, under_lines, median(smooth[:, first:].max(axis=1))

    levels = [dark_and_bright(i) for i in map(int, np.flatnonzero(~faces.bridged))]
    bright = np.array([wall for _, _, wall in levels], np.float32)
    bands = [band for dark, _, _ in levels for band in dark] or [band for _, under, _ in levels for band in under]
    noise_samples = np.concatenate(bands)
    noise_samples = noise_samples[np.isfinite(noise_samples)]
    noise = _median_between_counts(noise_samples)
    sigma = SIGMA_PER_MEDIAN * _median_between_counts(np.abs(noise_samples - noise))
    power = np.minimum(relative_power(noise_samples, noise, max(sigma, 1e-6)), MOST_NOISE_POWER)
    return Background(noise, sigma, float(np.median(bright)), line_excess, floor, float(power.mean()))


def _foremost(samples: Image, count: int) -> Image:
    """The first ``count`` samples of every A-scan that are not NaN, (n_ascans, count); NaN where there are fewer."""
    order = np.argsort(np.isnan(samples), axis=1, kind="stable")[:, :count]
    return np.take_along_axis(samples, order, axis=1)


def _darkest(band: Image) -> list[Image]:
    """Samples of the darkest A-scans of a dark band, float32 (n_ascans, n_px), NaN where a sample does not count.

    Which A-scans are dark is judged by one half of the band, the samples are taken from the other: the noise that
    happens to be darkest is darker than noise is.
    """
    half = band.shape[1] // 2
    halves = band[:, : band.shape[1] - half], band[:, half:]
    taken = []
    for judged, other in (halves, halves[::-1]):
        counts = np.isfinite(judged)
        judgeable = counts.mean(axis=1) >= CLEAR_SHARE
        means = np.where(counts, judged, 0)[judgeable].sum(axis=1) / counts[judgeable].sum(axis=1, dtype=np.float32)
        chosen = other[judgeable][means <= np.percentile(means, DARKEST_PERCENT)] if means.size else other[:0]
        if np.isfinite(chosen).any():
            taken.append(chosen.ravel())
    return taken


def _median_between_counts(samples: Image) -> float:
    """The median of samples that may be whole counts, each of which stands for all values that round to it."""
    ordered, half = np.sort(samples), samples.size / 2
    middle = ordered[int(half)]
    first, last = (int(np.searchsorted(ordered, middle, side)) for side in ("left", "right"))
    low = (ordered[first - 1] + middle) / 2 if first else middle
    high = (middle + ordered[last]) / 2 if last < ordered.size else middle
    return float(np.interp(half, [first, last], [low, high]))
