"""Two panoramas of one bore in, one comparison out: aligned, segmented, scored on one grid."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from endoct.base.arrays import Mask
from endoct.base.compute.parallel import at_once
from endoct.base.doubt import Doubt
from endoct.base.entry_points import OURS
from endoct.base.errors import EndoctError
from endoct.fusion.doubts import (
    doubts_by_hand,
    doubts_by_method,
    doubts_of_alignment,
    doubts_of_bend,
    doubts_of_largest_cell,
    doubts_of_orientation,
    doubts_of_parts,
    doubts_of_scale,
    doubts_of_scores,
    doubts_of_step,
    scale_at_limit,
)
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.side import DrawnMask, Side, two_sides
from endoct.fusion.files.store import load_comparison, save_comparison
from endoct.fusion.geometry.alignment import Alignment, LandmarkPair, SearchOutcome
from endoct.fusion.geometry.placement import IN_PLACE, WIDEST_IN_BONE_MM, Sampling, check_same_bore, common_grid
from endoct.fusion.pair_overlaps import by_li, on_own_rows
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.registration.align import (
    BELIEVABLE,
    LIKELY_CHANCE,
    align_by_method,
    align_sides,
    find_sides,
    fit_stretched,
    orientations_of,
)
from endoct.fusion.registration.by_hand import KnownBore, align_by_hand
from endoct.fusion.registration.instruments import largest_cell_share
from endoct.fusion.registration.rigidity import parts_out_of_place
from endoct.fusion.registration.steps import step_along
from endoct.fusion.result import Believable, ByHand, Result, StoredAlignment, StoredRemedy, Threshold
from endoct.fusion.scoring.scores import BOOTSTRAP, Scored, score_sides
from endoct.fusion.segmentation.by_eye import check_eye
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import doubts_of_side, evidence_of, segment_sides
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
    Raises it also where pairs contradict what is known of the sides.
    """
    given = parameters or CompareParameters()
    return score_placed(place_sides(*two_sides(a, b), given, pairs), given)


def place_sides(a: Side, b: Side, parameters: CompareParameters, pairs: Sequence[LandmarkPair] = ()) -> Placed:
    """Return two sides as :func:`compare_panoramas` lays them on one grid, each with its cells, before it scores them.

    Raises as that does.
    """
    check_eye(parameters, a, b)
    note = check_same_bore(a.grid.radius_mm, b.grid.radius_mm)
    if pairs and a.scale != 1:
        raise EndoctError(
            "landmark pairs align bores as wide as those in bone",
            found=f"a bore of {2 * a.grid.radius_mm:g} mm",
            expected=f"at most {2 * WIDEST_IN_BONE_MM:g} mm",
            remedy="leave the pairs out",
        )
    z_scale_range = parameters.z_scale_min, parameters.z_scale_max
    there = a.in_reference, b.in_reference
    rough = find_sides(*there, z_scale_range=z_scale_range)
    name = parameters.alignment_method
    by_method = None if name == OURS else align_by_method(*there, name).scaled(a.scale)

    def laid(by_eye: tuple[Evidence, Evidence] | None) -> tuple[SearchOutcome, ByHand | None, tuple[Doubt, ...]]:
        outcome = align_sides(
            *there, z_scale_range=z_scale_range, force=parameters.force, rough=rough, by_eye=by_eye
        ).scaled(a.scale)
        doubts: tuple[Doubt, ...] = ()
        if by_method is not None:
            ours, outcome = outcome, by_method
            doubts = tuple(doubts_by_method(outcome.alignment, ours.alignment, name, a, b) if outcome.alignment else ())
        if not pairs:
            return outcome, None, doubts
        bore = KnownBore(a.grid.radius_mm, orientations_of(a.panorama, b.panorama), z_scale_range)
        judged = align_by_hand(a, b, outcome, pairs, bore)
        return judged.outcome, judged.said, doubts

    # whether cells are dark or bright shows where the two roughly lie, unless somebody else says where that is
    alone = not pairs and by_method is None
    roughly = (rough.place or (rough.best if parameters.force else None)) if alone else laid(None)[0].alignment
    cells = segment_sides(a, b, roughly, parameters, parameters.polarity)
    outcome, by_hand, doubts = laid((evidence_of(a, cells[0]), evidence_of(b, cells[1])))
    placed = on_one_grid((a, b), cells, outcome, parameters)
    return replace(placed, by_hand=by_hand, doubts=doubts, notes={b.name: note} if note else {})


def compare_placed(
    both: tuple[Side, Side],
    cells: tuple[Segmentation, Segmentation],
    alignment: Alignment,
    parameters: CompareParameters,
) -> Comparison:
    """Compare two sides by their ``cells``; it is known how B lies in A's frame, so nothing is searched for."""
    return score_placed(on_one_grid(both, cells, SearchOutcome(alignment), parameters), parameters)


def on_one_grid(
    both: tuple[Side, Side],
    cells: tuple[Segmentation, Segmentation],
    outcome: SearchOutcome,
    parameters: CompareParameters,
) -> Placed:
    """Return two sides with their ``cells`` on one grid, B where the ``outcome`` of a search says that it lies."""
    samplings = Sampling(both[0].grid, IN_PLACE), Sampling(both[1].grid, outcome.alignment or IN_PLACE)
    grid = common_grid(*samplings, dz_mm=parameters.dz_mm, n_theta=parameters.n_theta)
    sides = place(both[0], cells[0], samplings[0], grid), place(both[1], cells[1], samplings[1], grid)
    return Placed(grid, sides, both, cells, samplings, outcome)


