"""What speaks against a comparison: its alignment, the cells of its two sides, and the wall that both observed.

Where landmark pairs corrected or established the alignment, that is the first doubt about it.
"""

import math
from collections.abc import Iterator, Sequence
from math import hypot

import numpy as np
from scipy.special import stdtrit

from endoct.base.doubt import Doubt
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.registration.align import BELIEVABLE, CLEAR_RATIO, FARTHEST, RARE_CHANCE, remedies
from endoct.fusion.registration.by_hand import CHECK_PAIRS, orientation_text
from endoct.fusion.registration.rigidity import LoosePart
from endoct.fusion.registration.steps import LEAST_STEP_MM, Step
from endoct.fusion.result import ByHand, Drift, Line, Overlap, PairScores, PlacedPair
from endoct.stitching.panorama import LEAST_VALID_SHARE, Panorama

LEAST_DRIFT_MM = 0.1
"""Cells that drift apart by less are no reason to doubt the alignment."""
BY_CHANCE = 0.005
"""Nor are cells that would drift apart as far by chance with this probability, either way (Student's t)."""
WIDEST_INTERVAL = 0.5
"""A Jaccard index with a wider interval says little."""
FEW_DECIDE = 0.3
"""How much a Jaccard index may change without one or two of its cells."""
LARGEST_CELL = 0.9
"""An alignment rests on one outline alone where one cell holds a larger share of the area of all cells."""
AT_LIMIT = 1e-4
"""A scale that ends nearer than this to a limit of its search was held there."""
LARGEST_MISFIT = 3.0
"""Pairs that lie farther apart than so many times their standard error do not fit one rigid alignment."""


def doubts_of_alignment(alignment: Alignment, parameters: CompareParameters) -> Iterator[Doubt]:
    """Yield what speaks against the alignment itself."""
    if parameters.force:
        what = (
            f"The best alignment was accepted because that was asked for (force). Its confidence is "
            f"{alignment.confidence:.2f}; without force, alignments are accepted from {BELIEVABLE:g} on."
        )
        yield Doubt("forced", what, value=alignment.confidence, unit="1", expected=(BELIEVABLE, 1.0))
    elif alignment.confidence < BELIEVABLE and alignment.ratio >= CLEAR_RATIO and alignment.chance <= RARE_CHANCE:
        what = (
            f"The two sides share little but the rims of their cells, which aligned them, with a confidence of "
            f"{alignment.confidence:.2f}. Look at the cells of both before you rely on it."
        )
        yield Doubt("aligned-by-rims", what, value=alignment.confidence, unit="1", expected=(BELIEVABLE, 1.0))


def doubts_by_method(alignment: Alignment, ours: Alignment | None, name: str, a: Side, b: Side) -> Iterator[Doubt]:
    """Yield the doubt about an ``alignment`` by the method ``name``, with how far it is from ``ours``, if any."""
    what = f"The alignment is that of the method '{name}'; endoct does not judge how far it can be trusted."
    if ours is None:
        yield Doubt("aligned-by-method", f"{what} Its own search finds none.")
        return
    if (ours.mirrored, ours.z_reversed) != (alignment.mirrored, alignment.z_reversed):
        yield Doubt("aligned-by-method", f"{what} Its own search has {b.name} the other way around.")
        return
    middle_mm = float(b.grid.z_mm.mean())
    turn_rad = float(wrap_rad(np.float64(alignment.theta_shift_rad - ours.theta_shift_rad)))
    along_mm = float(alignment.z_to_a(middle_mm) - ours.z_to_a(middle_mm))
    apart_mm = float(np.hypot(turn_rad * a.grid.radius_mm, along_mm))
    said = f"{what} In the middle of {b.name} its own search lies {apart_mm:.2f} mm away."
    yield Doubt("aligned-by-method", said, value=apart_mm, unit="mm", expected=0.0)


def doubts_of_largest_cell(share: float) -> Iterator[Doubt]:
    """Yield the doubt about an alignment that rests on one cell, with that ``share`` of the area of all cells."""
    if share > LARGEST_CELL:
        what = (
            f"One cell holds {share:.0%} of the area of all cells: the alignment rests on its outline alone, and is "
            "less certain away from it than stated."
        )
        yield Doubt("one-cell-aligns", what, value=share, unit="1", expected=(0.0, LARGEST_CELL))


