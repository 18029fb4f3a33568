"""Which values of a drawn image are cell: two values, or labels on a stated ground; everything else is refused."""

from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.fusion.files.drawings import cells_by_palette, cells_in_colour, cells_of, minority

CELLS = np.zeros((12, 40), np.bool_)
CELLS[2:6, 4:9] = CELLS[7:11, 20:26] = True
COLOURS = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 0], [255, 255, 255]], np.uint8)
RED = COLOURS[CELLS.astype(np.uint8)]


def labelled(**of: int) -> np.ndarray:
    """Two cells of other numbers: the ``first``, and the ``second``."""
    numbers = np.zeros(CELLS.shape, np.int64)
    numbers[2:6, 4:9], numbers[7:11, 20:26] = of["first"], of["second"]
    return numbers


def refused(samples: Any) -> str:
    with pytest.raises(EndoctError, match=r"^m does not say what is cell; found") as raised:
        cells_of(samples, "m")
    return str(raised.value)


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8, np.uint16, np.int32, np.float32])
@pytest.mark.parametrize("value", [1, 200])
def test_two_values_of_which_one_is_0(value: int, dtype: type) -> None:
    np.testing.assert_array_equal(cells_of((CELLS * value).astype(dtype), "m"), CELLS)


@pytest.mark.parametrize(
    ("low", "high", "found"),
    [(1, 2, "values 1, 2, none of them 0"), (-1, 0, "values -1, 0;"), (0.2, 1, "values 0.2, 1, none of them 0")],
)
def test_two_values_that_name_no_ground(low: float, high: float, found: str) -> None:
    assert found in refused(np.where(CELLS, high, low))


@pytest.mark.parametrize("value", [0, 7])
def test_one_value_shows_no_cells(value: int) -> None:
    with pytest.raises(EndoctError, match=f"m shows no cells; found {value} everywhere"):
        cells_of(np.full((4, 6), value), "m")


@pytest.mark.parametrize(
    ("first", "second"),
    [(1, 2), (2, 1), (2, 4), (700, 812), (3, 200), (100_000, 5)],
    ids=["counted", "in any order", "one of two deleted", "a crop of more", "names", "beyond grey values"],
)
@pytest.mark.parametrize("dtype", [np.int64, np.float64])
def test_labels_of_regions_on_a_ground_of_0(first: int, second: int, dtype: type) -> None:
    np.testing.assert_array_equal(cells_of(labelled(first=first, second=second).astype(dtype), "m"), CELLS)


def test_a_region_that_the_seam_cuts_is_one_label() -> None:
    labels = labelled(first=300, second=500)
    labels[2:6, :3] = labels[2:6, 37:] = 900
    np.testing.assert_array_equal(cells_of(labels, "m"), labels > 0)


def test_names_stand_for_few_regions() -> None:
    grey = np.zeros((12, 40), np.uint8)
    for k in range(5):
        grey[3:6, 7 * k : 7 * k + 4] = (100, 200)[k % 2]
    assert "values 0, 100, 200;" in refused(grey)  # five regions, of two values
    np.testing.assert_array_equal(cells_of(grey[:, :28], "m"), grey[:, :28] > 0)


def test_labels_of_which_half_were_deleted_stand_for_many_regions() -> None:
    labels = np.zeros((12, 40), np.uint8)
    for k in range(5):
        labels[3:6, 7 * k : 7 * k + 4] = (2, 4)[k % 2]
    np.testing.assert_array_equal(cells_of(labels, "m"), labels > 0)
    assert "values 0, 2, 5;" in refused(np.where(labels == 4, 5, labels))


@pytest.mark.parametrize("white", [255, 65535])
def test_white_beside_grey_is_paint(white: int) -> None:
    assert f"values 0, 128, {white};" in refused(labelled(first=128, second=white))


def test_labels_that_touch() -> None:
    numbers = labelled(first=1, second=3)
    numbers[2:6, 6:9] = 2  # the first cell is cut in two
    np.testing.assert_array_equal(cells_of(numbers, "m"), CELLS)


@pytest.mark.parametrize("factor", [1, 85])
def test_votes_enclose_each_other(factor: int) -> None:
    votes = np.zeros((12, 40), np.uint8)
    votes[1:9, 3:15] = 1
    votes[2:8, 5:13] = 2
    votes[3:7, 7:11] = 3
    assert "values 0, " in refused(votes * factor)
    # also where the edges of two drawings meet
    votes[...] = 0
    votes[2:10, 4:10] += 1
    votes[2:10, 7:13] += 1
    assert "values 0, " in refused(np.where(np.arange(40) < 20, votes, 0) * factor)


def test_votes_that_differ_at_two_edges_alone() -> None:
    votes = np.zeros((12, 40), np.uint8)
    votes[1:11, 3:13] += 1
    votes[1:11, 5:15] += 1  # 16 of the 36 edges of what both drew are on the ground
    assert "values 0, 1, 2;" in refused(votes)


def test_single_samples_at_the_edge_of_a_cell_are_no_labels() -> None:
    labels = np.where(CELLS, 1, 0)
    labels[2, 9], labels[4, 9], labels[7, 26] = 2, 3, 4
    assert "5 values from 0 to 4" in refused(labels)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int64, np.float32])
def test_edges_that_fade_are_neither_cell_nor_ground(dtype: type) -> None:
    rows, columns = np.mgrid[:40, :120]
    far = np.hypot(rows - 20.3, columns - 60.7)
    for width in (1, 4):
        share = np.clip((10 - far) / width + 0.5, 0, 1)
        assert "values from 0 to 255" in refused((share * 255).astype(dtype))


