"""What a report says of an alignment that landmark pairs corrected or checked."""

from collections.abc import Iterator

from endoct.fusion.doubts_by_hand import pairs_text
from endoct.fusion.result import ByHand, Distances, PairDistance
from endoct.workbench.report.wording import NOTHING, length_text

ROLES = {"correct": "corrects", "check": "checks"}


def by_hand_headline(said: ByHand) -> str:
    """Return the headline of an alignment that pairs made: "Corrected by 3 landmark pairs; 2 others lie …"."""
    did = "Aligned by hand, by" if said.automatic_reason is not None else "Corrected by"
    return f"{did} {pairs_text(said)}; {_error(said.check)}."


def by_hand_sentences(said: ByHand) -> Iterator[str]:
    """Yield sentences on what pairs did and what they say."""
    if said.corrected and said.moved is not None:
        yield (
            f"By hand it was moved by {_signed(said.moved.along_mm)} along and {_signed(said.moved.around_mm)} around "
            "the bore, amid the pairs, against the automatic alignment."
        )
    if said.corrected and said.correct is not None:
        yield (
            f"The pairs that corrected it lie {length_text(said.correct.median_mm)} apart (median) since; that is no "
            "error of the alignment, which followed them."
        )
    if said.check is not None:
        error = _error(said.check)
        yield f"{error[:1].upper()}{error[1:]}."


def pair_rows(said: ByHand) -> list[list[str]]:
    """Return a row for each pair: what it does, and how far its places lay apart before and lie now."""
    return [
        [
            f"{number} {pair.name}".strip(),
            ROLES[pair.role] if said.corrected or pair.role == "check" else "would correct",
            *_distance(pair.before),
            *_distance(pair.after),
        ]
        for number, pair in enumerate(said.pairs, 1)
    ]


def _error(check: Distances | None) -> str:
    if check is None:
        return "no pair was set apart to check it, so that its error is not known"
    pairs = f"{check.pairs} pair{'s' * (check.pairs != 1)} that had no part in it"
    if check.pairs == 1:
        return f"1 pair that had no part in it lies {length_text(check.median_mm)} off"
    return f"{pairs} lie {length_text(check.median_mm)} off (median), {length_text(check.max_mm)} at most"


def _distance(distance: PairDistance | None) -> tuple[str, str]:
    if distance is None:
        return NOTHING, NOTHING
    return _signed(distance.around_mm), _signed(distance.along_mm)


def _signed(value_mm: float) -> str:
    return f"{value_mm:+.3f} mm".replace("-", "−")
