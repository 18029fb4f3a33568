"""Two panoramas of one bore in, one comparison out: aligned, segmented, scored on one grid."""

from dataclasses import asdict, replace
from typing import Any, Literal

import numpy as np
from pydantic import Field

from endoct.fusion.alignment import Alignment, NotAligned, align, open_orientations
from endoct.fusion.cells import Segmentation, SegmentParameters, find_cells
from endoct.fusion.evidence import Evidence, Polarity, clipped
from endoct.fusion.outcome import Comparison
from endoct.fusion.placement import IN_PLACE, Placement, check_same_bore, common_grid
from endoct.fusion.prepare import MASK_MODALITY, prepare
from endoct.fusion.scores import Agreement, agreement
from endoct.fusion.store import load_comparison, save_comparison
from endoct.stitching.arrays import Mask
from endoct.stitching.panorama import Panorama

__all__ = ["CompareParameters", "Comparison", "compare_panoramas", "load_comparison", "save_comparison"]

FINEST_DZ_MM = 0.02


class CompareParameters(SegmentParameters):
    """How two sides are compared: the parameters of segmentation, and those of alignment and of the grid."""

    dz_mm: float | None = Field(
        default=None, gt=0, description="row distance of the common grid; left out, the finer side's, not under 0.02 mm"
    )
    n_theta: int = Field(default=2048, ge=16, description="columns of the common grid")
    z_scale_min: float = Field(default=0.95, gt=0.5, le=1, description="least scale of B's z against A's to search")
    z_scale_max: float = Field(default=1.05, ge=1, lt=2, description="largest scale of B's z against A's to search")
    polarity: Literal["auto", "dark", "bright"] = Field(
        default="auto", description="how cells look to a side without depth; auto: by its correlation with the other"
    )
    force: bool = Field(default=False, description="believe the best alignment however little it stands out")


def compare_panoramas(a: Panorama, b: Panorama, parameters: CompareParameters | None = None) -> Comparison:
    """Align ``b`` to ``a``, segment each on its own samples, bring both to one grid and score them.

    Where no alignment stands out, ``alignment`` is None and ``reason`` says why; B is then placed by its nominal
    orientation and nothing is scored.

    Raises :class:`EndoctError` where the bore diameters differ, a side has nothing valid, or shows no cells.
    """
    parameters = parameters or CompareParameters()
    check_same_bore(a.grid.radius_mm, b.grid.radius_mm)
    evidence = prepare(a), prepare(b)
    found = _align(a, b, evidence, parameters)
    alignment = found if isinstance(found, Alignment) else None
    (cells_a, told_a), (cells_b, told_b) = _segment((a, b), evidence, alignment, parameters)
    segmented = cells_a, cells_b
    placing = alignment or IN_PLACE
    finer_mm = min(a.grid.dz_mm, placing.z_scale * b.grid.dz_mm)
    grid = common_grid(a, b, placing, dz_mm=parameters.dz_mm or max(finer_mm, FINEST_DZ_MM), n_theta=parameters.n_theta)
    shape = (2, *grid.shape)
    intensity, depth_mm = np.zeros(shape, np.float32), np.full(shape, np.nan, np.float32)
    mask, valid = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    for k, (side, where) in enumerate(((a, IN_PLACE), (b, placing))):
        placement = Placement(side, where, grid, grid.z_mm, grid.dz_mm)
        intensity[k], valid[k] = placement.image(side.intensity, side.valid)
        mask[k], _ = placement.mask(segmented[k].mask, side.valid)
        if side.depth_mm is not None:
            depth, known = placement.image(side.depth_mm, side.valid & np.isfinite(side.depth_mm))
            depth_mm[k] = np.where(known, depth, np.nan)
    names = _names(a, b)
    on_grid = agreement(mask[0], mask[1], valid[0] & valid[1], grid.dz_mm * grid.dtheta_mm)
    own_rows = _on_own_rows(a, b, segmented, placing)
    reason = found.reason if isinstance(found, NotAligned) else None
    result = _result(names, found, segmented, (told_a, told_b), (on_grid, own_rows), valid, grid.dz_mm)
    return Comparison(grid, names, intensity, depth_mm, mask, valid, alignment, reason, result)


