"""endoct's comparison of a pair, in the judge's terms."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.independent.bore import Floats
from benchmarks.independent.judge import Wall
from benchmarks.independent.truth import Place
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import doubts_of_side, segment_side
from endoct.fusion.sides import Comparison, PlacedSide
from endoct.workbench import compare, unroll


@dataclass(frozen=True, eq=False)
class Answer:
    """What a chain answered: both walls, where the OCT's lies in the endoscope's, and what it says of itself."""

    endoscope: Wall
    oct: Wall
    oct_in_endoscope: Place | None
    covariance: Floats | None = None
    alignment_share: float | None = None
    doubts: tuple[str, ...] = ()
    reason: str = ""


def endoct_answer(folder: Path) -> Answer:
    """Return endoct's answer to a written pair. Raises EndoctError where it has none."""
    comparison = compare(folder / "endoscope", folder / "oct", progress=False)
    endoscope, oct_ = (_wall(side) for side in comparison.sides)
    alignment, budget = comparison.alignment, comparison.result.budget
    place = covariance = None
    if alignment is not None:
        a = alignment
        place = Place(a.theta_shift_rad, a.z_shift_mm, a.z_scale, a.mirrored, a.z_reversed)
        covariance = None if a.covariance is None else np.array(a.covariance)
    return Answer(
        endoscope,
        oct_,
        place,
        covariance,
        None if budget is None else budget.parts.alignment.share,
        _doubts(comparison),
        comparison.reason or "",
    )


def endoct_oct(folder: Path) -> tuple[Wall, tuple[str, ...]]:
    """Return endoct's wall and cells by a pullback alone, and the codes of its doubts."""
    panorama = unroll(folder, progress=False)
    side = Side(panorama.modality, panorama)
    cells = segment_side(side, SegmentParameters(), "dark")
    return _wall_of(side, cells), tuple(doubt.code for doubt in doubts_of_side(side, cells))


def _wall(side: PlacedSide) -> Wall:
    if side.source is None or side.cells is None:
        raise ValueError("a comparison at hand has its sides' own samples")
    return _wall_of(side.source, side.cells)


def _wall_of(side: Side, cells: Segmentation) -> Wall:
    panorama = side.panorama
    return Wall(
        panorama.intensity,
        cells.mask,
        panorama.valid,
        panorama.grid.z_mm,
        panorama.grid.theta_rad,
        panorama.depth_mm,
    )


def _doubts(comparison: Comparison) -> tuple[str, ...]:
    """Return every doubt as "side: code"; where doubts have no code yet, their first words stand for it."""
    stated: object = comparison.result.doubts
    if isinstance(stated, dict):
        return tuple(f"{side}: {' '.join(text.split()[:4])}" for side, texts in stated.items() for text in texts)
    listed = stated if isinstance(stated, list | tuple) else ()
    return tuple(f"{getattr(doubt, 'side', None) or 'both'}: {getattr(doubt, 'code', doubt)}" for doubt in listed)