def scale_at_limit(alignment: Alignment, parameters: CompareParameters) -> bool:
    """Say whether the scale along the bore was held by a limit of its search."""
    low, high = parameters.z_scale_min, parameters.z_scale_max
    return low < high and not low + AT_LIMIT < alignment.z_scale < high - AT_LIMIT


def doubts_of_scale(
    alignment: Alignment, farther: Alignment | None, parameters: CompareParameters, a: Side, b: Side
) -> Iterator[Doubt]:
    """Yield the doubts about a scale that ended at a limit of its search, and about lengths that the sidecars state.

    ``farther`` is where ``b`` lies on ``a`` at a scale beyond that limit, as one piece; None where it does not.
    """
    low, high = parameters.z_scale_min, parameters.z_scale_max
    beyond = f"it fits best at {farther.z_scale:.3f}" if farther else "no other lays it there as one piece"
    what = (
        f"The scale of {b.name} along the bore ended at a limit of its search ({alignment.z_scale:.3f}, searched from "
        f"{low:g} to {high:g}); looked for from {FARTHEST[0]:g} to {FARTHEST[1]:g}, {beyond}. A feed or a length in a "
        "sidecar may be wrong."
    )
    yield Doubt("scale-at-limit", what, value=alignment.z_scale, unit="1", expected=(low, high))
    suspected = remedies(a, b, farther.z_scale) if farther else ()
    for remedy in suspected:
        other = a.name if remedy.side == b.name else b.name
        what = (
            f"Along the bore it is {remedy.stated / remedy.agreeing:.3f} times as long as {other} has the same wall: "
            f"{remedy.key} = {remedy.agreeing:.4g} would agree; {remedy.stated:.4g} is stated."
        )
        if len(suspected) > 1:
            what += f" Or else {' or '.join(str(each) for each in suspected if each is not remedy)}."
        found, expected = remedy.agreeing, remedy.stated
        yield Doubt("pitch-contradicted", what, remedy.side, found, remedy.unit, expected, key=remedy.key)


def doubts_of_parts(parts: Sequence[LoosePart], of: str, scale: float = 1.0) -> Iterator[Doubt]:
    """Yield the doubt about ``parts`` of the wall that do not lie where the alignment puts side ``of``.

    Their lengths are those of a bore that is ``scale`` times as wide.
    """
    if not parts:
        return
    worst = parts[0]
    where = (
        f"between z = {scale * worst.first:.1f} and {scale * worst.last:.1f} mm"
        if worst.kind == "band"
        else f"between θ = {math.degrees(worst.first):.0f}° and {math.degrees(worst.last):.0f}°"
    )
    there = "where other directions do" if worst.kind == "turn" else "there"
    what = (
        f"The wall of {of} does not lie as one piece where it was aligned: {where} it fits best "
        f"{scale * worst.along_mm:+.2f} mm along and {scale * worst.around_mm:+.2f} mm around the bore from {there}. "
        "Slices or frames may be lost, swapped or turned."
    )
    off_mm, limit_mm = scale * worst.off_mm, scale * worst.limit_mm
    z_mm = (scale * worst.first, scale * worst.last) if worst.kind == "band" else None
    yield Doubt("parts-out-of-place", what, side=of, value=off_mm, unit="mm", expected=(0.0, limit_mm), z_mm=z_mm)


def doubts_of_step(step: Step | None, of: str, scale: float = 1.0) -> Iterator[Doubt]:
    """Yield the doubt about a ``step`` of side ``of`` along the bore, which is ``scale`` times as wide as it has it."""
    if step is not None:
        cause, other = ("lost", "doubled") if step.along_mm > 0 else ("doubled", "lost")
        what = (
            f"From about z = {scale * step.at_mm:.1f} mm on, the wall of {of} fits best {scale * step.along_mm:+.2f} "
            f"mm farther along the bore than before it. Its slices or frames may be {cause} there, or the other side's "
            f"{other}, or the feed slipped."
        )
        found, most = scale * abs(step.along_mm), scale * LEAST_STEP_MM
        at_mm = scale * step.at_mm
        yield Doubt("step-along-the-bore", what, of, found, "mm", (0.0, most), z_mm=(at_mm, at_mm))