def score_placed(placed: Placed, parameters: CompareParameters) -> Comparison:
    """Return the comparison of two sides as they were ``placed``, with scores and doubts."""
    alignment = placed.outcome.alignment
    scored, (bent, overlaps) = at_once(
        lambda: score_sides(
            placed.sides, placed.grid, placed.samplings if alignment else None, parameters.tolerance_mm
        ),
        lambda: _held_together(placed, alignment, parameters) if alignment else ((), {}),
    )
    if scored.scores:
        scored = replace(scored, scores=scored.scores.model_copy(update=overlaps))
    result = _result(placed, scored, bent, parameters)
    return Comparison(placed.grid, placed.sides, alignment, result.reason, result, scored.cells)


def _held_together(
    placed: Placed, alignment: Alignment, parameters: CompareParameters
) -> tuple[tuple[Doubt, ...], Mapping[str, object]]:
    """Return what speaks against one rigid place, and the overlaps besides that on the common grid, by key."""
    (a, b), scale = placed.both, placed.both[0].scale
    of_a, of_b = evidence_of(a, placed.cells[0]), evidence_of(b, placed.cells[1])
    there = alignment.scaled(1 / scale)
    bent = tuple(doubts_of_parts(parts_out_of_place(of_a, of_b, there), b.name, scale))
    if not bent and alignment.bend is None:
        bent = tuple(doubts_of_step(step_along(of_a, of_b, there), b.name, scale))
    own_rows = on_own_rows(placed.both, (placed.cells[0].mask, placed.cells[1].mask), alignment)
    return bent, {"own_rows": own_rows, "by_li": by_li(placed, parameters)}


def _result(placed: Placed, scored: Scored, bent: Sequence[Doubt], parameters: CompareParameters) -> Result:
    outcome, scores = placed.outcome, scored.scores
    first, second = (side.valid for side in placed.sides)
    covered, both = _reached(first) & _reached(second), first & second
    valid_fraction = float(both[covered].mean()) if covered.any() else 0.0
    names = placed.both[0].name, placed.both[1].name
    by_name = dict(zip(names, placed.cells, strict=True))
    jaccard = scores.grid.jaccard if scores else None
    doubts = (
        *placed.doubts,
        *(() if outcome.alignment is None else _doubts_of_alignment(placed, outcome.alignment, bent, parameters)),
        *(() if scores is None else doubts_of_scores(valid_fraction, scores)),
        *(doubt for of in zip(placed.both, placed.cells, strict=True) for doubt in doubts_of_side(*of)),
    )
    remedies = tuple(StoredRemedy(side=each.side, key=each.key, agreeing=each.agreeing) for each in outcome.remedies)
    planes = {side.name: side.planes for side in placed.sides if side.planes}
    said: dict[str, Any] = {"notes": placed.notes, "by_hand": placed.by_hand, "remedies": remedies}
    said |= {"best_ruled_out": StoredAlignment.of(outcome.ruled_out), "planes": planes}
    return Result(
        sides=names,
        aligned=outcome.alignment is not None,
        reason=None if outcome.alignment else outcome.reason,
        alignment=StoredAlignment.of(outcome.alignment),
        believed_if=Believable(confidence_at_least=BELIEVABLE, chance_at_most=LIKELY_CHANCE),
        best_unbelieved=StoredAlignment.of(outcome.best),
        jaccard=jaccard,
        dice=scores.grid.dice if scores else None,
        threshold={name: _threshold(cells) for name, cells in by_name.items()},
        polarity={name: cells.polarity for name, cells in by_name.items()},
        polarity_from={name: cells.polarity_from for name, cells in by_name.items()},
        scores=scores,
        budget=scored.budget,
        bootstrap=BOOTSTRAP,
        valid_fraction=valid_fraction,
        overlap_mm=float(covered.sum()) * placed.grid.dz_mm,
        doubts=tuple(dict.fromkeys(doubts)),
        **{name: part for name, part in said.items() if part},
    )


def _doubts_of_alignment(
    placed: Placed, alignment: Alignment, bent: Sequence[Doubt], parameters: CompareParameters
) -> Iterator[Doubt]:
    (a, b), by_hand = placed.both, placed.by_hand
    if by_hand is not None:
        yield from doubts_by_hand(by_hand, alignment, b.name, parameters)
    if by_hand is None or not by_hand.corrected:
        yield from doubts_of_alignment(alignment, parameters)
        if scale_at_limit(alignment, parameters):
            orientation = ((alignment.mirrored, alignment.z_reversed),)
            searched = parameters.z_scale_min, parameters.z_scale_max
            of_a, of_b = a.in_reference.evidence, b.in_reference.evidence
            farther = fit_stretched(of_a, of_b, orientation, searched)
            yield from doubts_of_scale(alignment, farther, parameters, a, b)
    yield from doubts_of_largest_cell(max(largest_cell_share(side.in_reference.evidence) for side in (a, b)))
    yield from doubts_of_bend(alignment, b.name)
    yield from doubts_of_orientation(alignment, a.panorama, b.panorama, b.name)
    yield from bent


def _reached(valid: Mask) -> Mask:
    """Return the rows from the first to the last in which a side observed anything, bool (n_z,)."""
    rows = np.flatnonzero(valid.any(axis=1))
    reached = np.zeros(valid.shape[0], np.bool_)
    if rows.size:
        reached[rows[0] : rows[-1] + 1] = True
    return reached


def _threshold(cells: Segmentation) -> Threshold:
    of = cells.of if cells.eye_declined is None else f"{cells.of}; {cells.eye_declined}"
    return Threshold(value=cells.threshold, unit=cells.unit, of=of, by_depth=cells.by_depth)
