"""Where a part of one side fits the other best, around where an alignment puts it."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from endoct.fusion.evidence.evidence import Evidence, on_grid, reoriented
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.arrays import Coordinates, Mask
from endoct.stitching.compiled import compiled

Spectra = NDArray[np.complex128]

STEP_MM = 0.05
N_THETA = 256
LEAST_SAMPLES = 0.5
"""Of a part's samples that must meet observed wall wherever it is compared."""


@dataclass(frozen=True)
class Fit:
    """Where a part fits best: ``along_mm`` and ``around_mm`` from where the alignment puts it, and how it correlates.

    ``around_mm`` to a fraction of a sample. ``correlation``: there, and where the alignment puts it.
    """

    along_mm: float
    around_mm: float
    correlation: tuple[float, float]

    @property
    def gain(self) -> float:
        """How much better it correlates there."""
        return self.correlation[0] - self.correlation[1]

    def stands_out(self, *, clear: float, gain: float) -> bool:
        """Say whether it correlates by ``clear`` at least, and by ``gain`` more than where the alignment puts it."""
        return self.correlation[0] >= clear and self.gain >= gain


def in_one_frame(a: Evidence, b: Evidence, alignment: Alignment, margin_mm: float) -> tuple[Evidence, Evidence]:
    """Return both on one even grid in A's frame, where B lies as aligned, over rows that both have.

    At either end ``margin_mm`` more, in which nothing needs to be observed.
    """
    moved = reoriented(b, mirrored=alignment.mirrored, z_reversed=alignment.z_reversed, z_scale=alignment.z_scale)
    moved = replace(
        moved, z_mm=moved.z_mm + alignment.z_shift_mm, theta0_rad=moved.theta0_rad + alignment.theta_shift_rad
    )
    first = max(a.z_mm[0], moved.z_mm[0]) - margin_mm
    last = min(a.z_mm[-1], moved.z_mm[-1]) + margin_mm
    z_mm = np.arange(first, last, STEP_MM)
    return on_grid(a, z_mm, N_THETA), on_grid(moved, z_mm, N_THETA)


def rows_of(evidence: Evidence, rows: slice) -> Evidence:
    """Return some rows of ``evidence``."""
    return replace(evidence, values=evidence.values[rows], valid=evidence.valid[rows], z_mm=evidence.z_mm[rows])


def part_of(evidence: Evidence, where: Mask) -> Evidence:
    """Return ``evidence`` that was observed ``where`` only, bool of its shape."""
    return replace(evidence, valid=evidence.valid & where)


def fit_part(a: Evidence, part: Evidence, reach_mm: float, reach_rad: float) -> Fit:
    """Return where ``part`` fits ``a`` best, within ``reach_mm`` along and ``reach_rad`` around; on one grid."""
    rows, columns = round(reach_mm / STEP_MM), round(reach_rad / (2 * np.pi) * N_THETA)
    correlation = _correlations(a, part, rows, columns)
    row, column = map(int, np.unravel_index(int(np.argmax(correlation)), correlation.shape))
    best, here = float(correlation[row, column]), float(correlation[rows, columns])
    around = column - columns + _summit(correlation[row, max(0, column - 1) : column + 2])
    return Fit((row - rows) * STEP_MM, float(around * 2 * np.pi / N_THETA * a.radius_mm), (best, here))


def _summit(three: Coordinates) -> float:
    """Return where the parabola through three samples is highest, from the middle one; 0 where it is not."""
    if three.size < 3 or (bent := three[0] - 2 * three[1] + three[2]) >= 0:
        return 0.0
    return float(0.5 * (three[0] - three[2]) / bent)


def _correlations(a: Evidence, b: Evidence, rows: int, columns: int) -> Coordinates:
    """Return the masked correlation of ``b`` with ``a``, (2 rows + 1, 2 columns + 1), by how far ``b`` is moved.

    Padfield 2012, Masked object registration in the Fourier domain, here along θ alone: parts are few rows high, and
    moved by few columns. Cyclic in θ; rows moved beyond either end meet nothing.
    """
    observed = np.flatnonzero(b.valid.any(axis=1))
    if not observed.size:
        return np.zeros((2 * rows + 1, 2 * columns + 1))
    first, end = int(observed[0]), int(observed[-1]) + 1
    of_a, of_b = _spectra(a), _spectra(rows_of(b, slice(first, end)))
    back = _back_to_columns(columns)
    count, sum_a, sum_b, both, square_a, square_b = (
        moved.real @ back.real - moved.imag @ back.imag for moved in _moved_along(of_a, of_b, first, rows)
    )
    count = np.maximum(count, 1)
    common = both - sum_a * sum_b / count
    spread_a, spread_b = square_a - sum_a**2 / count, square_b - sum_b**2 / count
    product = np.maximum(spread_a, 0) * np.maximum(spread_b, 0)
    enough = (count >= LEAST_SAMPLES * max(b.valid.sum(), 1)) & (product > 1e-9 * float(product.max()))
    return np.asarray(np.where(enough, common / np.sqrt(np.maximum(product, 1e-300)), 0.0))


def _spectra(evidence: Evidence) -> Spectra:
    """The spectra along θ of what is observed, of its values and of their squares, (3, n_z, N_THETA / 2 + 1)."""
    values = np.where(evidence.valid, evidence.values, 0).astype(np.float64)
    return np.asarray(fft.rfft(np.stack([evidence.valid.astype(np.float64), values, values**2]), axis=2))


@lru_cache(maxsize=8)
def _back_to_columns(columns: int) -> Spectra:
    """What takes a spectrum of real samples back to those at −``columns`` … ``columns``."""
    k, column = np.arange(N_THETA // 2 + 1)[:, None], np.arange(-columns, columns + 1)
    weight = np.where((k == 0) | (k == N_THETA // 2), 1, 2) / N_THETA
    return np.asarray(weight * np.exp(2j * np.pi * k * column / N_THETA))


@compiled
def _moved_along(of_a: Spectra, of_b: Spectra, first: int, rows: int) -> Spectra:
    """Sums of the rows of A times those of B, which begin at A's row ``first``, moved by −``rows`` … ``rows``.

    Of: observed × observed, values × observed, observed × values, values × values, squares × observed, observed ×
    squares; (6, 2 rows + 1, n).
    """
    n_rows, n = of_a.shape[1:]
    sums = np.zeros((6, 2 * rows + 1, n), np.complex128)
    for shift in range(2 * rows + 1):
        for row in range(of_b.shape[1]):
            at = first + row + shift - rows
            if at < 0 or at >= n_rows:
                continue
            for k in range(n):
                seen_a, value_a, square_a = of_a[0, at, k], of_a[1, at, k], of_a[2, at, k]
                seen_b = of_b[0, row, k].conjugate()
                value_b, square_b = of_b[1, row, k].conjugate(), of_b[2, row, k].conjugate()
                sums[0, shift, k] += seen_a * seen_b
                sums[1, shift, k] += value_a * seen_b
                sums[2, shift, k] += seen_a * value_b
                sums[3, shift, k] += value_a * value_b
                sums[4, shift, k] += square_a * seen_b
                sums[5, shift, k] += seen_a * square_b
    return sums