def doubts_of_bend(alignment: Alignment, of: str) -> Iterator[Doubt]:
    """Yield the doubt about side ``of`` where its ``alignment`` had to bend along the bore."""
    if (bend := alignment.bend) is None:
        return
    along_mm, roll_deg = (float(np.abs(part).max()) for part in (bend.shift_mm, np.degrees(bend.roll_rad)))
    what = (
        f"The wall of {of} bends along the bore: the alignment follows it by up to {along_mm:.2f} mm along and "
        f"{roll_deg:.1f}° around, since that fits wall better that had no part in it. The feed or the rotation "
        "slipped, or slices or frames were lost or doubled, on either side."
    )
    for at_mm, step_mm, roll_rad in bend.steps[:3]:
        what += f" From z = {at_mm:.1f} mm on it lies {step_mm:+.2f} mm farther along, turned by "
        what += f"{math.degrees(roll_rad):+.1f}°."
    farthest_mm = bend.z_mm[int(np.abs(bend.shift_mm).argmax())]
    yield Doubt("bent-along-the-bore", what, of, along_mm, "mm", expected=0.0, z_mm=(farthest_mm, farthest_mm))


def doubts_of_orientation(alignment: Alignment, a: Panorama, b: Panorama, of: str) -> Iterator[Doubt]:
    """Yield what an alignment of ``b``, the side ``of``, says against orientations that the sidecars state."""
    if alignment.mirrored and a.handedness_known and b.handedness_known:
        reversed_too = " and its direction of travel reversed" if alignment.z_reversed else ""
        what = (
            f"{of} fits best with its θ mirrored{reversed_too}, although both sides state which way their θ runs: "
            "handedness is wrong in a sidecar, or one side was recorded from the other end of the bore."
        )
        yield Doubt("handedness-contradicted", what)


def doubts_of_scores(valid_fraction: float, scores: PairScores) -> Iterator[Doubt]:
    """Yield what the scores of an aligned comparison say against it; both sides observed ``valid_fraction``."""
    if valid_fraction < LEAST_VALID_SHARE:
        what = f"Both sides observed only {valid_fraction:.1%} of the wall over the length that they share."
        yield Doubt("little-observed-by-both", what, value=valid_fraction, unit="1", expected=(LEAST_VALID_SHARE, 1.0))
    yield from _of_score(scores.grid)
    if scores.drift:
        yield from _of_drift(scores.drift)
    if scores.grid.is_empty:
        what = "Neither side shows a cell where both observed the wall, so there is nothing to score."
        yield Doubt("nothing-to-score", what)


def _of_score(overlap: Overlap) -> Iterator[Doubt]:
    """Yield the doubts about a Jaccard index that could be anything, or that one or two cells decide."""
    if overlap.is_empty or overlap.jaccard is None:
        return
    if (low_high := overlap.jaccard_interval) and low_high[1] - low_high[0] > WIDEST_INTERVAL:
        what = (
            f"The Jaccard index is {overlap.jaccard:.2f}, but with other cells of the same kind it would be anything "
            f"between {low_high[0]:.2f} and {low_high[1]:.2f} (95 %): it says little."
        )
        width = low_high[1] - low_high[0]
        yield Doubt("score-uncertain", what, value=width, unit="1", expected=(0.0, WIDEST_INTERVAL))
    without = overlap.jaccard_without_two
    if overlap.sites is not None and overlap.sites <= 2:
        what = f"One or two cells decide the score: there are {overlap.sites} in all, and it says little of the bore."
        yield Doubt("few-cells-decide", what)
    elif without and (change := max(overlap.jaccard - without[0], without[1] - overlap.jaccard)) > FEW_DECIDE:
        what = (
            f"One or two cells decide the score: without them the Jaccard index, {overlap.jaccard:.2f}, would lie "
            f"anywhere between {without[0]:.2f} and {without[1]:.2f}."
        )
        yield Doubt("few-cells-decide", what, value=change, unit="1", expected=(0.0, FEW_DECIDE))