def _align(
    a: Panorama, b: Panorama, evidence: tuple[Evidence, Evidence], parameters: CompareParameters
) -> Alignment | NotAligned:
    if _drawn_on(a, b) or _drawn_on(b, a):
        return replace(IN_PLACE, confidence=1.0, correlation=_correlation(*evidence))
    orientations = open_orientations(
        handedness_known=a.handedness_known and b.handedness_known, travel_known=a.travel_known and b.travel_known
    )
    z_scale_range = parameters.z_scale_min, parameters.z_scale_max
    return align(*evidence, orientations=orientations, z_scale_range=z_scale_range, force=parameters.force)


def _drawn_on(one: Panorama, other: Panorama) -> bool:
    """Say whether ``one`` is a mask drawn on the samples of ``other``, and so needs no alignment."""
    drawn = one.modality == MASK_MODALITY and bool(one.provenance.get("drawn_on_other_side"))
    return drawn and one.grid == other.grid and np.array_equal(one.z_mm, other.z_mm)


def _segment(
    sides: tuple[Panorama, Panorama],
    evidence: tuple[Evidence, Evidence],
    alignment: Alignment | None,
    parameters: CompareParameters,
) -> tuple[tuple[Segmentation, str | None], tuple[Segmentation, str | None]]:
    """Find each side's cells on its own samples; with each, what told whether they are dark or bright."""
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
) -> tuple[Segmentation, str | None]:
    """Find one side's cells.

    Whether they are dark or bright is the sign of the correlation with what knows: the other side, if it has depth
    or is a mask, or the side's own relief. Where nothing knows, A's cells are dark, and B's as the two correlate.
    """
    shown = own if parameters.segment == "relief" or own.kind == "mask" else prepare(side, prefer="intensity")
    if shown.knows_cells:
        return find_cells(shown, parameters), None
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
    return find_cells(shown, parameters), told_by


def _correlation(one: Evidence, other: Evidence) -> float:
    """Return the correlation of two kinds of evidence on the same samples, 0 where one of them is constant."""
    both = one.valid & other.valid
    if both.sum() < 2:
        return 0.0
    (of_one, common), (_, of_other) = np.cov(clipped(one).values[both], clipped(other).values[both])
    return float(common / np.sqrt(of_one * of_other)) if of_one > 0 and of_other > 0 else 0.0


def _on_own_rows(
    a: Panorama, b: Panorama, segmented: tuple[Segmentation, Segmentation], alignment: Alignment
) -> Agreement:
    """Return the agreement on B's own samples, to which A is brought; B is not interpolated at all."""
    placement = Placement(a, alignment.inverse(), b.grid, b.z_mm, b.grid.dz_mm)
    mask, seen = placement.mask(segmented[0].mask, a.valid)
    return agreement(mask, segmented[1].mask, seen & b.valid, b.grid.dz_mm * b.grid.dtheta_mm)


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


def _result(
    names: tuple[str, str],
    found: Alignment | NotAligned,
    segmented: tuple[Segmentation, Segmentation],
    told_by: tuple[str | None, str | None],
    scores: tuple[Agreement, Agreement],
    valid: Mask,
    dz_mm: float,
) -> dict[str, Any]:
    aligned = isinstance(found, Alignment)
    on_grid, own_rows = scores
    overlap_rows = _reached(valid[0]) & _reached(valid[1])
    both = valid[0] & valid[1]
    return {
        "sides": list(names),
        "aligned": aligned,
        "reason": None if isinstance(found, Alignment) else found.reason,
        "alignment": asdict(found) if isinstance(found, Alignment) else None,
        "best_unbelieved": asdict(found.best) if isinstance(found, NotAligned) and found.best else None,
        "jaccard": on_grid.jaccard if aligned else None,
        "dice": on_grid.dice if aligned else None,
        "threshold": {
            name: {"value": side.threshold, "unit": side.unit, "of": side.of}
            for name, side in zip(names, segmented, strict=True)
        },
        "polarity": {name: side.polarity for name, side in zip(names, segmented, strict=True)},
        "polarity_from": dict(zip(names, told_by, strict=True)),
        "scores": {
            "grid": on_grid.as_json(),
            "own_rows": {"rows_of": names[1], **own_rows.as_json()},
        }
        if aligned
        else None,
        "valid_fraction": float(both[overlap_rows].mean()) if overlap_rows.any() else 0.0,
        "overlap_mm": float(overlap_rows.sum()) * dz_mm,
    }
