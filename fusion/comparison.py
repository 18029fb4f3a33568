"""Two panoramas of one bore in, one comparison out: aligned, segmented, scored on one grid."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from endoct.base.arrays import Mask
from endoct.base.compute.parallel import at_once
from endoct.base.doubt import Doubt
from endoct.base.entry_points import OURS
from endoct.base.errors import EndoctError
from endoct.fusion.doubts import (
    doubt_of_twist,
    doubts_by_hand,
    doubts_by_method,
    doubts_of_alignment,
    doubts_of_largest_cell,
    doubts_of_orientation,
    doubts_of_parts,
    doubts_of_result,
    doubts_of_scale,
    scale_at_limit,
)
from endoct.fusion.evidence.side import DrawnMask, Side, two_sides
from endoct.fusion.files.store import load_comparison, save_comparison
from endoct.fusion.geometry.alignment import LandmarkPair
from endoct.fusion.geometry.placement import IN_PLACE, Sampling, check_same_bore, common_grid
from endoct.fusion.pair_overlaps import by_li, on_own_rows
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.registration.align import (
    BELIEVABLE,
    LIKELY_CHANCE,
    Alignment,
    NotAligned,
    align_by_method,
    align_sides,
    fit_stretched,
    largest_cell_share,
    orientations_of,
)
from endoct.fusion.registration.by_hand import Bore, align_by_hand
from endoct.fusion.registration.rigidity import Part, parts_out_of_place
from endoct.fusion.registration.twist import find_twist, untwisted
from endoct.fusion.result import (
    Believable,
    Budget,
    ByHand,
    CorrectedTwist,
    DecidedByDepth,
    PairScores,
    Result,
    StoredAlignment,
    Threshold,
)
from endoct.fusion.scoring.scores import BOOTSTRAP, score_sides
from endoct.fusion.segmentation.by_eye import check_eye
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import doubts_of_side, segment_sides
from endoct.fusion.sides import Comparison, Placed, place
from endoct.stitching.panorama import Panorama

__all__ = ["CompareParameters", "Comparison", "compare_panoramas", "load_comparison", "save_comparison"]


def compare_panoramas(
    a: Panorama | DrawnMask,
    b: Panorama | DrawnMask,
    parameters: CompareParameters | None = None,
    pairs: Sequence[LandmarkPair] = (),
) -> Comparison:
    """Align ``b`` to ``a``, segment each on its own samples, bring both to one grid and score them.

    Landmark ``pairs`` correct the alignment or check it. Where no alignment stands out, and pairs establish none
    either, ``alignment`` is None and ``reason`` says why. Then B is placed by its nominal orientation, and nothing is
    scored.

    Raises :class:`EndoctError` where the bore diameters differ too much, or a side has nothing valid or shows no cells.
    Raises it also where pairs contradict what is known of the sides, or are given together with ``correct_twist``.
    """
    return compare_sides(*two_sides(a, b), parameters or CompareParameters(), pairs)


def compare_sides(
    a: Side,
    b: Side,
    parameters: CompareParameters,
    pairs: Sequence[LandmarkPair] = (),
    when_placed: Callable[[Placed], None] = lambda _: None,
) -> Comparison:
    """Compare as :func:`compare_panoramas` does; evidence that the sides have prepared already is used again.

    ``when_placed`` is called once before the sides are scored, with both as the comparison will have them.
    """
    if pairs and parameters.correct_twist:
        raise EndoctError(
            "landmark pairs and correct_twist do not go together",
            found="both",
            expected="one of them: rows that were turned have the places of landmarks no longer",
        )
    check_eye(parameters, a, b)
    if not parameters.correct_twist:
        return _compared(a, b, parameters, pairs, when_placed)
    plain = _compared(a, b, parameters)
    if plain.alignment is None:
        when_placed(Placed(plain.grid, plain.sides, aligned=False))
        return plain
    twist = find_twist(a, b, plain.alignment)
    corrected = _compared(a, replace(b, panorama=untwisted(b.panorama, twist)), parameters, when_placed=when_placed)
    stated = CorrectedTwist(
        note="B's rows were turned to where they fit A best. That raises the score by itself; see both.",
        z_mm=tuple(twist.z_mm.tolist()),
        twist_rad=tuple(twist.twist_rad.tolist()),
        known=tuple(twist.known.tolist()),
        jaccard_without=plain.result.jaccard,
        jaccard_with=corrected.result.jaccard,
    )
    doubts = (doubt_of_twist(stated, corrected.names), *corrected.result.doubts)
    return replace(corrected, result=corrected.result.model_copy(update={"twist": stated, "doubts": doubts}))


def _compared(
    a: Side,
    b: Side,
    parameters: CompareParameters,
    pairs: Sequence[LandmarkPair] = (),
    when_placed: Callable[[Placed], None] = lambda _: None,
) -> Comparison:
    on_bore = check_same_bore(a.grid.radius_mm, b.grid.radius_mm)
    # align
    z_scale_range = parameters.z_scale_min, parameters.z_scale_max
    search_result = align_sides(a, b, z_scale_range=z_scale_range, force=parameters.force)
    of_method: tuple[Doubt, ...] = ()
    if (name := parameters.alignment_method) != OURS:
        ours, search_result = search_result, align_by_method(a, b, name)
        if isinstance(search_result, Alignment):
            of_method = tuple(doubts_by_method(search_result, ours, name, a, b))
    by_hand: ByHand | None = None
    if pairs:
        bore = Bore(a.grid.radius_mm, orientations_of(a.panorama, b.panorama), z_scale_range)
        judged = align_by_hand(a, b, search_result, pairs, bore)
        search_result, by_hand = judged.alignment, judged.said
    # segment
    alignment = search_result if isinstance(search_result, Alignment) else None
    cells = segment_sides(a, b, alignment, parameters, parameters.polarity)
    compared = _placed((a, b), cells, search_result, by_hand, parameters, when_placed)
    noted: dict[str, object] = {"notes": {b.name: on_bore}} if on_bore else {}
    if of_method:
        noted["doubts"] = (*of_method, *compared.result.doubts)
    if by_hand is not None:
        noted["by_hand"] = by_hand
    return replace(compared, result=compared.result.model_copy(update=noted))


def compare_placed(
    both: tuple[Side, Side],
    cells: tuple[Segmentation, Segmentation],
    alignment: Alignment,
    parameters: CompareParameters,
) -> Comparison:
    """Compare two sides by their ``cells``; it is known how B lies in A's frame, so nothing is searched for."""
    return _placed(both, cells, alignment, None, parameters)


