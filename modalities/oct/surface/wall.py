"""Where the bore wall lies in one B-scan, and which A-scans show it.

A surface is likelier where the bore's own wall runs than elsewhere. A drilled wall is round: the gap between it and
the capillary's outer face is an offset and two harmonics of the angle. A fit of these gives the wall's place where
it is too faint to be seen as well. A cell is then either a deeper surface, or darkness where bone should be. An A-scan
may also show something opaque before the wall, its shadow, or noise: that is not trusted.

A strip keeps of each A-scan its maximum beyond the capillary. The largest of many values is taken by vectors: a
loop that keeps one maximum waits for every comparison.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.circle import largest_divisor
from endoct.base.numeric.least_squares import harmonics
from endoct.modalities.oct.bscan import Spacing, mean_between, varying
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.line_removal import Bridges, bridge_ascan, bridges_over
from endoct.modalities.oct.surface.wall_evidence import Background, relative_power, spread_of_noise, surface_evidence

BLOCK_MM = 0.03
SEARCH_MM = 0.06
REACHES_MM = ((0.2, 1), (0.12, 1), (0.08, 2), (0.05, 2), (0.05, 2))
"""Each round of the fit: the distance up to which surfaces count, and its number of harmonics."""
STRONGEST = 2.0  # times the median evidence: a bright side does not outvote the rest
LEAST_SEEN = 0.05
BAND_MM = 0.02
BONUS_PER_MM = 100.0  # of wall: evidence gained where the bore's wall runs
FRONT_PER_MM = 750.0  # of wall: evidence lost before the bore's wall, where there can only be dirt


def gap_rows(rows: NDArray[np.intp], first_row: NDArray[np.intp], evidence: Image, mm_per_px: float) -> Coordinates:
    """Return how many rows the bore's wall lies behind ``first_row``, float64 (n,), from surfaces at ``rows`` (n,).

    ``evidence`` is that for the rows, (n, n_depth + 1). All NaN where there is hardly any surface, or no evidence.
    """
    surface = rows < evidence.shape[1] - 1
    if np.count_nonzero(surface) < max(LEAST_SEEN * rows.size, 8):
        return np.full(rows.size, np.nan)
    gap = (rows - first_row).astype(np.float64)
    weight = np.where(surface, np.maximum(evidence[np.arange(rows.size), rows], 0), 0).astype(np.float64)
    if not weight.any():  # as in a B-scan that is upside down: nothing brightens with depth
        return np.full(rows.size, np.nan)
    weight = np.minimum(weight, STRONGEST * max(float(np.median(weight[surface])), 1e-9))
    density = np.bincount(np.maximum(rows - first_row, 0), weights=weight)
    wide = max(1, round(SEARCH_MM / mm_per_px))
    basis = _basis(rows.size)
    fit = np.zeros(basis.shape[1])
    fit[0] = np.argmax(np.convolve(density, np.ones(wide), "same"))
    for reach_mm, n_harmonics in REACHES_MM:
        used = basis[:, : 1 + 2 * n_harmonics]
        residual = gap - basis @ fit
        near = weight * np.clip(1 - (residual * mm_per_px / reach_mm) ** 2, 0, None) ** 2
        # damped, so that a wall seen in part does not swing where it is not seen
        damping = np.diag([1e-3] + [0.02 * weight.sum()] * (2 * n_harmonics))
        fit[: used.shape[1]] += np.linalg.solve((used.T * near) @ used + damping, (used.T * near) @ residual)
    return np.asarray(basis @ fit)


def favour_bore(evidence: Image, wall_row: Coordinates, spacing: Spacing) -> None:
    """Raise ``evidence`` (n, n_depth + 1) within ``BAND_MM`` of ``wall_row`` (n,), and lower it before, in place."""
    bonus, front = BONUS_PER_MM * spacing.column_mm, FRONT_PER_MM * spacing.column_mm
    bands_per_row = np.float32(spacing.depth_mm / BAND_MM)
    _favour(evidence, wall_row.astype(np.float32), bands_per_row, np.float32(bonus), np.float32(front))


@compiled
def _favour(evidence: Image, wall_row: Image, bands_per_row: np.float32, bonus: np.float32, front: np.float32) -> None:
    none, one, two = np.float32(0), np.float32(1), np.float32(2)
    n_depth = evidence.shape[1] - 1
    for column in range(len(evidence)):
        wall = wall_row[column]
        first = min(max(int(wall - 3 / bands_per_row) - 1, 0), n_depth)
        for row in range(first):
            evidence[column, row] -= front
        for row in range(first, min(max(int(wall + 2 / bands_per_row) + 2, 0), n_depth)):
            behind = (np.float32(row) - wall) * bands_per_row
            evidence[column, row] += bonus * min(max(two - abs(behind), none), one)
            evidence[column, row] -= front * min(max(-two - behind, none), one)


def _basis(n: int) -> Coordinates:
    """An offset and two harmonics of the angle of ``n`` even columns, float64 (n, 5)."""
    return np.concatenate([np.ones((n, 1)), harmonics(2 * np.pi * np.arange(n) / n, (1, 2))], axis=1)


AT_ONCE = 16  # maxima that are kept apart, so that a processor takes them as a vector


@compiled
def largest(values: Image) -> np.float32:
    """Return the largest of ``values``, float32 (n,), n from 1; none of them is NaN."""
    highest = np.empty(AT_ONCE, np.float32)
    highest[:] = values[values.size - 1]
    blocks = values.size // AT_ONCE
    for block in range(blocks):
        for k in range(AT_ONCE):
            highest[k] = max(highest[k], values[block * AT_ONCE + k])
    most = highest[0]
    for k in range(1, AT_ONCE):
        most = max(most, highest[k])
    for i in range(blocks * AT_ONCE, values.size):
        most = max(most, values[i])
    return np.float32(most)


@compiled
def _first_largest(values: Image) -> int:
    """Return the index of the first of the largest ``values``, float32 (n,), n from 1."""
    at = 0
    for i in range(1, values.size):
        if values[i] > values[at]:
            at = i
    return at


Rows = NDArray[np.intp]

COLUMN_MM = 0.008  # a third of the beam's width: finer columns are taken together
STIFFER = 5.0


def brightest(image: Image, first_row: Rows) -> Rows:
    """Return the index of the maximum from ``first_row`` (n,) on of every A-scan of ``image`` (n, depth).

    Laves 2019, Extracting mastoid pattern, implemented literally.
    """
    beyond = np.arange(image.shape[1]) >= first_row[:, None]
    return np.asarray(np.argmax(np.where(beyond, image, -np.inf), axis=1))


def first_edge(
    image: Image, first_row: Rows, background: Background, spacing: Spacing, parameters: OctParameters
) -> Rows:
    """Return the row of the wall's surface in every A-scan of ``image`` (θ, depth); n_depth where there is none.

    A surface has darkness before it, from ``first_row`` (n_theta,) on, and bone behind it
    (:mod:`endoct.modalities.oct.surface.wall_evidence`). Dynamic programming finds the closed path through θ with most
    evidence; a change of depth costs evidence in proportion, but no more than ``jump_cost``, so that the rim of a cell
    can be a jump. A stiff path over blocks of columns comes first: it gives the bore's own wall, where a surface then
    is likelier (:mod:`endoct.modalities.oct.surface.wall`).
    """
    nearest = int(first_row.min())
    # columns are taken together from a place of the specimen's on, so that it does not matter where the turn starts
    start = int(np.argmax(image.sum(axis=1)))
    together = largest_divisor(image.shape[0], round(COLUMN_MM / spacing.column_mm))
    first = np.roll(first_row, -start).reshape(-1, together).max(axis=1) - nearest
    evidence = surface_evidence(image[:, nearest:], start, first, background.from_row(nearest), spacing, parameters)
    wide = Spacing(spacing.depth_mm, spacing.column_mm * together)
    slope_cost, jump_cost = parameters.slope_cost_per_mm * spacing.depth_mm, parameters.jump_cost
    gap = _gap_of_bore(evidence, first, wide, (STIFFER * slope_cost, STIFFER * jump_cost))
    if np.isfinite(gap).all():
        favour_bore(evidence, first + gap, wide)
    return np.roll(nearest + np.repeat(_best_path(evidence, slope_cost, jump_cost), together), start)


def _gap_of_bore(evidence: Image, first: Rows, spacing: Spacing, costs: tuple[float, float]) -> Coordinates:
    """The rows from ``first`` (n,) to the bore's wall, by a stiff path over blocks of columns, float64 (n,)."""
    block = largest_divisor(first.size, round(BLOCK_MM / spacing.column_mm))
    blocks = evidence.reshape(-1, block, evidence.shape[1]).sum(axis=1)
    from_row = first.reshape(-1, block).mean(axis=1).round().astype(np.intp)
    gap = gap_rows(_best_path(blocks, *costs), from_row, blocks, spacing.depth_mm)
    middle = (np.arange(gap.size) + 0.5) * block - 0.5
    return np.interp(np.arange(first.size), middle, gap, period=first.size)


