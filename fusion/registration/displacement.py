"""Where a part of one side fits the other best, around where an alignment puts it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from endoct.fusion.evidence.evidence import Evidence, on_grid, reoriented
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.arrays import Coordinates, Image, Mask

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

    Padfield 2012, Masked object registration in the Fourier domain. Cyclic in θ; rows moved beyond either end meet
    nothing.
    """
    n = fft.next_fast_len(a.z_mm.size + rows, real=True)

    def spectrum(image: Image | Mask) -> np.ndarray:
        return np.asarray(fft.rfft2(image.astype(np.float64), s=(n, N_THETA)))

    def moved(of_a: np.ndarray, of_b: np.ndarray) -> Coordinates:
        plane = fft.irfft2(of_a * np.conj(of_b), s=(n, N_THETA))
        return np.asarray(np.roll(plane, (rows, columns), axis=(0, 1))[: 2 * rows + 1, : 2 * columns + 1])

    of_a, of_b = ([spectrum(e.valid), spectrum(e.values * e.valid), spectrum(e.values**2 * e.valid)] for e in (a, b))
    count = np.maximum(moved(of_a[0], of_b[0]), 1)
    sum_a, sum_b = moved(of_a[1], of_b[0]), moved(of_a[0], of_b[1])
    common = moved(of_a[1], of_b[1]) - sum_a * sum_b / count
    spread_a = moved(of_a[2], of_b[0]) - sum_a**2 / count
    spread_b = moved(of_a[0], of_b[2]) - sum_b**2 / count
    product = np.maximum(spread_a, 0) * np.maximum(spread_b, 0)
    enough = (count >= LEAST_SAMPLES * max(b.valid.sum(), 1)) & (product > 1e-9 * float(product.max()))
    return np.asarray(np.where(enough, common / np.sqrt(np.maximum(product, 1e-300)), 0.0))
