"""The verdict: the answer in a sentence, doubts before praise, and green only where the score is known as well."""

from typing import Any

import pytest

from endoct.base.doubt import Doubt
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import CellScores, Overlap, PairScores, Result, StoredAlignment
from endoct.workbench.report.verdict import WIDEST_INTERVAL, placement, recording_verdict, strength, verdict_of

CELLS = CellScores(reference="endoscope", other="oct", of_reference=23, of_other=27, matched=12)
NARROW = (0.6, 0.6 + WIDEST_INTERVAL - 0.01)

AREAS = {"both_mm2": 4.14, "only_a_mm2": 1.5, "only_b_mm2": 0.36}


def result(interval: tuple[float, float] | None = NARROW, cells: CellScores | None = CELLS, **changed: Any) -> Result:
    alignment = StoredAlignment.of(Alignment(1.5, -0.4321, 1.0, confidence=0.49, correlation=0.9, ratio=3.0))
    made = Result(
        sides=("endoscope", "oct"),
        aligned=True,
        alignment=alignment,
        jaccard=0.691,
        dice=0.8,
        scores=PairScores(grid=Overlap(jaccard=0.691, dice=0.8, jaccard_interval=interval, **AREAS), cells=cells),
        valid_fraction=0.99,
    )
    return made.model_copy(update=changed)


def test_the_answer_is_one_sentence_without_confidence() -> None:
    verdict = verdict_of(result())
    assert verdict.level == "trusted"
    assert verdict.headline == (
        "Aligned and trusted. Jaccard 0.69 (0.60–0.79): 4.14 of 6 mm² of cells agree, "
        "12 pairs of cells among 23 (endoscope) and 27 (oct) that both sides observed."
    )
    assert any("confidence 0.49" in sentence for sentence in verdict.sentences)


@pytest.mark.parametrize("doubts", [1, 2])
def test_doubts_come_before_praise(doubts: int) -> None:
    verdict = verdict_of(result(doubts=tuple(Doubt("odd", "Odd.") for _ in range(doubts))))
    assert verdict.level == "doubted"
    assert verdict.headline.startswith(f"{doubts} doubt{'s' if doubts > 1 else ''}. Aligned. Jaccard 0.69")


@pytest.mark.parametrize(
    ("interval", "level", "why"),
    [
        ((0.6, 0.8 + 1e-9), "uncertain", "0.20 wide"),
        ((0.55, 0.83), "uncertain", "0.28 wide"),
        (None, "uncertain", "too few places"),
        (NARROW, "trusted", ""),
    ],
)
def test_a_score_that_is_hardly_known_is_not_green(interval: tuple[float, float] | None, level: str, why: str) -> None:
    verdict = verdict_of(result(interval))
    assert verdict.level == level
    assert ("the score is uncertain" in verdict.headline) == (level == "uncertain")
    assert any(why in sentence for sentence in verdict.sentences)
    assert ("interval not known" in verdict.headline) == (interval is None)


def test_what_was_forced_is_said_to_be() -> None:
    verdict = verdict_of(result(parameters={"compare": {"force": True}}))
    assert (verdict.level, verdict.headline[:18]) == ("doubted", "Alignment forced. ")


def test_no_cell_is_no_score() -> None:
    verdict = verdict_of(result(jaccard=None, dice=None, scores=None))
    assert verdict.level == "uncertain"
    assert verdict.headline.endswith("Neither side has a cell where both observed the wall.")


def test_one_cell_agrees() -> None:
    assert (
        "1 pair of cells among 2 (endoscope)"
        in verdict_of(result(cells=CellScores(of_reference=2, of_other=1, matched=1))).headline
    )


def test_a_recording_is_green_only_without_doubts() -> None:
    assert recording_verdict(()).level == "trusted"
    assert recording_verdict((Doubt("odd", "Odd."),)).headline == "1 doubt. Unrolled."


def test_where_one_side_lies_is_said_in_degrees_and_mm() -> None:
    alignment = StoredAlignment.of(Alignment(1.5, -0.4321, 1.02, confidence=0.49, correlation=-0.9, ratio=3.04))
    assert strength(alignment) == "with confidence 0.49 (correlation −0.90, 3.0 times the runner-up)."
    assert strength(alignment.model_copy(update={"ratio": None})) == "with confidence 0.49."
    said = (
        "oct lies in the frame of endoscope turned by 85.94° and shifted by −0.432 mm along the bore, its z scaled by "
        "1.0200; neither mirrored nor reversed."
    )
    assert placement("endoscope", "oct", alignment) == said
    turned = alignment.model_copy(update={"mirrored": True, "z_reversed": True, "uneven_rad": 0.0174})
    assert placement("a", "b", turned).endswith("mirrored in θ and reversed in z.")
    uneven = turned.model_copy(update={"z_reversed": False, "uneven_rad": 0.0176})
    assert "; mirrored in θ. Around θ the two depart smoothly from that turn, by up to 1.0°" in placement(
        "a", "b", uneven
    )
