"""Two panoramas of one bore in, one comparison out: aligned, segmented, scored on one grid."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import Field

from endoct.fusion.evidence.evidence import Evidence, Polarity, clipped
from endoct.fusion.evidence.prepare import MASK_MODALITY, prepare
from endoct.fusion.files.store import load_comparison, save_comparison
from endoct.fusion.geometry.alignment import as_covariance
from endoct.fusion.geometry.placement import IN_PLACE, Placement, check_same_bore, common_grid
from endoct.fusion.registration.align import BELIEVABLE, LIKELY_CHANCE, Alignment, NotAligned, align, open_orientations
from endoct.fusion.registration.twist import find_twist, untwisted
from endoct.fusion.result import Believable, CorrectedTwist, OwnRows, Result, StoredAlignment, Threshold
from endoct.fusion.scoring.cells import Surface
from endoct.fusion.scoring.overlap import overlap
from endoct.fusion.scoring.scores import BOOTSTRAP, Scored, score_sides
from endoct.fusion.scoring.sites import find_sites
from endoct.fusion.segmentation.segment import Segmentation, SegmentParameters, find_cells
from endoct.fusion.sides import Comparison
from endoct.stitching.arrays import Image, Mask
from endoct.stitching.panorama import Panorama

__all__ = ["CompareParameters", "Comparison", "compare_panoramas", "load_comparison", "save_comparison"]

FINEST_DZ_MM = 0.02


class CompareParameters(SegmentParameters):
    """How two sides are compared: the parameters of segmentation, and those of alignment and of the grid."""

    dz_mm: float | None = Field(
        default=None,
        ge=1e-4,
        le=10,
        description="row distance of the common grid; left out, the finer side's, not under 0.02 mm",
    )
    n_theta: int = Field(default=2048, ge=16, le=65536, description="columns of the common grid")
    z_scale_min: float = Field(default=0.95, gt=0.5, le=1, description="least scale of B's z against A's to search")
    z_scale_max: float = Field(default=1.05, ge=1, lt=2, description="largest scale of B's z against A's to search")
    polarity: Literal["auto", "dark", "bright"] = Field(
        default="auto", description="how cells look to a side without depth; auto: by its correlation with the other"
    )
    tolerance_mm: float = Field(
        default=0.1, ge=1e-4, le=10, description="outlines nearer to each other than this count as one"
    )
    force: bool = Field(default=False, description="believe the best alignment however little it stands out")
    correct_twist: bool = Field(
        default=False, description="turn B's rows to where they fit A best; raises the score, so that both are given"
    )


def compare_panoramas(a: Panorama, b: Panorama, parameters: CompareParameters | None = None) -> Comparison:
    """Align ``b`` to ``a``, segment each on its own samples, bring both to one grid and score them.

    Where no alignment stands out, ``alignment`` is None and ``reason`` says why; B is then placed by its nominal
    orientation and nothing is scored.

    Raises :class:`EndoctError` where the bore diameters differ, a side has nothing valid, or shows no cells.
    """
    parameters = parameters or CompareParameters()
    plain = _compared(a, b, parameters)
    if not parameters.correct_twist or plain.alignment is None:
        return plain
    twist = find_twist(a, b, (prepare(a), prepare(b)), plain.alignment)
    corrected = _compared(a, untwisted(b, twist), parameters)
    stated = CorrectedTwist(
        note="B's rows were turned to where they fit A best. That raises the score by itself; see both.",
        z_mm=tuple(twist.z_mm.tolist()),
        twist_rad=tuple(twist.twist_rad.tolist()),
        known=tuple(twist.known.tolist()),
        jaccard_without=plain.result.jaccard,
        jaccard_with=corrected.result.jaccard,
    )
    return replace(corrected, result=corrected.result.model_copy(update={"twist": stated}))


def _compared(a: Panorama, b: Panorama, parameters: CompareParameters) -> Comparison:
    check_same_bore(a.grid.radius_mm, b.grid.radius_mm)
    evidence = prepare(a), prepare(b)
    found = _align(a, b, evidence, parameters)
    alignment = found if isinstance(found, Alignment) else None
    told = _segment((a, b), evidence, alignment, parameters)
    placing = alignment or IN_PLACE
    finer_mm = min(a.grid.dz_mm, placing.z_scale * b.grid.dz_mm)
    grid = common_grid(a, b, placing, dz_mm=parameters.dz_mm or max(finer_mm, FINEST_DZ_MM), n_theta=parameters.n_theta)
    shape = (2, *grid.shape)
    intensity, depth_mm = np.zeros(shape, np.float32), np.full(shape, np.nan, np.float32)
    mask, valid = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    names = _names(a, b)
    surfaces = []
    for k, (side, where) in enumerate(((a, IN_PLACE), (b, placing))):
        placement = Placement(side, where, grid, grid.z_mm, grid.dz_mm)
        intensity[k], valid[k] = placement.image(side.intensity, side.valid)
        mask[k], _ = placement.mask(told[k].segmentation.mask, side.valid)
        if side.depth_mm is not None:
            depth_mm[k] = _known(placement, side.depth_mm, side.valid & np.isfinite(side.depth_mm))
        relief_mm, contrast = (None if e is None else _known(placement, e.values, e.valid) for e in told[k].shown)
        surfaces.append(Surface(names[k], mask[k], valid[k], relief_mm, contrast))
    scored = score_sides((a, b), (surfaces[0], surfaces[1]), grid, alignment, parameters.tolerance_mm)
    own_rows = _on_own_rows(a, b, told, placing) if alignment else None
    reason = found.reason if isinstance(found, NotAligned) else None
    doubts = {name: _doubts(side, of_side) for name, side, of_side in zip(names, (a, b), told, strict=True)}
    result = _result(names, found, told, scored, own_rows, valid, grid.dz_mm, doubts)
    return Comparison(grid, names, intensity, depth_mm, mask, valid, alignment, reason, result, scored.cells)


def _known(placement: Placement, image: Image, valid: Mask) -> Image:
    """Return ``image`` placed, NaN where unknown."""
    values, known = placement.image(image, valid)
    return np.where(known, values, np.float32(np.nan))


def _align(
    a: Panorama, b: Panorama, evidence: tuple[Evidence, Evidence], parameters: CompareParameters
) -> Alignment | NotAligned:
    if _drawn_on(a, b) or _drawn_on(b, a):
        exact = as_covariance(np.zeros((3, 3)))
        return replace(IN_PLACE, confidence=1.0, correlation=_correlation(*evidence), covariance=exact)
    orientations = open_orientations(
        handedness_known=a.handedness_known and b.handedness_known, travel_known=a.travel_known and b.travel_known
    )
    z_scale_range = parameters.z_scale_min, parameters.z_scale_max
    return align(*evidence, orientations=orientations, z_scale_range=z_scale_range, force=parameters.force)


def _drawn_on(one: Panorama, other: Panorama) -> bool:
    """Say whether ``one`` is a mask drawn on the samples of ``other``, and so needs no alignment."""
    drawn = one.modality == MASK_MODALITY and bool(one.provenance.get("drawn_on_other_side"))
    return drawn and one.grid == other.grid


@dataclass(frozen=True, eq=False)
class _Told:
    """One side's cells, what told whether they are dark or bright, and what is known of (relief, contrast)."""

    segmentation: Segmentation
    polarity_from: str | None
    shown: tuple[Evidence | None, Evidence | None]


