"""Normal equations of one Gauss–Newton step of an alignment: how one side's values change as the other is moved.

Samples are worked through in blocks of rows that fit a processor's cache. The blocks are always the same, in float32;
sums over them are float64. That is several times faster than whole images, and as repeatable.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric.least_squares import harmonics
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.geometry.alignment import Alignment

WAVES = 2
"""Harmonics of θ by which the two sides may depart from a rigid turn while it is sought."""
BEND_RAD = 0.02
"""The typical size of such a departure, and of a twist over half the overlap."""
MOVES = 3
"""The unknowns before the bends are turn, shift and scale. After the bends come the coefficients of the tone."""
PATCH_MM = 0.6
"""Residuals farther apart than this err independently: cells are about that large."""
FEWEST_SAMPLES = 100
BLOCK_SAMPLES = 1 << 15


@dataclass(frozen=True)
class Bending:
    """An alignment, and how θ bends besides: a twist, rad per mm of z, and the coefficients of the waves, rad."""

    alignment: Alignment
    bends: Coordinates


@dataclass(frozen=True, eq=False)
class Level:
    """Both sides at one blur: ``fine`` is interpolated at the samples of ``coarse``.

    ``channels`` are the values of ``fine`` and their slopes, d/dz per mm and d/dθ per rad, float32 (n_z, n_theta) each.
    The values are less their mean, and divided by their ``spread``. Those of ``coarse`` are a polynomial of them, of
    ``degree``.
    """

    fine: Evidence
    coarse: Evidence
    channels: tuple[Image, Image, Image]
    spread: float
    degree: int
    sigma_mm: float


@dataclass(frozen=True, eq=False)
class _Overlap:
    """The rows of the coarse side where the two meet, and the fine one interpolated there, float32 (n, n_theta) each.

    ``use`` is None where all of it counts; ``count`` is how many samples do. z counts from ``middle_mm``.
    """

    target: Image
    value: Image
    dz: Image
    dtheta: Image
    use: Mask | None
    count: int
    waves: Image
    from_middle_mm: Image
    middle_mm: float
    patch_of_row: NDArray[np.intp]
    rows: NDArray[np.intp]

    def blocks(self) -> Iterator[slice]:
        """Yield the rows of one block after the other."""
        return _blocks(*self.value.shape)


@dataclass(frozen=True, eq=False)
class _Residuals:
    """How far the values of the coarse side differ from the tone of the fine one, float32 (n, n_theta).

    ``size`` is how large they typically are; ``rising`` holds the coefficients of the tone's derivative.
    """

    overlap: _Overlap
    values: Image
    rising: Coordinates
    size: float


@dataclass(frozen=True, eq=False)
class Equations:
    """``normal`` (k, k) and ``slope`` (k,) of one step, for turn, shift, scale, bends and tone.

    The scale changes about ``middle_mm``; ``correlation`` is that before the step.
    """

    normal: Coordinates
    slope: Coordinates
    middle_mm: float
    correlation: float
    residuals: _Residuals

    def pulls(self, radius_mm: float) -> Coordinates:
        """Return how residuals pull on every unknown, summed over each patch of wall that has any, (k, n)."""
        overlap, residual, k = self.residuals.overlap, self.residuals.values, self.slope.size
        n_theta = residual.shape[1]
        starts = _starts(n_theta, radius_mm)
        n_around = starts.size
        total = np.zeros((int(overlap.patch_of_row[-1]) + 1, k, n_around))
        counted = np.zeros((total.shape[0], n_around))
        for rows in overlap.blocks():
            effects, weight = _effects(self.residuals, rows, k)
            effects *= weight * residual[rows]
            np.add.at(total, overlap.patch_of_row[rows], np.add.reduceat(effects, starts, axis=2).transpose(1, 0, 2))
            used = np.add.reduceat((weight > 0).astype(np.float32), starts, axis=1)
            np.add.at(counted, overlap.patch_of_row[rows], used)
        return total.transpose(1, 0, 2)[:, counted > 0]


def level(fine: Evidence, coarse: Evidence, degree: int, sigma_mm: float) -> Level:
    """Return both sides ready for :func:`equations`."""
    dtheta_rad = 2 * np.pi / fine.values.shape[1]
    dtheta = (np.roll(fine.values, -1, axis=1) - np.roll(fine.values, 1, axis=1)) / np.float32(2 * dtheta_rad)
    dz = np.gradient(fine.values, fine.z_mm, axis=0) if fine.z_mm.size > 1 else np.zeros_like(fine.values)
    known = fine.values[fine.valid]
    centre, spread = (float(known.mean()), float(known.std())) if known.size else (0.0, 0.0)
    values = ((fine.values - np.float32(centre)) / np.float32(max(spread, 1e-12))).astype(np.float32)
    return Level(
        fine, coarse, (values, dz.astype(np.float32), dtheta.astype(np.float32)), max(spread, 1e-12), degree, sigma_mm
    )


def waves(theta_rad: Coordinates) -> Coordinates:
    """Return the harmonics of θ, (2·WAVES, n)."""
    return np.ascontiguousarray(harmonics(theta_rad, range(1, WAVES + 1)).T)


def equations(of: Level, fit: Bending, z_scale_range: tuple[float, float]) -> Equations | None:
    """Return the equations of a step from ``fit``; None where the two hardly overlap or one is constant there.

    The scale is expected in ``z_scale_range``, with its standard deviation: cells close together along z say little.
    """
    fitted = _fitted_tone(of, fit)
    if fitted is None:
        return None
    residuals, correlation = fitted
    overlap, residual = residuals.overlap, residuals.values
    n_bends = fit.bends.size
    k = MOVES + n_bends + of.degree + 1
    normal, slope, cost = np.zeros((k, k)), np.zeros(k), 0.0
    for rows in overlap.blocks():
        effects, weight = _effects(residuals, rows, k)
        pulls = weight * residual[rows]
        slope += effects.reshape(k, -1) @ pulls.ravel()
        effects *= np.sqrt(weight)  # BLAS is quickest at a matrix times itself
        flat = effects.reshape(k, -1)
        normal += flat @ flat.T
        cost += float(np.vdot(pulls, residual[rows]))
    # what is expected counts against residuals of which all within one patch count as one
    one_px = PATCH_MM**2 / (of.coarse.dz_mm * of.coarse.column_mm)
    half_mm = max(float(np.ptp(overlap.from_middle_mm)) / 2, 1e-3)
    low, high = z_scale_range
    typical = np.r_[(high - low) / np.sqrt(12), BEND_RAD / half_mm, np.full(n_bends - 1, BEND_RAD)]
    stiffness = max(1.0, one_px) * cost / overlap.count / typical**2
    expected = np.arange(MOVES - 1, MOVES + n_bends)
    normal[np.diag_indices(k)] *= 1 + 1e-9
    normal[expected, expected] += stiffness
    slope[expected] -= stiffness * np.r_[fit.alignment.z_scale - (low + high) / 2, fit.bends]
    return Equations(normal, slope, overlap.middle_mm, correlation, residuals)


@dataclass(frozen=True, eq=False)
class RowEquations:
    """What each of n rows of the coarse side says of its turn and shift alone, ``n_around`` patches to a row.

    ``rows`` are their indices, (n,). ``normal`` is (n, 2, 2) and ``pulls`` (n, n_around, 2), of turn and shift.
    ``cost`` is Huber's of the residuals, in units of their ``size``, (n, n_around).
    """

    rows: NDArray[np.intp]
    normal: Coordinates
    pulls: Coordinates
    cost: Coordinates
    size: float


def row_equations(of: Level, alignment: Alignment, size: float | None = None) -> RowEquations | None:
    """Return the equations of each row as ``alignment`` places it; None where :func:`equations` has none.

    ``size`` is how large residuals typically are; without it, it is taken from them.
    """
    fit = Bending(alignment, np.zeros(1 + 2 * WAVES))
    fitted = _fitted_tone(of, fit, size)
    if fitted is None:
        return None
    residuals, overlap = fitted[0], fitted[0].overlap
    n = overlap.rows.size
    starts = patches_around(of.coarse)
    n_around = starts.size
    normal, pulls, cost = np.zeros((n, 2, 2)), np.zeros((n, n_around, 2)), np.zeros((n, n_around))
    for rows in overlap.blocks():
        effects, weight = _effects(residuals, rows, MOVES + fit.bends.size + of.degree + 1)
        residual, effects = residuals.values[rows], effects[:2]
        normal[rows] = np.einsum("irc,jrc,rc->rij", effects, effects, weight, dtype=np.float64)
        pulls[rows] = np.add.reduceat(effects * (weight * residual), starts, axis=2).transpose(1, 2, 0)
        # Huber's cost in units of its bound: x² up to it, 2x − 1 beyond
        off = np.abs(residual) / np.float32(2 * residuals.size)
        huber = np.where(off < 1, off**2, 2 * off - 1) * (weight > 0)
        cost[rows] = np.add.reduceat(huber, starts, axis=1)
    return RowEquations(overlap.rows, normal, pulls, cost, residuals.size)


def patches_around(evidence: Evidence) -> NDArray[np.intp]:
    """Return the first column of each patch around the bore, (n_around,)."""
    return _starts(evidence.values.shape[1], evidence.radius_mm)


def _starts(n_theta: int, radius_mm: float) -> NDArray[np.intp]:
    n_around = max(3, round(2 * np.pi * radius_mm / PATCH_MM))
    return np.asarray(-(-np.arange(n_around) * n_theta // n_around), dtype=np.intp)


def _fitted_tone(of: Level, fit: Bending, size: float | None = None) -> tuple[_Residuals, float] | None:
    """Return what the tone curve from the fine side to the coarse leaves, and their correlation; None without one."""
    overlap = _overlap(of, fit)
    if overlap is None or overlap.count < FEWEST_SAMPLES:
        return None
    fitted = _tone(overlap, of.degree)
    if fitted is None:
        return None
    tone, correlation = fitted
    rising = tone[1:] * np.arange(1, of.degree + 1) / of.spread
    residual = np.empty_like(overlap.value)
    for rows in overlap.blocks():
        residual[rows] = overlap.target[rows] - _polynomial(overlap.value[rows], tone)
    size = size or robust_sigma(residual if overlap.use is None else residual[overlap.use]) + 1e-6
    return _Residuals(overlap, residual, rising, size), correlation


def _overlap(of: Level, fit: Bending) -> _Overlap | None:
    """Return the fine side interpolated where samples of the coarse one meet it; None where none does."""
    fine, coarse, alignment = of.fine, of.coarse, fit.alignment
    (n_z, n_theta), n_columns = fine.values.shape, coarse.values.shape[1]
    row = np.interp(alignment.z_to_a(coarse.z_mm), fine.z_mm, np.arange(n_z), left=-1, right=-1)
    met = np.flatnonzero(row >= 0)
    if met.size == 0:
        return None
    along_mm = (-1.0 if alignment.z_reversed else 1.0) * coarse.z_mm[met]
    middle_mm = float(along_mm.mean())
    from_middle_mm = along_mm - middle_mm
    theta_rad = coarse.theta0_rad + 2 * np.pi / n_columns * np.arange(n_columns)
    around = waves(theta_rad)
    column = (alignment.rigid.theta_to_a(theta_rad) + fit.bends[1:] @ around - fine.theta0_rad) * n_theta / (2 * np.pi)
    roll_rad = fit.bends[0] * from_middle_mm + alignment.roll_rad(coarse.z_mm[met])
    further = roll_rad * n_theta / (2 * np.pi)
    above = np.clip(np.floor(row[met]).astype(np.intp), 0, max(n_z - 2, 0))
    below = np.minimum(above + 1, n_z - 1)
    down = (row[met] - above).astype(np.float32)[:, np.newaxis]
    whole = bool(fine.valid.all())
    images = of.channels if whole else (*of.channels, fine.valid.astype(np.float32))
    interpolated: list[Image] = [np.empty((met.size, n_columns), np.float32) for _ in images]
    for rows in _blocks(met.size, n_columns):
        at = column + further[rows, np.newaxis]
        left = np.floor(at)
        aside = (at - left).astype(np.float32)
        left = np.mod(left, n_theta).astype(np.intp)
        line = n_theta * np.arange(left.shape[0])[:, np.newaxis]
        before, after = left + line, np.where(left == n_theta - 1, 0, left + 1) + line
        for image, out in zip(images, interpolated, strict=True):
            lines = image[above[rows]]
            lines += (image[below[rows]] - lines) * down[rows]
            first = lines.take(before)
            out[rows] = first + (lines.take(after) - first) * aside
    use = None
    if not (whole and coarse.valid[met].all()):
        use = coarse.valid[met] if whole else coarse.valid[met] & (interpolated[3] > 0.999)
    value, dz, dtheta = interpolated[:3]
    return _Overlap(
        target=coarse.values[met],
        value=value,
        dz=dz,
        dtheta=dtheta,
        use=use,
        count=value.size if use is None else int(use.sum()),
        waves=around.astype(np.float32),
        from_middle_mm=from_middle_mm.astype(np.float32),
        middle_mm=middle_mm,
        patch_of_row=((coarse.z_mm[met] - coarse.z_mm[0]) / PATCH_MM).astype(np.intp),
        rows=met,
    )


def _tone(overlap: _Overlap, degree: int) -> tuple[Coordinates, float] | None:
    """Return the polynomial that takes values to targets, by rising powers, and the correlation of the two."""
    products = np.zeros((degree + 2, degree + 2))
    for rows in overlap.blocks():
        sums = np.empty((degree + 2, *overlap.value[rows].shape), np.float32)
        _powers(overlap.value[rows], sums[:-1])
        sums[-1] = overlap.target[rows]
        if overlap.use is not None:
            sums *= overlap.use[rows]
        flat = sums.reshape(degree + 2, -1)
        products += flat @ flat.T
    mean = products[0] / overlap.count
    common = products / overlap.count - np.outer(mean, mean)
    of_value, of_target = common[1, 1], common[-1, -1]
    if not (of_value > 0 and of_target > 0):
        return None
    tone = np.linalg.solve(products[:-1, :-1] + 1e-6 * overlap.count * np.eye(degree + 1), products[:-1, -1])
    return np.asarray(tone, dtype=np.float64), float(common[1, -1] / np.sqrt(of_value * of_target))


def _effects(residuals: _Residuals, rows: slice, k: int) -> tuple[Image, Image]:
    """Return how values change with each of ``k`` unknowns, float32 (k, n, n_theta), and how much samples count."""
    overlap = residuals.overlap
    weight: Image = np.maximum(np.abs(residuals.values[rows]) / np.float32(2 * residuals.size), np.float32(1))
    np.divide(np.float32(1), weight, out=weight)
    if overlap.use is not None:
        weight *= overlap.use[rows]
    gain = _polynomial(overlap.value[rows], residuals.rising)
    turn, shift = gain * overlap.dtheta[rows], gain * overlap.dz[rows]
    from_middle = overlap.from_middle_mm[rows, np.newaxis]
    effects = np.empty((k, *gain.shape), np.float32)
    effects[0], effects[1] = turn, shift
    np.multiply(shift, from_middle, out=effects[2])
    np.multiply(turn, from_middle, out=effects[3])
    bends_end = 4 + len(overlap.waves)
    np.multiply(turn, overlap.waves[:, np.newaxis], out=effects[4:bends_end])
    _powers(overlap.value[rows], effects[bends_end:])
    return effects, weight


def _powers(value: Image, out: Image) -> None:
    out[0] = 1
    for power in range(1, len(out)):
        np.multiply(out[power - 1], value, out=out[power])


def _polynomial(value: Image, coefficients: Coordinates) -> Image:
    """Return the polynomial with ``coefficients`` of rising powers at ``value``, float32."""
    result = np.full_like(value, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        result *= value
        result += np.float32(coefficient)
    return result


def _blocks(n_rows: int, n_columns: int) -> Iterator[slice]:
    height = max(1, BLOCK_SAMPLES // n_columns)
    for first in range(0, n_rows, height):
        yield slice(first, min(first + height, n_rows))
