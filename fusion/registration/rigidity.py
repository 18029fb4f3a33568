"""Whether all parts of the wall lie where one rigid alignment puts them, and where they fit best.

An alignment is rigid: one turn, one shift, one scale. A recording need not be. A catheter that slipped, slices that
were lost or swapped, or a step within every turn bend its wall. The best rigid place is then right for some of it
only. So parts of one side are each searched for on the other side, around where the alignment puts them. Parts are
bands along the bore and sectors of it. Tall bands are searched for nearby, in all directions. Low ones, which are few
slices, are searched for far along the bore.

A single part may fit elsewhere by chance; that two parts agree on it is hardly chance. So low bands that have
changed places are believed for less, and so are arcs of the bore that lie apart around it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import vertex
from endoct.base.numeric.regions import label
from endoct.fusion.evidence.evidence import CLIP, Evidence, clipped, on_grid, reoriented
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import rolled

Spectra = NDArray[np.complex128]

STEP_MM = 0.05
N_THETA = 256
LEAST_SAMPLES = 0.5
"""Share of a part's samples that must meet observed wall wherever it is compared."""
SECTORS = 4
FAR_MM = 0.16
"""A part that lies farther off than this, around the bore or along it, is out of place."""
SAME_PLACE_MM = 0.16
"""How far the place where a band fits may be from that of the other band, for the two to have changed places."""
APART_MM = 0.1
"""Arcs that lie farther apart around the bore were turned. Those of 32 sound recordings (seeds 0–31) lie 0.074 mm apart
at most. Those of turns with a step of 0.15 rad lie 0.11 to 0.20 mm apart, of 0.2 rad 0.16 mm and more (10 each)."""
FEWEST_IN_ARC = 2
LEAST_APART_MM = 0.5 * APART_MM
"""The least distance in either half of the bore by itself: a step is at every slice, but single cells lie in one half.
Four of 68 more sound recordings (1100–1143, 1200–1223), with four cells each, have arcs 0.10 to 0.19 mm apart. None has
them in both halves."""


@dataclass(frozen=True)
class PartFit:
    """Where a part fits best, ``along_mm`` and ``around_mm`` from where the alignment puts it, and how it correlates.

    ``around_mm`` is known to a fraction of a sample, ``along_mm`` with ``between_mm`` added. ``correlation`` is that
    there, and that where the alignment puts the part.
    """

    along_mm: float
    around_mm: float
    correlation: tuple[float, float]
    between_mm: float = 0.0

    @property
    def gain(self) -> float:
        """How much better it correlates there."""
        return self.correlation[0] - self.correlation[1]

    def stands_out(self, *, clear: float, gain: float) -> bool:
        """Return whether it correlates by ``clear`` at least, and by ``gain`` more than where the alignment puts it."""
        return self.correlation[0] >= clear and self.gain >= gain


def in_one_frame(a: Evidence, b: Evidence, alignment: Alignment, margin_mm: float) -> tuple[Evidence, Evidence]:
    """Return both on one even grid in A's frame, where B lies as aligned, over rows that both have.

    The grid has ``margin_mm`` more at either end, where nothing needs to be observed.
    """
    if alignment.bend is not None:
        roll_rad = alignment.roll_rad(b.z_mm) * (-1.0 if alignment.mirrored else 1.0)
        values, valid = rolled(b.values, b.valid, roll_rad * b.values.shape[1] / (2 * np.pi))
        b = replace(b, values=values, valid=valid)
    moved = reoriented(b, mirrored=alignment.mirrored, z_reversed=alignment.z_reversed, z_scale=alignment.z_scale)
    z_mm = np.sort(alignment.z_to_a(b.z_mm)) if alignment.bend else moved.z_mm + alignment.z_shift_mm
    moved = replace(moved, z_mm=z_mm, theta0_rad=moved.theta0_rad + alignment.theta_shift_rad)
    first = max(a.z_mm[0], moved.z_mm[0]) - margin_mm
    last = min(a.z_mm[-1], moved.z_mm[-1]) + margin_mm
    z_mm = np.arange(first, last, STEP_MM)
    return on_grid(a, z_mm, N_THETA), on_grid(moved, z_mm, N_THETA)


