"""The cells of a side, or of both, each on its own samples; and whether cells are dark or bright."""

from dataclasses import replace
from functools import partial
from typing import Literal

from endoct.base.arrays import Mask
from endoct.base.compute.parallel import at_once
from endoct.base.doubt import Doubt
from endoct.base.entry_points import OURS
from endoct.fusion.evidence.evidence import Evidence, Polarity, correlation
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.segmentation.by_eye import cells_by_eye, held_against, is_sure, view_of
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.planes import find_planes, without_planes
from endoct.fusion.segmentation.segment import Segmentation, cells_by_method, find_cells
from endoct.stitching.panorama import Panorama, doubts_of_observed


def segment_sides(
    a: Side,
    b: Side,
    alignment: Alignment | None,
    parameters: SegmentParameters,
    polarity: Literal["auto", "dark", "bright"] = "auto",
) -> tuple[Segmentation, Segmentation]:
    """Return the cells of both sides, each segmented on its own samples.

    ``polarity`` other than "auto" says whether cells are dark or bright where a side is segmented by its intensity.
    Otherwise the sign of a correlation decides. It is that with the side's own relief, or with the other side, if that
    has depth or is a mask. Where there is neither, A's cells are dark, and B's are as the two correlate.

    Raises :class:`EndoctError` where all evidence of a side is alike.
    """
    agreement = None if alignment is None else alignment.correlation
    of_a, of_b = a.in_reference.evidence, b.in_reference.evidence

    def segmented(side: Side, other: Evidence, agrees: float | None) -> Segmentation:
        if side.in_reference.cell_evidence(parameters.segment).knows_cells:
            return segment_side(side, parameters, "dark")
        return segment_side(side, parameters, *_polarity(side.in_reference, polarity, other, agrees))

    return at_once(
        lambda: segmented(a, of_b, agreement if of_b.knows_cells else None), lambda: segmented(b, of_a, agreement)
    )


def segment_side(
    side: Side, parameters: SegmentParameters, polarity: Polarity, polarity_from: str = "given"
) -> Segmentation:
    """Return the cells of ``side``, which are dark or bright, as ``polarity``, where it is segmented by intensity.

    Raises :class:`EndoctError` where all evidence is alike.
    """
    if side.scale != 1:
        cells = segment_side(side.in_reference, parameters, polarity, polarity_from)
        in_mm = None if cells.threshold is None or cells.unit != "mm" else side.scale * cells.threshold
        of = cells.of if cells.by == "mask" else f"{cells.of}; lengths as in a bore of 2.5 mm"
        planes = tuple(plane.scaled(side.scale) for plane in cells.planes)
        return replace(cells, threshold=cells.threshold if in_mm is None else in_mm, of=of, planes=planes)
    evidence = side.cell_evidence(parameters.segment, polarity)
    if parameters.segmentation_method != OURS and evidence.kind != "mask":
        return cells_by_method(side.panorama, parameters.segmentation_method)
    cells = _with_cells_in_planes(side, evidence, parameters, polarity_from)
    if not parameters.outlines or evidence.kind != "darkness" or not (planes := find_planes(evidence)):
        return cells
    without = without_planes(cells.mask, planes, side.grid)
    return replace(cells, mask=without, planes=planes, of=f"{cells.of}, without planes that cut the bore")


def _with_cells_in_planes(
    side: Side, evidence: Evidence, parameters: SegmentParameters, polarity_from: str
) -> Segmentation:
    by_rules = partial(find_cells, evidence, parameters, None if evidence.knows_cells else polarity_from, side.parallax)
    view = view_of(side, parameters) if evidence.kind == "darkness" else None
    if view is None:
        return by_rules()
    if not view.is_familiar:
        return replace(by_rules(), eye_declined="the wall is too grainy for the learned eye")
    by_eye, expected = cells_by_eye(view, parameters, polarity_from)
    return by_eye if is_sure(by_eye, expected) else held_against(by_eye, by_rules())


def segment(
    given: Panorama | Side, parameters: SegmentParameters | None = None, *, polarity: Polarity = "dark"
) -> Mask:
    """Return the cells of a panorama or a side on its own samples, bool (n_z, n_theta), False where it is not valid.

    ``polarity`` says whether cells are dark or bright where there is only intensity. Raises :class:`EndoctError` where
    nothing is valid or the evidence is constant.
    """
    side = given if isinstance(given, Side) else Side(given.modality, given)
    return segment_side(side, parameters or SegmentParameters(), polarity).mask


def evidence_of(side: Side, cells: Segmentation) -> Evidence:
    """Return what tells most of where cells lie on ``side``: how probable the learned eye holds them, else its own."""
    own = side.in_reference.evidence
    if own.kind != "darkness" or cells.probability is None:
        return own
    return replace(own, values=cells.probability, kind="probability")


def contrast_of(side: Side, cells: Segmentation) -> Evidence | None:
    """Return the evidence by which ``cells`` were separated from the wall, where that is the intensity."""
    return None if cells.polarity is None else side.in_reference.contrast(cells.polarity)


def doubts_of_side(side: Side, cells: Segmentation) -> tuple[Doubt, ...]:
    """Return why the panorama as a whole, or its cells, are not to be trusted."""
    doubts = (*side.panorama.doubts, *doubts_of_observed(side.panorama), *cells.doubts)
    return tuple(doubt.of_side(side.name) for doubt in doubts)


def _polarity(
    side: Side, given: Literal["auto", "dark", "bright"], other: Evidence, agreement: float | None
) -> tuple[Polarity, str]:
    """Return whether the cells of ``side`` are dark or bright, and how that is known.

    ``agreement`` is its correlation with ``other``, None where that says nothing.
    """
    if given != "auto":
        return given, "given"
    if side.relief is not None:
        of_depth = correlation(side.relief, side.contrast("dark"))
        return ("bright" if of_depth < 0 else "dark"), "correlation with its own relief"
    if agreement is not None:
        return ("bright" if agreement < 0 else "dark"), f"correlation with the other side's {other.kind}"
    return "dark", "assumed"