def _of_drift(drift: Drift) -> Iterator[Doubt]:
    for where, line in (("along the bore", drift.z_mm), ("around the bore", drift.arc_mm)):
        if grown_mm := _grown_mm(line, drift):
            what = (
                f"Cells that both sides show drift apart {where}, by {abs(grown_mm):.2f} mm over "
                f"{drift.length_mm:.1f} mm of it: the alignment may be wrong, or not rigid."
            )
            yield Doubt("cells-drift-apart", what, value=grown_mm, unit="mm", expected=0.0)


def _grown_mm(line: Line, drift: Drift) -> float | None:
    """Return how far matched cells drift apart over the length on which there are any; None where they do not."""
    grown_mm, freedom = line.per_mm * drift.length_mm, (drift.pairs or 0) - 2
    if freedom < 1 or not math.isfinite(grown_mm) or abs(grown_mm) <= LEAST_DRIFT_MM:
        return None
    sure = abs(line.per_mm) > float(stdtrit(freedom, 1 - BY_CHANCE / 2)) * line.per_mm_error
    return grown_mm if sure else None


def doubts_by_hand(said: ByHand, alignment: Alignment, of: str, parameters: CompareParameters) -> Iterator[Doubt]:
    """Yield the doubts about the ``alignment`` of side ``of`` by hand; none where pairs only checked it."""
    if not said.corrected:
        return
    pairs = pairs_text(said)
    if said.automatic_reason is not None:
        what = (
            f"The alignment was established by hand, by {pairs}: none was found without. How well the sides agree is "
            "to be judged by pairs that had no part in it, and says nothing of the automatic alignment."
        )
        yield Doubt("aligned-by-hand", what)
    elif said.moved is not None:
        moved_mm = hypot(said.moved.around_mm, said.moved.along_mm)
        what = (
            f"The alignment was corrected by hand, by {pairs}, which moved {of} by {moved_mm:.2f} mm against the "
            "automatic one. The scores are those of the corrected alignment."
        )
        yield Doubt("corrected-by-hand", what, value=moved_mm, unit="mm", expected=0.0)
    if said.automatic_reason is None and said.orientation_by_pairs:
        turned = orientation_text((alignment.mirrored, alignment.z_reversed))
        what = (
            f"The alignment was corrected by hand: by {pairs} {of} is {turned}, other than the automatic alignment had "
            "it. State handedness and travel in the sidecars, so that nobody has to point that out."
        )
        yield Doubt("orientation-by-hand", what)
    if said.misfit is not None and said.misfit > LARGEST_MISFIT:
        worst = max((pair for pair in said.pairs if pair.role == "correct"), key=_apart_mm)
        what = (
            f"The landmark pairs do not fit one rigid alignment: they lie {said.misfit:.1f} times as far apart as they "
            f"should, {worst.name or 'one'} by {_apart_mm(worst):.2f} mm; {CHECK_PAIRS}."
        )
        yield Doubt("landmarks-disagree", what, value=said.misfit, unit="1", expected=(0.0, LARGEST_MISFIT))
    low, high = parameters.z_scale_min, parameters.z_scale_max
    if said.scale_share and not low <= alignment.z_scale <= high:
        what = (
            f"By the landmark pairs the scale of {of} along the bore is {alignment.z_scale:.3f}, beyond what is "
            f"searched ({low:g} to {high:g}): a feed or a length in a sidecar may be wrong, or a pair."
        )
        yield Doubt("scale-by-hand", what, value=alignment.z_scale, unit="1", expected=(low, high))


def pairs_text(said: ByHand) -> str:
    """Return how many pairs corrected, "3 landmark pairs"."""
    count = sum(pair.role == "correct" for pair in said.pairs)
    return f"{count} landmark pair{'s' * (count != 1)}"


def _apart_mm(pair: PlacedPair) -> float:
    return pair.after.distance_mm if pair.after else 0.0