def rows_of(evidence: Evidence, rows: slice) -> Evidence:
    """Return some rows of ``evidence``."""
    return replace(evidence, values=evidence.values[rows], valid=evidence.valid[rows], z_mm=evidence.z_mm[rows])


def part_of(evidence: Evidence, where: Mask) -> Evidence:
    """Return ``evidence`` as if it had been observed only ``where``, bool of its shape."""
    return replace(evidence, valid=evidence.valid & where)


def fit_part(a: Evidence, part: Evidence, reach_mm: float, reach_rad: float) -> PartFit:
    """Return where ``part`` fits ``a`` best, both on one grid, within ``reach_mm`` along and ``reach_rad`` around."""
    rows, columns = round(reach_mm / STEP_MM), round(reach_rad / (2 * np.pi) * N_THETA)
    correlation = _correlations(a, part, rows, columns)
    row, column = map(int, np.unravel_index(int(np.argmax(correlation)), correlation.shape))
    best, here = float(correlation[row, column]), float(correlation[rows, columns])
    three = correlation[row, max(0, column - 1) : column + 2]
    around = column - columns + float(vertex(*three) if three.size == 3 else 0.0)
    three = correlation[max(0, row - 1) : row + 2, column]
    between = float(vertex(*three) if three.size == 3 else 0.0) * STEP_MM
    return PartFit((row - rows) * STEP_MM, float(around * 2 * np.pi / N_THETA * a.radius_mm), (best, here), between)


def _correlations(a: Evidence, b: Evidence, rows: int, columns: int) -> Coordinates:
    """Return the masked correlation of ``b`` with ``a``, (2 rows + 1, 2 columns + 1), by how far ``b`` is moved.

    After Padfield 2012, Masked object registration in the Fourier domain, but along θ alone, since parts are few rows
    high and moved by few columns. It is cyclic in θ; rows moved beyond either end meet nothing.
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
    """The matrix that takes a spectrum of real samples back to those at −``columns`` … ``columns``."""
    k, column = np.arange(N_THETA // 2 + 1)[:, None], np.arange(-columns, columns + 1)
    weight = np.where((k == 0) | (k == N_THETA // 2), 1, 2) / N_THETA
    return np.asarray(weight * np.exp(2j * np.pi * k * column / N_THETA))


@compiled
def _moved_along(of_a: Spectra, of_b: Spectra, first: int, rows: int) -> Spectra:
    """Sums of the rows of A times those of B, which begin at A's row ``first``, moved by −``rows`` … ``rows``.

    They are (6, 2 rows + 1, n): of observed × observed, values × observed, observed × values, values × values,
    squares × observed, observed × squares.
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


@dataclass(frozen=True)
class Look:
    """How parts are searched for: bands ``tall_mm`` high, or sectors of any height; how far along and around.

    A part says something about its place if, where it fits best, it correlates by ``clear`` at least. It must also
    correlate by ``better`` more than where the alignment puts it. Bands follow each other by ``1 / dense`` of their
    height.
    """

    tall_mm: float
    reach_mm: float
    reach_rad: float
    clear: float
    better: float
    dense: int = 2


NEAR = Look(tall_mm=1.5, reach_mm=1.0, reach_rad=0.6, clear=0.55, better=0.2)
FAR = Look(tall_mm=0.6, reach_mm=4.0, reach_rad=0.1, clear=0.75, better=0.45)
LONE_CLEAR = FAR.clear
"""``clear`` for a band with a single cell: cut by the band's edge, it fits elsewhere about as well. Two of 6 sound
bores with two to four cells had such a band, which correlated by 0.57 and 0.69 (benchmarks/independent, sparse
4000–4014)."""
EXCHANGED = Look(tall_mm=0.3, reach_mm=4.0, reach_rad=0.1, clear=0.5, better=0.15, dense=3)
"""How bands in each other's place are searched for. Two or three slices that were exchanged correlate by 0.6. None of
20 sound recordings has two such bands that both correlate by more than 0.23 (benchmarks/independent, set sound, seeds
0–19)."""
APART = Look(tall_mm=np.inf, reach_mm=0.15, reach_rad=0.6, clear=0.55, better=0.03)
FARTHEST_MM = max(look.reach_mm for look in (NEAR, FAR, EXCHANGED))