def _placed(
    both: tuple[Side, Side],
    cells: tuple[Segmentation, Segmentation],
    search_result: Alignment | NotAligned,
    by_hand: ByHand | None,
    parameters: CompareParameters,
    when_placed: Callable[[Placed], None] = lambda _: None,
) -> Comparison:
    alignment = search_result if isinstance(search_result, Alignment) else None
    a, b = both
    # place
    samplings = Sampling(a.grid, IN_PLACE), Sampling(b.grid, alignment or IN_PLACE)
    grid = common_grid(*samplings, dz_mm=parameters.dz_mm, n_theta=parameters.n_theta)
    sides = place(a, cells[0], samplings[0], grid), place(b, cells[1], samplings[1], grid)
    placed = Placed(grid, sides, alignment is not None)
    when_placed(placed)
    # score
    scored, (parts, overlaps) = at_once(
        lambda: score_sides(sides, grid, samplings if alignment else None, parameters.tolerance_mm),
        lambda: _held_together(both, cells, samplings, placed, parameters) if alignment else ((), {}),
    )
    scores = scored.scores and scored.scores.model_copy(update=overlaps)
    by_name = {a.name: cells[0], b.name: cells[1]}
    result = _result(search_result, by_name, (sides[0].valid, sides[1].valid), grid.dz_mm, scores, scored.budget)
    # doubt
    doubts = [*doubts_of_side(a, cells[0]), *doubts_of_side(b, cells[1])]
    if alignment is not None:
        is_by_hand = by_hand is not None and by_hand.corrected
        doubts = [
            *(doubts_by_hand(by_hand, alignment, b.name, parameters) if by_hand else ()),
            *(() if is_by_hand else doubts_of_alignment(alignment, parameters)),
            *(() if is_by_hand else _doubts_of_scale(a, b, alignment, parameters)),
            *doubts_of_largest_cell(max(largest_cell_share(each.evidence) for each in (a, b))),
            *doubts_of_orientation(alignment, a.panorama, b.panorama, b.name),
            *doubts_of_parts(parts, b.name),
            *doubts_of_result(result),
            *doubts,
        ]
    result = result.model_copy(update={"doubts": tuple(dict.fromkeys(doubts))})
    return Comparison(grid, sides, alignment, result.reason, result, scored.cells)