def _best_path(evidence: Image, slope_cost: float, jump_cost: float) -> Rows:
    """The closed path of states (columns of ``evidence``) over all rows that gathers the most evidence.

    One turn is extended at both ends by a quarter, so that where the path starts and ends does not matter.
    """
    n_states = evidence.shape[1]
    ramp = (slope_cost * np.arange(n_states)).astype(np.float32)
    near = int(min(jump_cost / slope_cost, n_states)) + 1 if slope_cost else n_states  # farther off, a jump costs less
    cost = np.minimum(np.arange(near + 1) * np.float32(slope_cost), np.float32(jump_cost), dtype=np.float32)
    return _followed(evidence, ramp, cost, np.float32(jump_cost))


@compiled
def _followed(evidence: Image, ramp: Image, cost: Image, jump_cost: np.float32) -> Rows:
    """The path; ``ramp`` is what a change by so many rows costs, and ``cost`` the same where it is less than a jump."""
    n_theta, n_states = evidence.shape
    lead = n_theta // 4
    n_steps = n_theta + 2 * lead
    gathered = np.empty((n_steps, n_states), np.float32)
    falling, rising = np.empty(n_states, np.float32), np.empty(n_states, np.float32)
    most = np.float32(0)  # what the step before gathered; all but the first then have theirs taken off
    for step in range(n_steps):
        here, best = evidence[(step - lead) % n_theta], gathered[step]
        if step == 0:
            for state in range(n_states):
                best[state] = here[state]
        else:
            before = gathered[step - 1]
            from_behind, from_before = before[n_states - 1] - ramp[n_states - 1], before[0]
            for state in range(n_states):  # both ways at once: neither has to wait for the other
                back = n_states - 1 - state
                from_behind = max(from_behind, before[back] - ramp[back])
                from_before = max(from_before, before[state] + ramp[state])
                falling[back], rising[state] = from_behind, from_before
            jump = most - jump_cost
            for state in range(n_states):
                near_by = max(rising[state] - ramp[state], falling[state] + ramp[state])
                best[state] = max(near_by, jump) + here[state]
        most = largest(best)
        if step:
            for state in range(n_states):
                best[state] -= most
            most = np.float32(0)
    path = np.empty(n_steps, np.intp)
    near = cost.size - 1
    state = _first_largest(gathered[n_steps - 1])
    path[n_steps - 1] = state
    for step in range(n_steps - 2, -1, -1):
        reached = np.float32(-np.inf)
        nearest = state
        for other in range(max(state - near, 0), min(state + near + 1, n_states)):
            value = gathered[step, other] - cost[abs(other - state)]
            if value > reached:
                reached, nearest = value, other
        most = np.float32(0) if step else largest(gathered[0])
        state = nearest if reached >= most - jump_cost else _first_largest(gathered[step])
        path[step] = state
    return path[lead : lead + n_theta]


