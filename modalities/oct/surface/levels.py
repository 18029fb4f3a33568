"""How bright a recording's noise and wall are, and how the noise floor lies over depth.

A spectrometer's noise is not white, so that it lies in bands over depth. Half a decibel matters: a wall in a faint
recording is distinguished from noise by the power of many samples together.

A-scans of a whole pullback are pooled side by side, to judge what stays at one depth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN, median, ranked, robust_sigma
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.slices import SliceFeatures, samples_behind
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.background import Background, bridge_rows, relative_power

MOST_NOISE_POWER = 10.0  # over its median: noise hardly ever has more
CLEARANCE_MM = 0.03  # from the outer face to the first sample that shows no more of it
DARKEST_PERCENT = 40
MOST_OF_GAP = 0.75  # between glass and wall, where lines cover what is nearest to the glass
SMOOTH_MM = 0.04
CLEAR_SHARE = 0.5  # of the samples that an A-scan is judged by: of fewer, none knows how dark it is
POOLED_SLICES = 40  # whose worth of A-scans is enough to judge a recording by
SECTORS, PARTS = 12, 4  # of a turn and of the pullback
FEWEST_ASCANS = 6  # of one sector and part
FACE_MM = 0.06
"""Distance behind the outer face up to which the face is still in view."""
WALL_MM = 0.08
"""Distance from the nominal wall within which the real one may lie."""
AROUND_MM = 0.2
"""Distance before and behind a sample within which others say whether it lies in the dark."""
OWN_MM = 0.015
"""Samples nearer than this do not count: where noise happens to be darkest, it is darker than noise usually is."""
DARK_SHARE = 0.1
"""Share of the A-scans at one depth that lie in openings of cells, where there are enough of these."""
SLACK_SIGMAS = 0.25
"""Bands reach no farther than this σ of the noise beyond what the gap shows; what does is bone."""
FLOOR_SMOOTH_MM = 0.03


def measure_levels(
    slices: Sequence[SliceFeatures], faces: Faces, line_excess: Image, floor: Image, acquisition: OctAcquisition
) -> Background:
    """Return the noise of the dark space behind the outer face, and the wall's level: the brightest depth behind that.

    ``slices`` in the order of ``faces``; ``line_excess``, float32 (n_depth,), of the detector's fixed lines;
    ``floor``, float32 (n_depth,), of the noise. Rows under lines do not count as noise, unless all dark space is under
    them. What :func:`bridge_rows` puts there is a mean of two samples, repeated, which is fainter in the median.
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

    Which A-scans are dark is judged by one half of the band, and the samples are taken from the other. The noise that
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


@dataclass(frozen=True, eq=False)
class Pool:
    """A-scans (n, n_depth) of all slices, with the depths of face and nominal wall (n,), and their ``part`` (n,).

    A part is one sector of the turn in one part of the pullback: sector + ``SECTORS`` · part of the pullback.
    """

    ascans: Image
    face_mm: Coordinates
    wall_mm: Coordinates
    part: NDArray[np.intp]