@dataclass(frozen=True)
class LoosePart:
    """A part of the wall that fits best elsewhere, ``along_mm`` and ``around_mm`` from where it should.

    Attributes
    ----------
    kind: a band along the bore, a sector of it, or ("turn") a sector that should lie where another one does.
    first, last: its bounds in A's frame, mm or rad.
    correlation: that where it fits best, and that where the alignment puts it.
    """

    kind: Literal["band", "sector", "turn"]
    first: float
    last: float
    along_mm: float
    around_mm: float
    correlation: tuple[float, float]

    @property
    def limit_mm(self) -> float:
        """How far off it may be, mm."""
        return APART_MM if self.kind == "turn" else FAR_MM

    @property
    def off_mm(self) -> float:
        """How far out of place it is, mm."""
        return float(np.hypot(self.along_mm, self.around_mm))


def parts_out_of_place(a: Evidence, b: Evidence, alignment: Alignment) -> tuple[LoosePart, ...]:
    """Return the parts of the wall that do not lie where ``alignment`` puts B on A, the farthest off first."""
    one, two = in_one_frame(clipped(a), clipped(b), alignment, FARTHEST_MM)
    parts = [
        *_displaced(bands(one, two, NEAR), NEAR, (one, two)),
        *_displaced(bands(one, two, FAR), FAR, (one, two)),
        *_displaced(_sectors(one, two, NEAR), NEAR, (one, two)),
        *_exchanged(list(bands(one, two, EXCHANGED))),
        *_turned(one, two),
    ]
    return tuple(sorted((part for part in parts if part.off_mm > part.limit_mm), key=lambda part: -part.off_mm))


@dataclass(frozen=True)
class FittedPart:
    """A band or a sector from ``first`` to ``last``, mm or rad in A's frame, with where it fits best."""

    kind: Literal["band", "sector"]
    first: float
    last: float
    fit: PartFit

    @property
    def part(self) -> LoosePart:
        """It, as a part of the wall that fits best elsewhere."""
        return LoosePart(self.kind, self.first, self.last, self.fit.along_mm, self.fit.around_mm, self.fit.correlation)


