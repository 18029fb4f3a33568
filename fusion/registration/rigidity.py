"""Whether all parts of the wall lie where one rigid alignment puts them.

An alignment is rigid: one turn, one shift, one scale. A recording need not be: a catheter that slipped, slices that
were lost or swapped, a step within every turn bend its wall, and the best rigid place is then right for some of it
only. So parts of one side, bands along the bore and sectors of it, are each searched for on the other side around where
the alignment puts them: tall bands nearby in all directions, and low ones, as few slices are, far along the bore.

What a single part says by chance two parts do not say of each other: low bands that have changed places are believed
for less, and so are arcs of the bore that lie apart around it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from endoct.fusion.evidence.evidence import CLIP, Evidence, clipped
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.registration.displacement import (
    N_THETA,
    STEP_MM,
    Fit,
    fit_part,
    in_one_frame,
    part_of,
    rows_of,
)
from endoct.fusion.segmentation.regions import label

SECTORS = 4
FAR_MM = 0.16
"""Around the bore or along it: parts that lie farther from where they should are out of place."""


@dataclass(frozen=True)
class Look:
    """How parts are searched for: bands ``tall_mm`` high, or sectors of any height; how far along and around.

    A part says something about its place where it correlates by ``clear`` at least where it fits best, and by
    ``better`` more than where the alignment puts it. Bands follow each other by ``1 / dense`` of their height.
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
"""For a band with a single cell: cut by the band's edge, it fits elsewhere about as well. Of 6 sound bores with two to
four cells (benchmarks/independent, sparse 4000–4014) two had such a band, at a correlation of 0.57 and 0.69."""
EXCHANGED = Look(tall_mm=0.3, reach_mm=4.0, reach_rad=0.1, clear=0.5, better=0.15, dense=3)
"""Of 20 sound recordings of a second generator (benchmarks/independent, set sound, seeds 0–19) none has two bands in
each other's place that both correlate by more than 0.23; two or three slices exchanged correlate by 0.6."""
SAME_PLACE_MM = 0.16
"""Where one band belongs and where the other one is may differ by so much."""
APART = Look(tall_mm=np.inf, reach_mm=0.15, reach_rad=0.6, clear=0.55, better=0.03)
APART_MM = 0.1
"""Around the bore: arcs of 32 sound recordings (seeds 0–31) lie 0.074 mm apart at most; those of turns with a step of
0.15 rad 0.11 to 0.20 mm, of 0.2 rad 0.16 mm and more (10 recordings each)."""
FEWEST_IN_ARC = 2
LEAST_APART_MM = 0.5 * APART_MM
"""In either half of the bore by itself: a step is at every slice, single cells lie in one half or the other. Of 68 more
sound ones (1100–1143, 1200–1223) four, of four cells each, have arcs 0.10 to 0.19 mm apart, none in both halves."""
FARTHEST_MM = max(look.reach_mm for look in (NEAR, FAR, EXCHANGED))


