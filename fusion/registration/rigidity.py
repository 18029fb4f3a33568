"""Whether all parts of the wall lie where one rigid alignment puts them.

An alignment is rigid: one turn, one shift, one scale. A recording need not be: a catheter that slipped, slices that
were lost or swapped, a step within every turn bend its wall, and the best rigid place is then right for some of it
only. So parts of one side, bands along the bore and sectors of it, are each searched for on the other side around where
the alignment puts them: tall bands nearby in all directions, and low ones, as few slices are, far along the bore.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import fft

from endoct.fusion.evidence.evidence import Evidence, clipped, on_grid, reoriented
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.arrays import Coordinates, Image, Mask

STEP_MM = 0.05
N_THETA = 256
SECTORS = 4
LEAST_SAMPLES = 0.5
"""Of a part's samples that must meet observed wall wherever it is compared."""
FAR_MM = 0.16
"""Around the bore or along it: parts that lie farther from where they should are out of place."""


@dataclass(frozen=True)
class Look:
    """How parts are searched for: bands ``tall_mm`` high, or sectors of any height; how far along and around.

    A part says something about its place where it correlates by ``clear`` at least where it fits best, and by
    ``better`` more than where the alignment puts it.
    """

    tall_mm: float
    reach_mm: float
    reach_rad: float
    clear: float
    better: float


NEAR = Look(tall_mm=1.5, reach_mm=1.0, reach_rad=0.6, clear=0.55, better=0.12)
FAR = Look(tall_mm=0.6, reach_mm=4.0, reach_rad=0.1, clear=0.75, better=0.45)
FARTHEST_MM = max(NEAR.reach_mm, FAR.reach_mm)


@dataclass(frozen=True)
class Part:
    """A part of the wall that fits best elsewhere, ``along_mm`` and ``around_mm`` from where the alignment puts it.

    ``kind``: a band along the bore, or a sector of it; ``first`` and ``last`` its bounds in A's frame, mm or rad.
    ``correlation``: (there, where the alignment puts it).
    """

    kind: Literal["band", "sector"]
    first: float
    last: float
    along_mm: float
    around_mm: float
    correlation: tuple[float, float]

    @property
    def off_mm(self) -> float:
        """How far out of place it is, mm."""
        return float(np.hypot(self.along_mm, self.around_mm))


def parts_out_of_place(a: Evidence, b: Evidence, alignment: Alignment) -> tuple[Part, ...]:
    """Return the parts of the wall that do not lie where ``alignment`` puts B on A, the farthest off first."""
    one, two = _in_one_frame(clipped(a), clipped(b), alignment)
    parts = [*_bands(one, two, NEAR), *_bands(one, two, FAR), *_sectors(one, two, NEAR)]
    return tuple(sorted((part for part in parts if part.off_mm > FAR_MM), key=lambda part: -part.off_mm))


def _in_one_frame(a: Evidence, b: Evidence, alignment: Alignment) -> tuple[Evidence, Evidence]:
    """Return both on one even grid in A's frame, where B lies as aligned, over B's rows within A's reach."""
    moved = reoriented(b, mirrored=alignment.mirrored, z_reversed=alignment.z_reversed, z_scale=alignment.z_scale)
    moved = replace(
        moved, z_mm=moved.z_mm + alignment.z_shift_mm, theta0_rad=moved.theta0_rad + alignment.theta_shift_rad
    )
    first = max(a.z_mm[0], moved.z_mm[0]) - FARTHEST_MM
    last = min(a.z_mm[-1], moved.z_mm[-1]) + FARTHEST_MM
    z_mm = np.arange(first, last, STEP_MM)
    return on_grid(a, z_mm, N_THETA), on_grid(moved, z_mm, N_THETA)


def _bands(a: Evidence, b: Evidence, look: Look) -> Iterator[Part]:
    margin, tall = round(look.reach_mm / STEP_MM), round(look.tall_mm / STEP_MM)
    first_row = round(FARTHEST_MM / STEP_MM)
    band = np.zeros((tall + 2 * margin, N_THETA), np.bool_)
    band[margin : margin + tall] = True
    for first in range(first_row, a.z_mm.size - first_row - tall + 1, max(1, tall // 2)):
        around = slice(first - margin, first + tall + margin)
        bounds = float(a.z_mm[first]), float(a.z_mm[first + tall - 1])
        yield from _displaced("band", bounds, _rows(a, around), _within(_rows(b, around), band), look)


def _sectors(a: Evidence, b: Evidence, look: Look) -> Iterator[Part]:
    wide, step_rad = N_THETA // SECTORS, 2 * np.pi / N_THETA
    for first in range(0, N_THETA, wide // 2):
        sector = np.zeros(b.valid.shape, np.bool_)
        sector[:, np.arange(first, first + wide) % N_THETA] = True
        bounds = first * step_rad, (first + wide) * step_rad % (2 * np.pi)
        yield from _displaced("sector", bounds, a, _within(b, sector), look)


def _rows(evidence: Evidence, rows: slice) -> Evidence:
    return replace(evidence, values=evidence.values[rows], valid=evidence.valid[rows], z_mm=evidence.z_mm[rows])


def _within(evidence: Evidence, where: Mask) -> Evidence:
    return replace(evidence, valid=evidence.valid & where)


def _displaced(
    kind: Literal["band", "sector"], bounds: tuple[float, float], a: Evidence, part: Evidence, look: Look
) -> Iterator[Part]:
    """Yield where ``part`` of B fits ``a`` best, unless nothing in it says so."""
    rows, columns = round(look.reach_mm / STEP_MM), round(look.reach_rad / (2 * np.pi) * N_THETA)
    correlation = _correlations(a, part, rows, columns)
    row, column = map(int, np.unravel_index(int(np.argmax(correlation)), correlation.shape))
    best, here = float(correlation[row, column]), float(correlation[rows, columns])
    if best >= look.clear and best - here >= look.better:
        around_mm = (column - columns) * 2 * np.pi / N_THETA * a.radius_mm
        yield Part(kind, *bounds, (row - rows) * STEP_MM, float(around_mm), (best, here))


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
