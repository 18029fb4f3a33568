"""Where one side's wall lies in the other side's frame: searched for globally, refined, and believed or not.

A method that is chosen by name may answer instead; how far that can be trusted is not judged.

The search is exhaustive: masked normalised cross-correlation over every turn, every shift, a range of z scales and
every orientation left open. θ is a circle. The sign of the correlation carries no information and is not used. The best
place is refined to a fraction of a sample.

It is believed where it stands out in two ways. One is against the next best place of the same pair
(``confidence``), the other against what one side, shuffled, reaches on the other (``chance``). Neither alone would
do. A pattern that both sides have everywhere beats every shuffle, but not its own runner-up. Two sides that show
next to nothing have one best place all the same, but no better than shuffled.

Where floors are lit, depth and light share little but the rims of cells. So where no place is believed, rims are
searched for by themselves.

A pitch that a sidecar states wrongly stretches a recording by more than instruments differ. A search over every
scale from the outset would give chance more to choose from. So scales farther off are only looked at where the
usual search fails, or ends at its limit. The remedy then names the values in the sidecars that would make the two
recordings equally long along the bore.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from endoct.base.entry_points import answer_by
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.evidence import Evidence, brightness, clipped, correlation
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import (
    ALL_ORIENTATIONS,
    Alignment,
    NotAligned,
    Orientation,
    Remedy,
    SearchOutcome,
    as_covariance,
)
from endoct.fusion.geometry.placement import IN_PLACE
from endoct.fusion.registration.bending import find_bend
from endoct.fusion.registration.instruments import corrected_for_instruments
from endoct.fusion.registration.refinement import refine
from endoct.fusion.registration.rigidity import STEP_MM, in_one_frame, parts_out_of_place
from endoct.fusion.registration.search import rims, search
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import PanoramaOutline

__all__ = ["Alignment", "NotAligned", "align", "align_sides", "orientations_of"]

FARTHEST = 0.5, 2.0
"""The farthest scales that are looked at: a pitch stated at half of what it is, or at twice."""
BELIEVABLE = 0.18
"""Least confidence of an alignment that is believed."""
LIKELY_CHANCE = 1e-4
"""A place that chance would give more often than this is not believed.

Tuning specimens (benchmarks/confidence.py) say how the two part. 120 wrong and 32 featureless pairs had a confidence of
0.145 at most and a chance of 6e-4 at least. 23 of 24 true ones had 0.225 at least and 2e-5 at most."""
CLEAR_RATIO, RARE_CHANCE = 1.4, 1e-5
"""A place found by rims is believed with less confidence where it beats the next best, and chance, by these.

The search by rims put all of 52 pairs in place, of which that by cells declined six (seeds 9300-9309 of quick, hard,
mastoid, and few, floors, sound, tiny of benchmarks/independent). Of 900 wrong pairs of these it put none where chance
would less often than 3e-4, and none above a ratio of 1.44 where chance would less often than 0.03."""
CLEAR_BY_EYE = 0.4, 1e-5
"""Least confidence and largest chance of a place that only cells seen by an eye tell.