def _segment(
    sides: tuple[Panorama, Panorama],
    evidence: tuple[Evidence, Evidence],
    alignment: Alignment | None,
    parameters: CompareParameters,
) -> tuple[_Told, _Told]:
    """Find each side's cells on its own samples."""
    a, b = (_segment_side(sides[k], evidence[k], evidence[1 - k], alignment, parameters, first=k == 0) for k in (0, 1))
    return a, b


def _segment_side(
    side: Panorama,
    own: Evidence,
    other: Evidence,
    alignment: Alignment | None,
    parameters: CompareParameters,
    *,
    first: bool,
) -> _Told:
    """Find one side's cells.

    Whether they are dark or bright is the sign of the correlation with what knows: the other side, if it has depth
    or is a mask, or the side's own relief. Where nothing knows, A's cells are dark, and B's as the two correlate.
    """
    shown = own if parameters.segment == "relief" or own.kind == "mask" else prepare(side, prefer="intensity")
    relief = own if own.kind == "relief" else None
    if shown.knows_cells:
        return _Told(find_cells(shown, parameters), None, (relief, None))
    if parameters.polarity != "auto":
        polarity: Polarity = parameters.polarity
        told_by = "given"
    elif own.kind == "relief":
        polarity = "bright" if _correlation(own, shown) < 0 else "dark"
        told_by = "correlation with its own relief"
    elif alignment is not None and (other.knows_cells or not first):
        polarity = "bright" if alignment.correlation < 0 else "dark"
        told_by = f"correlation with the other side's {other.kind}"
    else:
        polarity, told_by = "dark", "assumed"
    if polarity == "bright":
        shown = prepare(side, prefer="intensity", polarity="bright")
    return _Told(find_cells(shown, parameters), told_by, (relief, shown))