@dataclass(frozen=True)
class Part:
    """A part of the wall that fits best elsewhere, ``along_mm`` and ``around_mm`` from where it should.

    ``kind``: a band along the bore, a sector of it, or ("turn") a sector that should lie where another one does;
    ``first`` and ``last`` its bounds in A's frame, mm or rad. ``correlation``: (there, where the alignment puts it).
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


def parts_out_of_place(a: Evidence, b: Evidence, alignment: Alignment) -> tuple[Part, ...]:
    """Return the parts of the wall that do not lie where ``alignment`` puts B on A, the farthest off first."""
    one, two = in_one_frame(clipped(a), clipped(b), alignment, FARTHEST_MM)
    parts = [
        *_displaced(_bands(one, two, NEAR), NEAR),
        *_displaced(_bands(one, two, FAR), FAR),
        *_displaced(_sectors(one, two, NEAR), NEAR),
        *_exchanged(list(_bands(one, two, EXCHANGED))),
        *_turned(one, two),
    ]
    return tuple(sorted((part for part in parts if part.off_mm > part.limit_mm), key=lambda part: -part.off_mm))


@dataclass(frozen=True)
class _Fitted:
    kind: Literal["band", "sector"]
    first: float
    last: float
    fit: Fit
    lone: bool = False  # whether it shows a single cell

    @property
    def part(self) -> Part:
        return Part(self.kind, self.first, self.last, self.fit.along_mm, self.fit.around_mm, self.fit.correlation)


def _bands(a: Evidence, b: Evidence, look: Look) -> Iterator[_Fitted]:
    margin, tall = round(look.reach_mm / STEP_MM), round(look.tall_mm / STEP_MM)
    first_row = round(FARTHEST_MM / STEP_MM)
    band = np.zeros((tall + 2 * margin, N_THETA), np.bool_)
    band[margin : margin + tall] = True
    for first in range(first_row, a.z_mm.size - first_row - tall + 1, max(1, tall // look.dense)):
        around = slice(first - margin, first + tall + margin)
        fit = fit_part(rows_of(a, around), part_of(rows_of(b, around), band), look.reach_mm, look.reach_rad)
        lone = any(_shows_one_cell(rows_of(each, slice(first, first + tall))) for each in (a, b))
        yield _Fitted("band", float(a.z_mm[first]), float(a.z_mm[first + tall - 1]), fit, lone)


def _sectors(a: Evidence, b: Evidence, look: Look) -> Iterator[_Fitted]:
    wide, step_rad = N_THETA // SECTORS, 2 * np.pi / N_THETA
    for first in range(0, N_THETA, wide // 2):
        sector = np.zeros(b.valid.shape, np.bool_)
        sector[:, np.arange(first, first + wide) % N_THETA] = True
        fit = fit_part(a, part_of(b, sector), look.reach_mm, look.reach_rad)
        yield _Fitted("sector", first * step_rad, (first + wide) * step_rad % (2 * np.pi), fit)


def _displaced(parts: Iterator[_Fitted], look: Look) -> Iterator[Part]:
    """Yield where parts fit best whose place each by itself is sure of."""
    for part in parts:
        if part.fit.stands_out(clear=LONE_CLEAR if part.lone else look.clear, gain=look.better):
            yield part.part


def _shows_one_cell(evidence: Evidence) -> bool:
    """Whether ``evidence`` that knows what a cell is has one, or none."""
    return evidence.knows_cells and label(evidence.valid & (evidence.values > CLIP[evidence.kind][1] / 2))[1] < 2


def _exchanged(bands: Sequence[_Fitted]) -> Iterator[Part]:
    """Yield bands each of which fits where the other one is."""
    sure = [band for band in bands if band.fit.stands_out(clear=EXCHANGED.clear, gain=EXCHANGED.better)]
    for one in sure:
        for two in sure:
            apart_mm = two.first - one.first
            there, back = one.fit.along_mm - apart_mm, two.fit.along_mm + apart_mm
            if apart_mm > EXCHANGED.tall_mm and max(abs(there), abs(back)) < SAME_PLACE_MM:
                yield one.part
                yield two.part


def _turned(a: Evidence, b: Evidence) -> Iterator[Part]:
    """Yield the surest sector of the smaller of the two arcs that lie farthest apart around the bore, by how far.

    A step turns whole arcs; one sector alone, which may hold a single cell, says little. Sectors across the step count
    too, so that it is rather larger. Where one half of the bore does not show it, it is none.
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
    """Yield ``evidence`` as if the one half along the bore, and the other, had been observed only."""
    rows = np.arange(evidence.z_mm.size)[:, None]
    observed = np.flatnonzero(evidence.valid.any(axis=1))
    middle = (observed[0] + observed[-1] + 1) / 2 if observed.size else 0
    yield part_of(evidence, rows < middle)
    yield part_of(evidence, rows >= middle)


def _clear(sectors: Iterator[_Fitted]) -> list[_Fitted]:
    return [sector for sector in sectors if sector.fit.correlation[0] >= APART.clear]


def _same(sectors: Sequence[_Fitted], which: Sequence[_Fitted]) -> list[_Fitted]:
    """Return those of ``sectors`` in the directions of ``which``."""
    return [sector for sector in sectors if sector.first in {one.first for one in which}]


def _apart_mm(arc: Sequence[_Fitted], rest: Sequence[_Fitted]) -> float:
    """Return how far around the bore ``arc`` lies from ``rest``, mm; 0 where one of them shows nothing."""
    return _around_mm(arc) - _around_mm(rest) if arc and rest else 0.0


def _around_mm(sectors: Sequence[_Fitted]) -> float:
    return float(np.mean([sector.fit.around_mm for sector in sectors]))