def maximum_intensity(samples: NDArray[Any], first_row: Rows, lines: Mask) -> Image:
    """Return the maximum of each A-scan of ``samples`` (n, depth) cropped from ``first_row`` (n,) on, float32 (n,).

    The rows ``lines``, bool (depth,), are interpolated from their neighbours. Laves 2019, Extracting mastoid pattern:
    crop, then maximum intensity projection along depth.
    """
    return _maxima(samples, first_row, bridges_over(lines))


@compiled
def _maxima(samples: NDArray[Any], first_row: Rows, bridges: Bridges) -> Image:
    n_ascans, n_depth = samples.shape
    maxima = np.empty(n_ascans, np.float32)
    ascan = np.empty(n_depth, np.float32)
    for i in range(n_ascans):
        for row in range(n_depth):
            ascan[row] = np.float32(samples[i, row])
        bridge_ascan(ascan, bridges)
        maxima[i] = largest(ascan[first_row[i] :])
    return maxima


SURFACE_MM = 0.1
TAIL_MM = (0.3, 0.6)
NEAR_MM = 0.1
SHADOW_EDGE_MM = 0.3
OPAQUE_SHARE = 0.25
BRIGHT_SHARE = 0.5
TAIL_SIGMAS = 1.5
PATCH_MM = 0.1
MOST_POWER = 30.0  # times the noise's: a glint counts for no more
POWER_OF_A_PATH = 1.5  # times the noise's: a path through noise alone follows what is brightest