def bands(a: Evidence, b: Evidence, look: Look) -> Iterator[FittedPart]:
    """Yield where each band of ``b`` fits ``a`` best, both as :func:`in_one_frame` returns them."""
    margin, tall = round(look.reach_mm / STEP_MM), round(look.tall_mm / STEP_MM)
    first_row = round(FARTHEST_MM / STEP_MM)
    band = np.zeros((tall + 2 * margin, N_THETA), np.bool_)
    band[margin : margin + tall] = True
    for first in range(first_row, a.z_mm.size - first_row - tall + 1, max(1, tall // look.dense)):
        around = slice(first - margin, first + tall + margin)
        fit = fit_part(rows_of(a, around), part_of(rows_of(b, around), band), look.reach_mm, look.reach_rad)
        yield FittedPart("band", float(a.z_mm[first]), float(a.z_mm[first + tall - 1]), fit)


def _sectors(a: Evidence, b: Evidence, look: Look) -> Iterator[FittedPart]:
    wide, step_rad = N_THETA // SECTORS, 2 * np.pi / N_THETA
    for first in range(0, N_THETA, wide // 2):
        sector = np.zeros(b.valid.shape, np.bool_)
        sector[:, np.arange(first, first + wide) % N_THETA] = True
        fit = fit_part(a, part_of(b, sector), look.reach_mm, look.reach_rad)
        yield FittedPart("sector", first * step_rad, (first + wide) * step_rad % (2 * np.pi), fit)


def _displaced(parts: Iterator[FittedPart], look: Look, both: tuple[Evidence, Evidence]) -> Iterator[LoosePart]:
    """Yield the parts that are sure of their place, each by itself, and fit best elsewhere."""
    for part in parts:
        is_sure = part.fit.stands_out(clear=look.clear, gain=look.better)
        if is_sure and (part.fit.correlation[0] >= LONE_CLEAR or not any(_shows_one_cell(part, each) for each in both)):
            yield part.part


def _shows_one_cell(part: FittedPart, evidence: Evidence) -> bool:
    """Whether a band of ``evidence`` that knows what a cell is has one, or none."""
    if part.kind != "band" or not evidence.knows_cells:
        return False
    first, last = np.searchsorted(evidence.z_mm, (part.first, part.last))
    rows = rows_of(evidence, slice(int(first), int(last) + 1))
    return label(rows.valid & (rows.values > CLIP[rows.kind][1] / 2))[1] < 2


def _exchanged(bands: Sequence[FittedPart]) -> Iterator[LoosePart]:
    """Yield pairs of bands each of which fits where the other one is."""
    sure = [band for band in bands if band.fit.stands_out(clear=EXCHANGED.clear, gain=EXCHANGED.better)]
    for one in sure:
        for two in sure:
            apart_mm = two.first - one.first
            there, back = one.fit.along_mm - apart_mm, two.fit.along_mm + apart_mm
            if apart_mm > EXCHANGED.tall_mm and max(abs(there), abs(back)) < SAME_PLACE_MM:
                yield one.part
                yield two.part


def _turned(a: Evidence, b: Evidence) -> Iterator[LoosePart]:
    """Yield the surest sector of the smaller of the two arcs that lie farthest apart around the bore, and how far.

    A step turns whole arcs; one sector alone, which may hold a single cell, says little. Sectors across the step count
    too, so the step is rather larger. There is none where one half of the bore does not show it.
    """
    clear = _clear(_sectors(a, b, APART))
    arcs = []
    for start in range(len(clear)):
        around = clear[start:] + clear[:start]
        arcs += [(around[:n], around[n:]) for n in range(FEWEST_IN_ARC, len(clear) // 2 + 1)]
    if not arcs:
        return
    arc, rest = max(arcs, key=lambda both: abs(_apart_mm(*both)))
    apart_mm = _apart_mm(arc, rest)
    if abs(apart_mm) <= APART_MM or max(sector.fit.gain for sector in clear) < APART.better:
        return
    halves = [_clear(_sectors(a, half, APART)) for half in _halves(b)]
    if all(_apart_mm(_same(half, arc), _same(half, rest)) * np.sign(apart_mm) > LEAST_APART_MM for half in halves):
        surest = max(arc, key=lambda sector: sector.fit.gain)
        yield replace(surest.part, kind="turn", along_mm=0.0, around_mm=apart_mm)


def _halves(evidence: Evidence) -> Iterator[Evidence]:
    """Yield ``evidence`` as if only the first half along the bore had been observed, then as if only the second."""
    rows = np.arange(evidence.z_mm.size)[:, None]
    observed = np.flatnonzero(evidence.valid.any(axis=1))
    middle = (observed[0] + observed[-1] + 1) / 2 if observed.size else 0
    yield part_of(evidence, rows < middle)
    yield part_of(evidence, rows >= middle)


def _clear(sectors: Iterator[FittedPart]) -> list[FittedPart]:
    return [sector for sector in sectors if sector.fit.correlation[0] >= APART.clear]


def _same(sectors: Sequence[FittedPart], which: Sequence[FittedPart]) -> list[FittedPart]:
    """Return those of ``sectors`` in the directions of ``which``."""
    return [sector for sector in sectors if sector.first in {one.first for one in which}]


def _apart_mm(arc: Sequence[FittedPart], rest: Sequence[FittedPart]) -> float:
    """Return how far around the bore ``arc`` lies from ``rest``, mm; 0 where one of them shows nothing."""
    return _around_mm(arc) - _around_mm(rest) if arc and rest else 0.0


def _around_mm(sectors: Sequence[FittedPart]) -> float:
    return float(np.mean([sector.fit.around_mm for sector in sectors]))