def _correlation(one: Evidence, other: Evidence) -> float:
    """Return the correlation of two kinds of evidence on the same samples, 0 where one of them is constant."""
    both = one.valid & other.valid
    if both.sum() < 2:
        return 0.0
    (of_one, common), (_, of_other) = np.cov(clipped(one).values[both], clipped(other).values[both])
    return float(common / np.sqrt(of_one * of_other)) if of_one > 0 and of_other > 0 else 0.0


def _on_own_rows(a: Panorama, b: Panorama, told: tuple[_Told, _Told], alignment: Alignment) -> OwnRows:
    """Return the overlap on B's own samples, to which A is brought; B is not interpolated at all."""
    placement = Placement(a, alignment.inverse(), b.grid, b.z_mm, b.grid.dz_mm)
    mask, seen = placement.mask(told[0].segmentation.mask, a.valid)
    one, two = Surface("", mask, seen), Surface("", told[1].segmentation.mask, b.valid)
    sites = find_sites(mask, two.mask, seen & b.valid, b.grid.dz_mm * b.grid.dtheta_mm)
    return OwnRows(rows_of=_names(a, b)[1], **dict(overlap(one, two, sites)))


def _reached(valid: Mask) -> Mask:
    """Return the rows from the first to the last that a side saw anything of, bool (n_z,)."""
    rows = np.flatnonzero(valid.any(axis=1))
    reached = np.zeros(valid.shape[0], np.bool_)
    if rows.size:
        reached[rows[0] : rows[-1] + 1] = True
    return reached


def _names(a: Panorama, b: Panorama) -> tuple[str, str]:
    if a.modality != b.modality:
        return a.modality, b.modality
    return f"{a.modality}-1", f"{b.modality}-2"


def _doubts(side: Panorama, told: _Told) -> tuple[str, ...]:
    """Return why a side's panorama as a whole, or its cells, are not to be trusted."""
    doubt = told.segmentation.doubt
    return (*side.doubts, *([doubt] if doubt else []))


def _result(
    names: tuple[str, str],
    found: Alignment | NotAligned,
    told: tuple[_Told, _Told],
    scored: Scored,
    own_rows: OwnRows | None,
    valid: Mask,
    dz_mm: float,
    doubts: dict[str, tuple[str, ...]],
) -> Result:
    aligned = isinstance(found, Alignment)
    by_name = dict(zip(names, told, strict=True))
    segmented = {name: side.segmentation for name, side in by_name.items()}
    covered = _reached(valid[0]) & _reached(valid[1])
    both = valid[0] & valid[1]
    return Result(
        sides=names,
        aligned=aligned,
        reason=None if isinstance(found, Alignment) else found.reason,
        alignment=StoredAlignment.of(found) if isinstance(found, Alignment) else None,
        believed_if=Believable(confidence_at_least=BELIEVABLE, chance_at_most=LIKELY_CHANCE),
        best_unbelieved=None if isinstance(found, Alignment) else StoredAlignment.of(found.best),
        jaccard=scored.scores.grid.jaccard if scored.scores else None,
        dice=scored.scores.grid.dice if scored.scores else None,
        threshold={n: Threshold(value=s.threshold, unit=s.unit, of=s.of) for n, s in segmented.items()},
        polarity={name: side.polarity for name, side in segmented.items()},
        polarity_from={name: side.polarity_from for name, side in by_name.items()},
        scores=scored.scores.model_copy(update={"own_rows": own_rows}) if scored.scores else None,
        budget=scored.budget,
        bootstrap=BOOTSTRAP,
        valid_fraction=float(both[covered].mean()) if covered.any() else 0.0,
        overlap_mm=float(covered.sum()) * dz_mm,
        doubts=doubts,
    )
