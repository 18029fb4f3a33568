"""What a report says first of a comparison: its doubts, whether the sides were aligned, how far they agree."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from endoct.base.doubt import Doubt
from endoct.fusion.result import CellScores, Overlap, Result, StoredAlignment
from endoct.workbench.report.tables import by_hand_headline, by_hand_sentences
from endoct.workbench.report.wording import length_text, without_stop

LEAST_UNEVEN_DEG = 1.0
"""Unevenness below this is not worth a sentence."""

WIDEST_INTERVAL = 0.2
"""A Jaccard index whose 95 % interval is wider is uncertain: beyond ±0.1 not even its first decimal is known."""

Level = Literal["trusted", "uncertain", "doubted", "unaligned"]


@dataclass(frozen=True)
class Verdict:
    """How far a result is to be trusted: ``level``, a ``headline`` in a sentence, and ``sentences`` that explain it.

    ``explains``: what these are about, as the title of what unfolds.
    """

    level: Level
    headline: str
    sentences: tuple[str, ...] = ()
    explains: str = "How they were aligned and compared"


def verdict_of(result: Result) -> Verdict:
    """Return the verdict on a comparison, its doubts before how far the sides agree.

    It is "trusted" only where nothing was forced, nothing is doubted, and the Jaccard index is certain: its interval
    is at most :data:`WIDEST_INTERVAL` wide. Where that is wider, or not known, it is "uncertain".
    """
    alignment = result.alignment if result.aligned else None
    if alignment is None:
        why = (
            f"Reason: {without_stop(result.reason)}. Without an alignment no place on one side corresponds to a place "
            "on the other: the two are not scored against each other, and each is shown by itself."
        )
        return Verdict("unaligned", "Not aligned: the two sides could not be brought onto each other.", (why,))
    how, agree = placement(*result.sides, alignment), agreement(result)
    if result.by_hand is not None and result.by_hand.corrected:
        headline = f"{by_hand_headline(result.by_hand)} {agree}"
        return Verdict("doubted", headline, (*by_hand_sentences(result.by_hand), how))
    checked = () if result.by_hand is None else by_hand_sentences(result.by_hand)
    expected = () if result.bounds is None else (result.bounds.sentence,)
    sentences = (*expected, f"Aligned {strength(alignment)}", *checked, how)
    if result.doubts or result.forced:
        doubts = f"{count_doubts(result.doubts)}. " if result.doubts else ""
        return Verdict("doubted", f"{doubts}{'Alignment forced' if result.forced else 'Aligned'}. {agree}", sentences)
    if why := _uncertain(result.overlap):
        return Verdict("uncertain", f"Aligned, but the score is uncertain. {agree}", (why, *sentences))
    return Verdict("trusted", f"Aligned and trusted. {agree}", sentences)


def agreement(result: Result) -> str:
    """Return how far two aligned sides agree: "Jaccard 0.69 (0.60–0.79): 3.1 of 4.5 mm² of cells agree, …"."""
    overlap = result.overlap
    if overlap is None or overlap.is_empty:
        return "Neither side has a cell where both observed the wall."
    interval = overlap.jaccard_interval
    between = "interval not known" if interval is None else f"{interval[0]:.2f}–{interval[1]:.2f}"
    counted = _matched_cells(result.scores.cells if result.scores else None, result.sides)
    return f"Jaccard {overlap.jaccard:.2f} ({between}){_agreed_area(overlap)}{counted}."


def _agreed_area(overlap: Overlap) -> str:
    areas_mm2 = overlap.both_mm2, overlap.only_a_mm2, overlap.only_b_mm2
    if None in areas_mm2:
        return ""
    both_mm2, *alone_mm2 = (area_mm2 or 0.0 for area_mm2 in areas_mm2)
    return f": {both_mm2:.3g} of {both_mm2 + sum(alone_mm2):.3g} mm² of cells agree"


def _matched_cells(cells: CellScores | None, sides: tuple[str, str]) -> str:
    if cells is None or cells.matched is None:
        return ""
    counts = zip((cells.of_reference, cells.of_other), sides, strict=True)
    of = " and ".join(f"{count} ({side})" for count, side in counts)
    return f", {cells.matched} pair{'s' if cells.matched != 1 else ''} of cells among {of} that both sides observed"


def _uncertain(overlap: Overlap | None) -> str:
    """Return why the Jaccard index is uncertain; "" where it is not."""
    if overlap is None or overlap.is_empty:
        return "The score is uncertain: there is no cell to score."
    if overlap.jaccard_interval is None:
        return "The score is uncertain: there are too few places with cells for an interval."
    low, high = overlap.jaccard_interval
    if high - low <= WIDEST_INTERVAL:
        return ""
    return (
        f"The score is uncertain: its 95 % interval is {high - low:.2f} wide; at most {WIDEST_INTERVAL:g} is trusted."
    )


def recording_verdict(doubts: Sequence[Doubt]) -> Verdict:
    """Return the verdict on a recording by itself."""
    if doubts:
        return Verdict("doubted", f"{count_doubts(doubts)}. Unrolled.")
    return Verdict("trusted", "Unrolled; nothing speaks against it.")


def count_doubts(doubts: Sequence[object]) -> str:
    """Return "1 doubt" or "2 doubts"."""
    return f"{len(doubts)} doubt{'s' if len(doubts) != 1 else ''}"


def strength(alignment: StoredAlignment) -> str:
    """Return how far an alignment stands out: "with confidence 0.63 (…)."."""
    said = f"with confidence {alignment.confidence:.2f}"
    if alignment.correlation and alignment.ratio:
        correlation = f"{alignment.correlation:.2f}".replace("-", "−")
        said += f" (correlation {correlation}, {alignment.ratio:.1f} times the runner-up)"
    return said + "."


def placement(a: str, b: str, alignment: StoredAlignment) -> str:
    """Return where ``b`` lies in the frame of ``a``, in a sentence or two."""
    turns = ["mirrored in θ"] * alignment.mirrored + ["reversed in z"] * alignment.z_reversed
    return (
        f"{b} lies in the frame of {a} turned by {math.degrees(alignment.theta_shift_rad):.2f}° and shifted by "
        f"{length_text(alignment.z_shift_mm)} along the bore, its z scaled by {alignment.z_scale:.4f}; "
        f"{' and '.join(turns) if turns else 'neither mirrored nor reversed'}."
        f"{_bend(alignment)}{_unevenness(alignment)}"
    )


def _bend(alignment: StoredAlignment) -> str:
    """Say how far the alignment departs from that along the bore."""
    if alignment.bend is None:
        return ""
    along_mm, roll_rad = (max(map(abs, part)) for part in (alignment.bend.shift_mm, alignment.bend.roll_rad))
    said = f"{length_text(along_mm)} along and {math.degrees(roll_rad):.1f}° around"
    return f" From there it bends along the bore, by up to {said}."


def _unevenness(alignment: StoredAlignment) -> str:
    """Say what the alignment found of uneven rotation and left as it is."""
    uneven_deg = math.degrees(alignment.uneven_rad or 0.0)
    if uneven_deg < LEAST_UNEVEN_DEG:
        return ""
    return (
        f" Around θ the two depart smoothly from that turn, by up to {uneven_deg:.1f}°, as uneven rotation of a "
        "catheter or a probe off the axis make them; this is not corrected and costs overlap."
    )
