"""What is to be said first of a comparison: whether the sides were aligned, how surely, and how they lie."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from endoct.base.doubt import Doubt
from endoct.fusion.result import Result, StoredAlignment
from endoct.workbench.report.tables import by_hand_headline, by_hand_sentences
from endoct.workbench.report.wording import length_text, without_stop

LEAST_UNEVEN_DEG = 1.0
"""Unevenness below this is not worth a sentence."""

Level = Literal["trusted", "doubted", "unaligned"]


@dataclass(frozen=True)
class Verdict:
    """How far a result is to be trusted: ``level``, a ``headline`` in a sentence, and ``sentences`` that explain it.

    ``they_say``: what these are about, as the title of what unfolds.
    """

    level: Level
    headline: str
    sentences: tuple[str, ...] = ()
    they_say: str = "How they lie"


def verdict_of(result: Result) -> Verdict:
    """Return the verdict on a comparison: "trusted" only where nothing was forced and nothing is doubted."""
    alignment = result.alignment if result.aligned else None
    if alignment is None:
        why = (
            f"Reason: {without_stop(result.reason)}. Without an alignment no place on one side corresponds to a place "
            "on the other: the two are not scored against each other, and each is shown by itself."
        )
        return Verdict("unaligned", "Not aligned: the two sides could not be brought onto each other.", (why,))
    how = placement(*result.sides, alignment)
    if result.by_hand is not None and result.by_hand.corrected:
        return Verdict("doubted", by_hand_headline(result.by_hand), (*by_hand_sentences(result.by_hand), how))
    checked = () if result.by_hand is None else by_hand_sentences(result.by_hand)
    if result.doubts or result.forced:
        said = f", with {count_doubts(result.doubts)}" if result.doubts else ""
        headline = f"Alignment forced{said}." if result.forced else f"Aligned{said}."
        return Verdict("doubted", headline, (f"Aligned {strength(alignment)}", *checked, how))
    return Verdict("trusted", f"Aligned {strength(alignment)}", (*checked, how))


def recording_verdict(doubts: Sequence[Doubt]) -> Verdict:
    """Return the verdict on a recording by itself."""
    if doubts:
        return Verdict("doubted", f"Unrolled, with {count_doubts(doubts)}.")
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
        f"{' and '.join(turns) if turns else 'neither mirrored nor reversed'}.{_unevenness(alignment)}"
    )


def _unevenness(alignment: StoredAlignment) -> str:
    """Say what the alignment found of uneven rotation and left as it is."""
    uneven_deg = math.degrees(alignment.uneven_rad or 0.0)
    if uneven_deg < LEAST_UNEVEN_DEG:
        return ""
    return (
        f" Around θ the two depart smoothly from that turn, by up to {uneven_deg:.1f}°, as uneven rotation of a "
        "catheter or a probe off the axis make them; this is not corrected and costs overlap."
    )