def _held_together(
    both: tuple[Side, Side],
    cells: tuple[Segmentation, Segmentation],
    samplings: tuple[Sampling, Sampling],
    placed: Placed,
    parameters: CompareParameters,
) -> tuple[tuple[Part, ...], Mapping[str, object]]:
    """Return the parts of B that are out of place, and the overlaps besides that on the common grid, by key."""
    a, b = both
    alignment = samplings[1].where
    parts = parts_out_of_place(a.evidence, b.evidence, alignment)
    own_rows = on_own_rows(both, (cells[0].mask, cells[1].mask), alignment)
    return parts, {"own_rows": own_rows, "by_li": by_li(both, cells, samplings, placed, parameters)}


def _doubts_of_scale(a: Side, b: Side, alignment: Alignment, parameters: CompareParameters) -> Iterator[Doubt]:
    if scale_at_limit(alignment, parameters):
        orientation = ((alignment.mirrored, alignment.z_reversed),)
        searched = parameters.z_scale_min, parameters.z_scale_max
        farther = fit_stretched(a.evidence, b.evidence, orientation, searched)
        yield from doubts_of_scale(alignment, farther, parameters, a, b)


def _reached(valid: Mask) -> Mask:
    """Return the rows from the first to the last in which a side observed anything, bool (n_z,)."""
    rows = np.flatnonzero(valid.any(axis=1))
    reached = np.zeros(valid.shape[0], np.bool_)
    if rows.size:
        reached[rows[0] : rows[-1] + 1] = True
    return reached


def _threshold(cells: Segmentation) -> Threshold:
    by_depth = None if cells.by_depth is None else DecidedByDepth(**asdict(cells.by_depth))
    return Threshold(value=cells.threshold, unit=cells.unit, of=cells.of, by_depth=by_depth)


def _result(
    search_result: Alignment | NotAligned,
    cells: Mapping[str, Segmentation],
    valid: tuple[Mask, Mask],
    dz_mm: float,
    scores: PairScores | None,
    budget: Budget | None,
) -> Result:
    first, second = cells
    aligned = isinstance(search_result, Alignment)
    covered = _reached(valid[0]) & _reached(valid[1])
    both = valid[0] & valid[1]
    return Result(
        sides=(first, second),
        aligned=aligned,
        reason=None if isinstance(search_result, Alignment) else search_result.reason,
        alignment=StoredAlignment.of(search_result) if isinstance(search_result, Alignment) else None,
        believed_if=Believable(confidence_at_least=BELIEVABLE, chance_at_most=LIKELY_CHANCE),
        best_unbelieved=None if isinstance(search_result, Alignment) else StoredAlignment.of(search_result.best),
        jaccard=scores.grid.jaccard if scores else None,
        dice=scores.grid.dice if scores else None,
        threshold={name: _threshold(of_side) for name, of_side in cells.items()},
        polarity={name: s.polarity for name, s in cells.items()},
        polarity_from={name: s.polarity_from for name, s in cells.items()},
        scores=scores,
        budget=budget,
        bootstrap=BOOTSTRAP,
        valid_fraction=float(both[covered].mean()) if covered.any() else 0.0,
        overlap_mm=float(covered.sum()) * dz_mm,
    )
