"""Gaps in the numbering of image files become gaps in place, and are told."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from endoct.modalities.reading.numbering import Along, notes_on_gaps, positions_along, spacing_of
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


def along(values: list[float], unit: Literal["", "mm", "s"] = "s", *, decimal: bool = False) -> Along:
    return Along(np.array(values), unit, "time stamps", decimal)


@pytest.mark.parametrize(
    ("rate_hz", "places_mm"),
    [
        (10.0, (0, 0.2, 0.4, 1.0, 1.2, 1.4)),  # as stamped: 0.1 s a pitch
        (10.19, (0, 0.2, 0.4, 1.0, 1.2, 1.4)),  # whole numbers of steps keep what they count
        (25.0, (0, 0.2, 0.4, 1.0, 1.2, 1.4)),
        (None, (0, 0.2, 0.4, 1.0, 1.2, 1.4)),
    ],
)
def test_a_gap_in_time_counts_steps_whatever_rate_is_stated(rate_hz: float | None, places_mm: tuple[float]) -> None:
    found, remarks = positions_along(along([5.0, 5.1, 5.2, 5.5, 5.6, 5.7]), 0.2, rate_hz)
    assert found == pytest.approx(places_mm)
    assert remarks.doubts == remarks.notes == ()


UNEVEN = [0.0, 0.1, 0.2, 0.37, 0.4, 0.5, 0.63, 0.73]
"""The usual step is 0.1 s, the median."""


@pytest.mark.parametrize(
    ("rate_hz", "a_second_mm"),
    [
        (None, 2.0),  # a pitch of 0.2 mm in the usual 0.1 s
        (10.1, 0.2 * 10.1),  # less than 2 % off: stamps are of that rate, which is the more exact
        (9.9, 0.2 * 9.9),
        (10.3, 2.0),  # of another rate: the stamps' own counts
        (9.7, 2.0),
        (25.0, 2.0),
    ],
)
def test_a_stated_rate_against_time_stamps(rate_hz: float | None, a_second_mm: float) -> None:
    found, remarks = positions_along(along(UNEVEN), 0.2, rate_hz)
    assert found == pytest.approx(tuple(a_second_mm * np.array(UNEVEN)))
    assert [doubt.code for doubt in remarks.doubts] == ["frames-uneven"]


def test_where_speed_is_steady_the_stated_rate_says_how_far() -> None:
    found, remarks = positions_along(along([value + 3 for value in UNEVEN]), 0.2, 25.0, steady=True)
    assert found == pytest.approx(tuple(0.2 * 25 * np.array(UNEVEN)))
    assert remarks.doubts == ()
    assert "placed by time stamps" in remarks.notes[0]
    assert [doubt.code for doubt in positions_along(along(UNEVEN), 0.2, None, steady=True)[1].doubts] == [
        "frames-uneven"
    ]


def test_counts_and_times_that_go_back_place_nothing() -> None:
    for values in (along([1, 2, 3, 7.5, 8, 9.1], ""), along([0.0, 0.1, 0.05, 0.2])):
        found, remarks = positions_along(values, 0.2)
        assert found is None
        assert [doubt.code for doubt in remarks.doubts] == ["frames-uneven"]


def test_uneven_millimetres_are_places() -> None:
    found, remarks = positions_along(along([1.0, 1.2, 1.5, 1.6, 2.2], "mm"), 0.25)
    assert found == pytest.approx((0, 0.2, 0.5, 0.6, 1.2))
    assert "uneven places in mm" in remarks.notes[0]


@pytest.mark.parametrize(
    ("pitch_mm", "doubted"), [(0.2, False), (0.191, False), (0.209, False), (0.19, True), (0.3, True)]
)
def test_millimetres_in_names_against_the_pitch(pitch_mm: float, doubted: bool) -> None:
    for one in (along([1.0, 1.2, 1.4, 1.6], "mm"), along([1.0, 1.2, 1.4, 1.6], "", decimal=True)):
        found, remarks = positions_along(one, pitch_mm)
        assert found is None
        assert [doubt.code for doubt in remarks.doubts] == ["names-against-pitch"] * doubted
        assert [(doubt.value, doubt.expected) for doubt in remarks.doubts] == [(pytest.approx(0.2), pitch_mm)] * doubted
    assert positions_along(along([1.0, 1.2, 1.4, 1.6], "s"), pitch_mm)[1].doubts == ()  # seconds are no pitch


@pytest.mark.parametrize(("last", "doubted"), [(11, False), (13, True)])
def test_more_missing_than_there_is_may_be_another_count(last: int, doubted: bool) -> None:
    """Three times as many places as frames are allowed: 12 of 4."""
    numbers = [0.0, 1.0, 2.0, last]
    found, remarks = positions_along(along(numbers, ""), 0.5)
    assert found == pytest.approx(tuple(0.5 * np.array(numbers)))
    assert [doubt.code for doubt in remarks.doubts] == ["frames-mostly-missing"] * doubted
    if doubted:
        assert (remarks.doubts[0].value, remarks.doubts[0].expected) == (14, 4)
        assert "10 frames are missing between 4" in remarks.doubts[0].what


@pytest.mark.parametrize(
    ("values", "resolution", "kind"),
    [
        ([0.0, 0.1, 0.21, 0.3, 0.4], 0.001, "even"),  # jitter of a fine clock
        ([0, 10, 21, 30, 40], 1.0, "uneven"),  # whole numbers of ten are exact
        ([0, 100, 201, 300, 400], 1.0, "even"),
        ([0.0, 1.0, 2.0, 3.0, np.nan], 0.0, "uneven"),
        ([0.0, 1.0, 2.0, 4.0, 5.0], 0.0, "gaps"),
        ([0.0, 1.0, 2.0, 2.0, 3.0], 0.0, "uneven"),
        ([3.0, 2.0, 1.0, 0.0], 0.0, "uneven"),
    ],
)
def test_how_values_are_spaced(values: list[float], resolution: float, kind: str) -> None:
    assert spacing_of(values, resolution).kind == kind


def test_a_drift_is_no_even_step() -> None:
    """Steps that grow by 1 % each end many steps off a line."""
    steps = 0.2 * 1.01 ** np.arange(60)
    assert spacing_of(np.concatenate([[0.0], np.cumsum(steps)])).kind == "uneven"


def test_few_frames_are_even() -> None:
    assert (spacing_of([2.0, 5.0]).kind, spacing_of([2.0, 5.0]).usual) == ("even", 3.0)
    assert (spacing_of([2.0]).usual, spacing_of([]).places.size) == (0.0, 0)


def test_the_widest_gap_is_told() -> None:
    (note,) = notes_on_gaps((0.0, -0.2, -0.6, -0.8, -1.0, -1.2, -2.0))  # travel may run back
    assert "in 2 places, at the widest 0.80 mm between frames 5 and 6" in note
    (note,) = notes_on_gaps((0.0, 0.2, 0.51, 0.71))
    assert "in 1 place, at the widest 0.31 mm between frames 1 and 2" in note
    assert notes_on_gaps((0.0, 0.2, 0.49, 0.69)) == ()  # 1.45 steps
    assert notes_on_gaps((0.0, 9.0)) == ()
