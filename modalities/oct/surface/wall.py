"""Where the bore wall lies in one B-scan.

The evidence for a surface at a depth is the power behind it, over that of the noise. It is summed with weights that
fall off as bone returns less and less. To first order, that is the log-likelihood ratio of faint bone against noise.
Summing over many samples brings out a wall that no single sample shows and that speckle hides in every single A-scan.

A surface is likelier where the bore's own wall runs than elsewhere. A drilled wall is round: the gap between it and
the capillary's outer face is an offset and two harmonics of the angle. A fit of these gives the wall's place where
it is too faint to be seen as well. A cell is then either a deeper surface, or darkness where bone should be.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.circle import largest_divisor
from endoct.base.numeric.least_squares import harmonics
from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.background import LN_POWER_PER_SIGMA, Background, relative_power, spread_of_noise

Rows = NDArray[np.intp]

MOST_POWER = 6.0
"""Times the power from which samples count as bone: a glint counts for no more."""
HAZE_SHARE = 0.2
"""Haze is as bright as this share of the wall's contrast."""
LOOK_MM2 = 6.4e-5
"""The area of wall that one independent sample of noise and speckle covers, about three samples."""
PATCH_MM = (0.05, 0.05)
"""Averaged over so much of θ and depth, noise is no longer as bright as bone."""
NEVER = np.float32(-1e6)
COLUMNS_AT_ONCE = 8
BLOCK_MM = 0.03
SEARCH_MM = 0.06
REACHES_MM = ((0.2, 1), (0.12, 1), (0.08, 2), (0.05, 2), (0.05, 2))
"""Each round of the fit: the distance up to which surfaces count, and its number of harmonics."""
STRONGEST = 2.0  # times the median evidence: a bright side must not outvote the rest
LEAST_SEEN = 0.05
BAND_MM = 0.02
BONUS_PER_MM = 100.0  # of wall: evidence gained where the bore's wall runs
FRONT_PER_MM = 750.0  # of wall: evidence lost before the bore's wall, where there can only be dirt
AT_ONCE = 16  # maxima that are kept apart, so that a processor takes them as a vector
COLUMN_MM = 0.008  # a third of the beam's width: finer columns are taken together
STIFFER = 5.0


class _Columns(NamedTuple):
    """Where evidence is gathered: from which column of the circle on, in which ``visible`` rows, behind which of them.

    ``first_row`` (n_columns,) counts visible rows only.
    """

    start: int
    visible: Rows
    first_row: Rows


class _Weights(NamedTuple):
    """Power times ``per_bone`` is 1 where it counts as bone. ``of_sample``: its weight; ``decay``: that of the next."""

    per_bone: np.float32
    of_sample: np.float32
    decay: np.float32


def surface_evidence(
    level: Image, start: int, first_row: Rows, background: Background, spacing: Spacing, parameters: OctParameters
) -> Image:
    """Return evidence for the surface at each row, and in the last column for none; float32 (n_columns, n_depth + 1).

    ``level``, float32 (n_theta, n_depth), is a logarithmic B-scan. From column ``start`` on, so many of the circle's
    columns are taken together that n_columns are left; ``spacing`` is that of single ones. A surface lies at
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
    weights = _Weights(
        per_bone=np.float32(1 / bone),
        of_sample=np.float32(spacing.depth_mm * spacing.column_mm / LOOK_MM2),
        decay=np.float32(np.exp(-spacing.depth_mm / parameters.wall_decay_mm)),
    )
    patch = (
        max(1, round(PATCH_MM[0] / (spacing.column_mm * together))) | 1,
        max(1, round(PATCH_MM[1] / spacing.depth_mm)),
    )
    columns = _Columns(start, visible, np.searchsorted(visible, first_row))
    evidence = _evidence(relative_power(level, background.noise, sigma), columns, weights, patch)
    if visible.size == background.hidden.size:
        return evidence
    # the last column of what is visible stands for none
    return np.take(evidence, np.searchsorted(visible, np.arange(background.hidden.size + 1)), axis=1)


@compiled
def _evidence(power: Image, columns: _Columns, weights: _Weights, patch: tuple[int, int]) -> Image:
    """The evidence in ``columns`` of ``power`` (n_theta, n_depth), float32 (n_columns, n_visible + 1).

    What lies behind a row counts for it. A bright ``patch`` (columns, rows) before it counts against it.
    ``COLUMNS_AT_ONCE`` columns are summed up along depth together, so that no sum has to wait for the one before.
    """
    start, visible, first_row = columns
    per_bone, weight, decay = weights
    patch_columns, patch_rows = patch
    n_columns, n_rows = first_row.size, visible.size
    signal = np.empty((n_rows, COLUMNS_AT_ONCE), np.float32)
    behind, sums = np.empty((n_rows, COLUMNS_AT_ONCE), np.float32), np.empty((n_rows, COLUMNS_AT_ONCE))
    evidence = np.empty((n_columns, n_rows + 1), np.float32)
    above = np.empty((n_columns, n_rows))
    for group in range(0, n_columns, COLUMNS_AT_ONCE):
        for k in range(COLUMNS_AT_ONCE):
            column = (group + k) % n_columns
            signal[: first_row[column], k] = 0
            ascan = _signal(power, start, column, n_columns, per_bone)
            for row in range(first_row[column], n_rows):
                signal[row, k] = ascan[visible[row]] * weight
        _sum_behind(signal, decay, behind)
        _sum_above(signal, patch_rows, sums)
        for k in range(COLUMNS_AT_ONCE):
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
    """Write what lies at each row and behind it, weights falling off by ``decay``, both (row, column)."""
    total = np.zeros(COLUMNS_AT_ONCE, np.float32)
    for row in range(len(signal) - 1, -1, -1):
        for k in range(COLUMNS_AT_ONCE):
            total[k] = signal[row, k] + decay * total[k]
            behind[row, k] = total[k]


@compiled
def _sum_above(signal: Image, n_rows: int, sums: Coordinates) -> None:
    """Write sums over so many rows that end at each row, both (row, column); the first row is repeated."""
    total = np.empty(COLUMNS_AT_ONCE)
    for k in range(COLUMNS_AT_ONCE):
        total[k] = np.float64(signal[0, k]) * n_rows
    for row in range(len(signal)):
        old = max(row - n_rows, 0)
        for k in range(COLUMNS_AT_ONCE):
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


def gap_rows(rows: Rows, first_row: Rows, evidence: Image, mm_per_px: float) -> Coordinates:
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


def first_edge(
    image: Image, first_row: Rows, background: Background, spacing: Spacing, parameters: OctParameters
) -> Rows:
    """Return the row of the wall's surface in every A-scan of ``image`` (θ, depth); n_depth where there is none.

    A surface has darkness before it, from ``first_row`` (n_theta,) on, and bone behind it. Dynamic programming finds
    the closed path through θ with most evidence. A change of depth costs evidence in proportion, but no more than
    ``jump_cost``, so that the rim of a cell can be a jump. A stiff path over blocks of columns comes first: it gives
    the bore's own wall, where a surface then is likelier.
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