def test_shares_of_1_are_probabilities() -> None:
    assert "values 0, 0.5, 1;" in refused(labelled(first=1, second=2) / 2)


def test_a_picture_of_the_wall() -> None:
    grey = np.random.default_rng(1).integers(1, 200, (40, 60))
    grey[3] = 0
    for dtype in (np.uint8, np.int64):
        assert "values from 0 to 199" in refused(grey.astype(dtype))
    assert "values from 0 to" in refused(np.where(grey > 150, grey, 0))


def test_numbers_that_are_not_finite() -> None:
    assert "NaN or infinity" in refused(np.where(CELLS, np.nan, 0))


def of_colours(samples: np.ndarray) -> str:
    with pytest.raises(EndoctError, match=r"^m does not say what is cell; found") as raised:
        cells_in_colour(samples, "m")
    return str(raised.value)


def test_one_colour_on_black() -> None:
    np.testing.assert_array_equal(cells_in_colour(RED, "m"), CELLS)
    np.testing.assert_array_equal(cells_in_colour(np.where(RED > 0, np.uint16(256), np.uint16(0)), "m"), CELLS)
    np.testing.assert_array_equal(cells_in_colour(RED / np.float32(300), "m"), CELLS)


def test_grey_in_three_channels_is_grey() -> None:
    np.testing.assert_array_equal(cells_in_colour(np.stack([labelled(first=1, second=2)] * 3, -1), "m"), CELLS)


def test_colours_that_name_no_ground() -> None:
    assert "3 colours;" in of_colours(COLOURS[labelled(first=1, second=2)])
    alike = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 256]], np.uint16)
    assert "3 colours;" in of_colours(alike[labelled(first=1, second=2)])
    soft = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], np.float32)
    assert "3 colours;" in of_colours(soft[labelled(first=1, second=2)])
    assert "2 colours, none of them black" in of_colours(COLOURS[1 + CELLS.astype(int)])


def with_opacity(colours: np.ndarray, opacity: Any) -> np.ndarray:
    return np.concatenate([colours, np.broadcast_to(opacity, CELLS.shape)[..., np.newaxis]], axis=2).astype(np.uint8)


@pytest.mark.parametrize("opaque", [255, 90])
def test_opacity_is_the_ground_where_it_differs(opaque: int) -> None:
    white = np.full((*CELLS.shape, 3), 255)
    np.testing.assert_array_equal(cells_in_colour(with_opacity(RED, opaque), "m"), CELLS)  # the same everywhere
    np.testing.assert_array_equal(cells_in_colour(with_opacity(white, CELLS * opaque), "m"), CELLS)
    grey = np.stack([np.where(CELLS, 0, 17), CELLS * opaque], axis=2)
    np.testing.assert_array_equal(cells_in_colour(grey, "m"), CELLS)


def test_opacity_of_several_kinds() -> None:
    white = np.full((*CELLS.shape, 3), 255)
    assert "3 degrees of transparency" in of_colours(with_opacity(white, labelled(first=128, second=255)))
    assert "2 degrees of transparency" in of_colours(with_opacity(white, np.where(CELLS, 255, 100)))
    two = COLOURS[labelled(first=1, second=2)]
    assert "2 colours on a transparent ground" in of_colours(with_opacity(two, CELLS * 255))
    with pytest.raises(EndoctError, match="all of it is transparent"):
        cells_in_colour(with_opacity(white, 0), "m")


def of_palette(numbers: np.ndarray, palette: np.ndarray) -> str:
    with pytest.raises(EndoctError, match=r"^m does not say what is cell; found") as raised:
        cells_by_palette(numbers, palette, "m")
    return str(raised.value)


def test_numbers_of_colours_are_labels_whose_ground_is_0() -> None:
    np.testing.assert_array_equal(cells_by_palette(labelled(first=2, second=1), COLOURS, "m"), CELLS)
    on_white = COLOURS[[3, 1, 2, 2]]  # as long as no other number is black
    np.testing.assert_array_equal(cells_by_palette(labelled(first=2, second=1), on_white, "m"), CELLS)
    see_through = np.column_stack([on_white, [0, 255, 255, 255]])
    np.testing.assert_array_equal(cells_by_palette(labelled(first=2, second=1), see_through, "m"), CELLS)


def test_a_palette_that_contradicts() -> None:
    inverting = np.repeat(np.arange(255, -1, -1, np.uint8), 3).reshape(-1, 3)
    assert "palette in which 0 is not black" in of_palette(CELLS * np.uint8(255), inverting)
    assert "another number is too" in of_palette(labelled(first=2, second=1), COLOURS[[0, 1, 0, 3]])
    assert "palette without black" in of_palette(CELLS.astype(np.uint8), COLOURS[[3, 1]])


def test_two_colours_that_were_sorted() -> None:
    np.testing.assert_array_equal(cells_by_palette((~CELLS).astype(np.uint8), COLOURS[[1, 0]], "m"), CELLS)
    np.testing.assert_array_equal(cells_by_palette(CELLS.astype(np.uint8), COLOURS[[0, 1]], "m"), CELLS)
    # black and white may have changed places in a file that was inverted and sorted
    assert "90% of it white" in of_palette((np.arange(40) % 10 == 0)[None].astype(np.uint8), COLOURS[[3, 0]])


def test_most_of_the_wall_is_doubted_where_a_file_changes_black_and_white() -> None:
    half = np.arange(8) < 4
    assert minority(half, "m") is half
    with pytest.raises(EndoctError, match="51% of it white"):
        minority(np.arange(100) < 51, "m")