def trusted(level: Image, row: Rows, background: Background, spacing: Spacing) -> Mask:
    """Return for every A-scan of a logarithmic B-scan (θ, depth) whether its surface at ``row`` is the wall's.

    It is not where a bright surface has nothing behind it while the wall elsewhere in the slice has: something opaque,
    such as a guide wire or a clot, lies before the wall. Nor is it next to that, where the shadow shows no surface
    (``row`` = n_depth). Elsewhere no surface means a cell whose floor is out of range, which is trusted.
    """
    n_theta, n_depth = level.shape
    surface = row < n_depth
    if not surface.any() or not varying(level).any():
        return np.zeros(n_theta, bool)
    mm_per_px, mm_per_column = spacing.depth_mm, spacing.column_mm
    near = max(1, round(NEAR_MM / mm_per_column))
    bright = _mean(level, row, row + round(SURFACE_MM / mm_per_px)) - background.noise
    tail = _mean(level, row + round(TAIL_MM[0] / mm_per_px), row + round(TAIL_MM[1] / mm_per_px)) - background.noise
    opaque = np.zeros(n_theta, bool)
    measured = surface & np.isfinite(tail)
    usual = float(np.median(tail[measured])) if measured.any() else 0.0
    if usual > TAIL_SIGMAS * background.noise_sigma:
        dark = measured & (tail < OPAQUE_SHARE * usual) & (bright > BRIGHT_SHARE * background.contrast)
        # a narrow one would be a gap in the speckle
        share = uniform_filter1d(dark.astype(np.float32), 2 * near + 1, mode="wrap")
        opaque = dark & (maximum_filter1d(share, 2 * near + 1, mode="wrap") > 0.8)
    good = ~opaque
    reach = max(1, round(SHADOW_EDGE_MM / mm_per_column))
    for first, length in _runs(~surface):
        around = np.arange(first - reach, first + length + reach) % n_theta
        if opaque[around].any():
            good[np.arange(first, first + length) % n_theta] = False
    return good


def wall_sigmas(level: Image, row: Rows, trusted: Mask, background: Background, spacing: Spacing) -> float:
    """Return by how many standard errors the wall stands out of the noise, over 0.1 × 0.1 mm of it.

    That is the power just behind the surface at ``row``, in excess of what a path through noise alone would show, the
    median over all such patches where ``trusted`` A-scans show a surface; 0 where there are none, or where the power is
    less than that of noise.
    """
    n_depth = level.shape[1]
    depth, width = max(1, round(PATCH_MM / spacing.depth_mm)), max(1, round(PATCH_MM / spacing.column_mm))
    behind = row[:, None] + np.arange(depth)
    seen = trusted[:, None] & (behind < n_depth)
    levels = np.take_along_axis(level, np.minimum(behind, n_depth - 1), axis=1)
    power = relative_power(levels, background.noise, spread_of_noise(background)) / background.noise_power
    power = np.where(seen, np.minimum(power, MOST_POWER), 0).sum(axis=1, dtype=np.float64)
    looks, total = (uniform_filter1d(each, width, mode="wrap") for each in (seen.sum(axis=1, dtype=np.float64), power))
    full = looks > depth / 2
    if not full.any():
        return 0.0
    excess = float(np.median(total[full] / looks[full])) - POWER_OF_A_PATH
    return max(0.0, excess * math.sqrt(depth * width))


def _mean(level: Image, first: Rows, last: Rows) -> Coordinates:
    """Mean over rows ``first`` to ``last`` of every A-scan, NaN where these leave the depth range."""
    inside = (last <= level.shape[1]) & (last > first)
    return np.where(inside, mean_between(level, first, last), np.nan)


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """First index and length of every run of True in a cyclic mask."""
    if mask.all():
        return [(0, mask.size)]
    starts = np.flatnonzero(mask & ~np.roll(mask, 1))
    ends = np.flatnonzero(mask & ~np.roll(mask, -1))
    if ends.size and starts.size and ends[0] < starts[0]:
        ends = np.roll(ends, -1)
    return [(int(start), int((end - start) % mask.size) + 1) for start, end in zip(starts, ends, strict=True)]
