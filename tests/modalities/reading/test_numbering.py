"""Gaps in the numbering of image files become gaps in place, and are told."""

from pathlib import Path

import pytest

from endoct.modalities.reading.numbering import notes_on_gaps
from tests.modalities.numbered import positions_by_number


def files(*numbers: int) -> list[Path]:
    return [Path(f"frame_{number:04d}.png") for number in numbers]


def test_a_gap_keeps_its_length() -> None:
    assert positions_by_number(files(0, 1, 2, 5, 6, 7, 8), 0.2) == pytest.approx((0, 0.2, 0.4, 1.0, 1.2, 1.4, 1.6))


def test_numbering_may_count_in_steps() -> None:
    assert positions_by_number(files(10, 20, 30, 40, 50, 60, 80), 0.5) == pytest.approx((0, 0.5, 1, 1.5, 2, 2.5, 3.5))


@pytest.mark.parametrize(
    "numbers", [(3, 4, 5, 6), (0, 10, 20), (1, 5, 6, 90, 93), (8, 8, 8, 8), (0, 2)], ids=lambda n: str(n)
)
def test_even_or_unclear_numbering_says_nothing(numbers: tuple[int, ...]) -> None:
    assert positions_by_number(files(*numbers), 0.2) is None


def test_names_without_numbers_say_nothing() -> None:
    assert positions_by_number([Path("a.png"), Path("b.png"), Path("c.png")], 0.2) is None


def test_a_gap_is_told_with_its_place() -> None:
    (note,) = notes_on_gaps((0.0, 0.2, 0.4, 1.2, 1.4))
    assert "0.80 mm between frames 2 and 3" in note
    assert notes_on_gaps((0.0, 0.2, 0.4)) == ()
    assert notes_on_gaps(None) == ()