Of 500 wrong pairs one had a confidence of 0.30 at a chance of 3e-5. Of 19 true pairs that nothing else aligned, 15 had
0.47 and 1e-8 or better. Seeds 9300–9335 of `quick`, `hard`, `mastoid`, and few, floors, sound, tiny, specks, many."""


def orientations_of(a: Panorama | PanoramaOutline, b: Panorama | PanoramaOutline) -> tuple[Orientation, ...]:
    """Return the orientations (mirrored, z_reversed) that what is known of two sides leaves open.

    With the direction of travel unknown all four: from its other end the wall is mirrored as well.
    """
    if not (a.travel_known and b.travel_known):
        return ALL_ORIENTATIONS
    return ALL_ORIENTATIONS[:1] if a.handedness_known and b.handedness_known else ALL_ORIENTATIONS[:2]


def believable(alignment: Alignment) -> bool:
    """Whether ``alignment`` stands out enough to be believed."""
    return alignment.confidence >= BELIEVABLE and alignment.chance <= LIKELY_CHANCE


@dataclass(frozen=True)
class RoughAlignment:
    """Where a search puts B: the ``place`` that is believed, if any, what it was found by, and the ``best`` of all."""

    place: Alignment | None
    best: Alignment | None = None
    by: Literal["evidence", "rims", "drawing"] = "evidence"


def find_sides(a: Side, b: Side, *, z_scale_range: tuple[float, float] = (0.95, 1.05)) -> RoughAlignment:
    """Return where ``b`` lies on ``a``, as far as a search tells, in every orientation that the two leave open.

    A mask drawn on the samples of the other side lies there, without a search.
    """
    if a.is_drawn_on(b) or b.is_drawn_on(a):
        exact = as_covariance(np.zeros((3, 3)))
        alike = correlation(a.evidence, b.evidence)
        return RoughAlignment(replace(IN_PLACE, confidence=1.0, correlation=alike, covariance=exact), by="drawing")
    return find_place(a.evidence, b.evidence, orientations_of(a.panorama, b.panorama), z_scale_range)


def align_sides(
    a: Side,
    b: Side,
    *,
    z_scale_range: tuple[float, float] = (0.95, 1.05),
    force: bool = False,
    rough: RoughAlignment | None = None,
    by_eye: tuple[Evidence, Evidence] | None = None,
) -> SearchOutcome:
    """Return where ``b`` lies on ``a`` as :func:`align` does, in every orientation that the two leave open.

    ``rough``: by :func:`find_sides`, where that was asked before. ``by_eye``: evidence on the samples of either side
    that tells more than its own, as the probability of a cell by a learned eye. It is searched where the sides' own
    does not tell, and refines a place at which it agrees better than their own.
    """
    rough = rough or find_sides(a, b, z_scale_range=z_scale_range)
    if rough.by == "drawing":
        return SearchOutcome(rough.place)
    orientations = orientations_of(a.panorama, b.panorama)
    own = evidence = a.evidence, b.evidence
    if by_eye is not None and "probability" in (by_eye[0].kind, by_eye[1].kind):
        if rough.by == "rims" or rough.place is None:
            best = search(clipped(by_eye[0]), clipped(by_eye[1]), orientations, z_scale_range)
            if best and best.confidence >= CLEAR_BY_EYE[0] and best.chance <= CLEAR_BY_EYE[1]:
                rough = RoughAlignment(best, best)
        if rough.place and _agreement(rough.place, *by_eye) > abs(_agreement(rough.place, *own)):
            evidence = by_eye
    outcome = SearchOutcome.of(
        align(*evidence, orientations=orientations, z_scale_range=z_scale_range, force=force, rough=rough)
    )
    farther = outcome.best and fit_stretched(*evidence, orientations, z_scale_range)
    if farther is None:
        return outcome
    agreeing = remedies(a, b, farther.z_scale)
    return replace(outcome, reason=outcome.reason + _if_stretched(b, farther, agreeing), remedies=agreeing)


def find_place(
    a: Evidence, b: Evidence, orientations: tuple[Orientation, ...], z_scale_range: tuple[float, float]
) -> RoughAlignment:
    """Return where ``b`` lies on ``a`` by a search of the evidence; where that is not believed, by rims of cells."""
    of_a, of_b = clipped(a), clipped(b)
    best = search(of_a, of_b, orientations, z_scale_range)
    if best is None or believable(best):
        return RoughAlignment(best, best)
    by_rims = search(rims(of_a), rims(of_b), orientations, z_scale_range)
    if by_rims and (believable(by_rims) or (by_rims.ratio >= CLEAR_RATIO and by_rims.chance <= RARE_CHANCE)):
        return RoughAlignment(by_rims, best, "rims")
    return RoughAlignment(None, best)


def align(
    a: Evidence,
    b: Evidence,
    *,
    orientations: tuple[Orientation, ...] = ALL_ORIENTATIONS,
    z_scale_range: tuple[float, float] = (0.95, 1.05),
    force: bool = False,
    rough: RoughAlignment | None = None,
) -> Alignment | NotAligned:
    """Return where ``b`` lies on ``a``, to a fraction of a sample, or why that cannot be said.

    ``force`` believes the best place however little it stands out. ``rough``: where it is known already, roughly.
    """
    rough = rough or find_place(a, b, orientations, z_scale_range)
    best = rough.best
    place = rough.place or (best if force else None)
    refined = place and _refined(place, a, b, z_scale_range, by_rims=rough.by == "rims")
    if refined:
        return corrected_for_instruments(refined, a, b) if (a.kind == "relief") != (b.kind == "relief") else refined
    if best is None:
        return NotAligned("The two sides share no structure: at least one shows no cells.")
    reason = (
        f"No place of one side on the other stands out: the best correlates at {abs(best.correlation):.2f}, its "
        f"score is {best.ratio:.2f} times the runner-up's, and chance would give as much with a probability of "
        f"{best.chance:.1g}."
    )
    ruled_out = _turned(clipped(a), clipped(b), orientations, z_scale_range)
    return NotAligned(reason + (_if_turned(ruled_out) if ruled_out else ""), best, ruled_out)


def _refined(
    place: Alignment, a: Evidence, b: Evidence, z_scale_range: tuple[float, float], *, by_rims: bool
) -> Alignment | None:
    """Return ``place`` to a fraction of a sample, and how it bends; None where rims align what shares no wall."""
    if by_rims:
        return with_evidence(refine(rims(clipped(a)), rims(clipped(b)), place, z_scale_range), a, b)
    turned = place.correlation < 0 and "darkness" in (a.kind, b.kind)
    if turned:  # bright cells: clipping has cut away just what distinguishes them from the wall
        a, b = (a, brightness(b)) if b.kind == "darkness" else (brightness(a), b)
    refined = refine(clipped(a), clipped(b), place, z_scale_range)
    refined = replace(refined, correlation=-refined.correlation) if turned else refined
    return replace(refined, bend=find_bend(clipped(a), clipped(b), refined)) if believable(place) else refined


def fit_stretched(
    a: Evidence, b: Evidence, orientations: tuple[Orientation, ...], z_scale_range: tuple[float, float]
) -> Alignment | None:
    """Return where ``b`` lies on ``a`` best at a scale of z beyond ``z_scale_range``.

    None where no place stands out, or ``b`` does not lie there as one piece. Lost slices or frames shorten a recording
    too, and no scale makes them good.
    """
    farther = stretched(clipped(a), clipped(b), orientations, z_scale_range)
    if farther is None or not believable(farther) or parts_out_of_place(a, b, farther):
        return None
    return farther


def stretched(
    a: Evidence, b: Evidence, orientations: tuple[Orientation, ...], searched: tuple[float, float]
) -> Alignment | None:
    """Return where ``b`` lies on ``a`` best at a scale from ``FARTHEST``, refined; None where that is ``searched``."""
    farthest = min(FARTHEST[0], searched[0]), max(FARTHEST[1], searched[1])
    best = search(a, b, orientations, farthest)
    if best is None:
        return None
    refined = refine(a, b, best, farthest)
    return None if searched[0] < refined.z_scale < searched[1] else refined


def remedies(a: Side, b: Side, z_scale: float) -> tuple[Remedy, ...]:
    """Return the values that would agree where ``b`` fits ``a`` once its z is multiplied by ``z_scale``.

    A side whose scale its own recording bears out is not suspected, unless both are borne out. Empty where no single
    key sets the scale of a suspected side.
    """
    factors = (a, 1 / z_scale), (b, z_scale)
    suspected = [(side, by) for side, by in factors if not side.panorama.axial_scale.checked or side.panorama.doubts]
    return tuple(
        Remedy(side.name, key, value, value * factor)
        for side, factor in suspected or factors
        for key, value in side.panorama.axial_scale.stated.items()
    )


def _turned(
    a: Evidence, b: Evidence, orientations: tuple[Orientation, ...], z_scale_range: tuple[float, float]
) -> Alignment | None:
    """Return the best place in an orientation that would have been believed but for the sidecars; None without one."""
    ruled_out = tuple(orientation for orientation in ALL_ORIENTATIONS if orientation not in orientations)
    best = search(a, b, ruled_out, z_scale_range) if ruled_out else None
    return best if best is not None and believable(best) else None


def _if_turned(ruled_out: Alignment) -> str:
    """Return a sentence on the orientation that would have been believed."""
    turned = " and ".join(["mirrored"] * ruled_out.mirrored + ["with z reversed"] * ruled_out.z_reversed)
    return f" {turned.capitalize()} they would align: check handedness and travel in the sidecars."


def _if_stretched(b: Side, farther: Alignment, agreeing: tuple[Remedy, ...]) -> str:
    """Return a sentence on the scale along the bore at which the two would have been believed."""
    values = " or ".join(map(str, agreeing)) or "a scale along the bore is wrong"
    return f" They would align with z of {b.name} scaled by {farther.z_scale:.3f}: {values}."


def align_by_method(a: Side, b: Side, name: str) -> SearchOutcome:
    """Return where ``b`` lies on ``a`` by the method ``name``, with how well the two correlate there.

    Raises :class:`EndoctError` where there is no such method, it fails, or its answer is no alignment.
    """
    answer = answer_by("alignment", name, a.panorama, b.panorama, setting="alignment_method")
    if isinstance(answer, NotAligned):
        return SearchOutcome.of(answer)
    if not isinstance(answer, Alignment) or not _is_possible(answer):
        raise EndoctError(
            f"the alignment method '{name}' answers no alignment",
            found=repr(answer)[:100] if isinstance(answer, Alignment) else type(answer).__name__,
            expected="an Alignment of finite turn, shift and scale, or NotAligned",
        )
    shared = with_evidence(answer, a.evidence, b.evidence)
    reason = f"As the method '{name}' lays {b.name} on {a.name}, the two share no wall."
    return SearchOutcome(shared) if shared else SearchOutcome(None, reason=reason)


def with_evidence(alignment: Alignment, a: Evidence, b: Evidence) -> Alignment | None:
    """Return ``alignment`` with how well the two correlate there; None where they share no wall."""
    along_mm = alignment.z_to_a(b.z_mm)
    first_mm, last_mm = max(a.z_mm[0], along_mm.min()), min(a.z_mm[-1], along_mm.max())
    if last_mm - first_mm < 2 * STEP_MM:
        return None
    there_a, there_b = in_one_frame(clipped(a), clipped(b), alignment, 0.0)
    shared_mm2 = float((there_a.valid & there_b.valid).sum()) * STEP_MM * there_a.column_mm
    return replace(alignment, correlation=correlation(there_a, there_b), overlap_mm2=shared_mm2)


def _agreement(place: Alignment, a: Evidence, b: Evidence) -> float:
    """Return the correlation of the two at ``place``; 0 where they share no wall."""
    there = with_evidence(place, a, b)
    return there.correlation if there else 0.0


def _is_possible(alignment: Alignment) -> bool:
    placed = alignment.theta_shift_rad, alignment.z_shift_mm, alignment.z_scale
    return bool(np.isfinite(placed).all()) and alignment.z_scale > 0