def pooled(slices: Sequence[SliceFeatures], faces: Faces, acquisition: OctAcquisition) -> Pool:
    """Return every n-th of the A-scans of all slices that show the face, as many as ``POOLED_SLICES`` slices have."""
    step = max(1, len(slices) // POOLED_SLICES)
    ascans, face_mm, wall_mm, part, first = [], [], [], [], 0
    for i, features in enumerate(slices):
        chosen = slice(first, None, step)
        first = (first - len(features.ascans)) % step
        if faces.bridged[i]:
            continue
        angle, circle = features.ascan_angle_rad[chosen], faces.capillary.circle(i)
        ascans.append(features.ascans[chosen].copy())  # a view would hold them all
        face_mm.append(circle.depth_mm(angle))
        wall_mm.append(replace(circle, radius_mm=acquisition.bore_radius_mm).depth_mm(angle))
        part.append((angle / (2 * np.pi) * SECTORS).astype(np.intp) % SECTORS + SECTORS * (i * PARTS // len(slices)))
    return Pool(np.concatenate(ascans), np.concatenate(face_mm), np.concatenate(wall_mm), np.concatenate(part))


def filled_medians(samples: Image) -> Image:
    """Return the median of every column without NaN, float32 (n_columns,); columns of too few are interpolated."""
    finite = np.isfinite(samples)
    count = np.count_nonzero(finite, axis=0)
    middle = ranked(samples, finite, np.maximum((count - 1) // 2, 0))
    known = np.flatnonzero(count >= FEWEST_ASCANS)
    if not known.size:
        return np.zeros(samples.shape[1], np.float32)
    return np.asarray(np.interp(np.arange(count.size), known, middle[known]), dtype=np.float32)


def measure_floor(slices: Sequence[SliceFeatures], faces: Faces, lines: Mask, acquisition: OctAcquisition) -> Image:
    """Return by how much the noise at every depth is brighter than noise typically is, float32 (n_depth,).

    ``slices`` in the order of ``faces``; ``lines``, bool (n_depth,), the detector's fixed lines. Only in the gap
    between glass and wall can there be nothing but noise; a catheter off the axis sees that gap at many depths. At each
    of them the floor is the median of the A-scans that are darkest around it, of no more than see the gap there.
    Deeper than any gap, the darkest tenth of the A-scans are openings of cells, or else bone. They count where they are
    as dark as the gap is somewhere. All other depths are as those next to them.
    """
    pool = pooled(slices, faces, acquisition)
    n_depth = pool.ascans.shape[1]
    mm_per_px = acquisition.mm_per_px
    depth_mm = np.arange(n_depth) * mm_per_px
    clear = (depth_mm > pool.face_mm[:, None] + FACE_MM) & ~lines
    in_gap = clear & (depth_mm < pool.wall_mm[:, None] - WALL_MM)
    if not in_gap.any():
        return np.zeros(n_depth, np.float32)
    around = _mean_around(pool.ascans, clear, round(AROUND_MM / mm_per_px), round(OWN_MM / mm_per_px))
    tenth = np.ceil(DARK_SHARE * np.count_nonzero(clear, axis=0)).astype(np.intp)
    of_gap = np.count_nonzero(in_gap, axis=0)
    gap = of_gap >= FEWEST_ASCANS
    level, weight = _darkness(pool.ascans, clear, around, np.where(gap, np.minimum(tenth, of_gap), tenth))
    smooth = _smoothed(level, np.where(gap, weight, 0), mm_per_px)
    noise = pool.ascans[in_gap]
    slack = SLACK_SIGMAS * robust_sigma(noise - median(noise))
    low, high = smooth[gap].min() - slack, smooth[gap].max() + slack
    weight[~gap & ((level < low) | (level > high))] = 0
    known = weight > 0
    smooth = _smoothed(level, weight, mm_per_px)
    floor = np.interp(np.arange(n_depth), np.flatnonzero(known), smooth[known] - np.median(smooth[gap]))
    return np.asarray(floor, dtype=np.float32)


def _darkness(
    ascans: Image, candidates: Mask, around: Coordinates, count: NDArray[np.intp]
) -> tuple[Coordinates, Coordinates]:
    """Return the median of the ``candidates`` that are darkest ``around``, and of how many, at every depth."""
    dark = candidates & (around <= ranked(around, candidates, np.maximum(count - 1, 0)))
    count = np.count_nonzero(dark, axis=0)
    known = count >= FEWEST_ASCANS
    lower, upper = (ranked(ascans, dark, middle) for middle in (np.maximum(count - 1, 0) // 2, count // 2))
    return np.where(known, (lower + upper) / 2, 0.0), np.where(known, count, 0).astype(np.float64)


def _smoothed(level: Coordinates, weight: Coordinates, mm_per_px: float) -> Coordinates:
    """Return ``level`` smoothed over depth where it is known, 0 elsewhere."""
    sigma_px = FLOOR_SMOOTH_MM / mm_per_px
    total = gaussian_filter1d(weight * level, sigma_px, mode="constant")
    count = gaussian_filter1d(weight, sigma_px, mode="constant")
    return np.asarray(np.divide(total, count, out=np.zeros_like(total), where=weight > 0))


@compiled
def _mean_around(ascans: Image, counted: Mask, reach_px: int, own_px: int) -> Coordinates:
    """Return the mean of the ``counted`` samples around each one, but for its own; infinite where it is not counted."""
    n, n_depth = ascans.shape
    around = np.full((n, n_depth), np.inf)
    total, count = np.zeros(n_depth + 1), np.zeros(n_depth + 1)
    for i in range(n):
        for row in range(n_depth):
            total[row + 1] = total[row] + (ascans[i, row] if counted[i, row] else 0)
            count[row + 1] = count[row] + counted[i, row]
        for row in range(n_depth):
            if counted[i, row]:
                first, last = max(row - reach_px, 0), min(row + reach_px + 1, n_depth)
                own_first, own_last = max(row - own_px, 0), min(row + own_px + 1, n_depth)
                level = (total[last] - total[first]) - (total[own_last] - total[own_first])
                n_around = (count[last] - count[first]) - (count[own_last] - count[own_first])
                around[i, row] = level / max(n_around, 1)
    return around
