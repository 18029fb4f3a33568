"""What speaks against an alignment that landmark pairs corrected or established: first of all, that they did."""

from collections.abc import Iterator
from math import hypot

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.registration.by_hand import CHECK_PAIRS, orientation_text
from endoct.fusion.result import ByHand, PlacedPair
from endoct.stitching.doubt import Doubt

LARGEST_MISFIT = 3.0
"""Pairs that lie farther apart than so many times their standard error do not fit one rigid alignment."""


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
