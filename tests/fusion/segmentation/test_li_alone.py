"""Between which values Li's threshold is sought, and what is kept of it, by hand."""

import numpy as np
import pytest

from endoct.base.arrays import Image
from endoct.base.errors import EndoctError
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.segmentation.li_alone import above_li, bounds, spread_of_wall
from endoct.fusion.segmentation.parameters import SegmentParameters

PLAIN = SegmentParameters(smooth_mm=0, open_mm=0, close_mm=0, smallest_mm2=0)
VALID = np.ones((6, 60), np.bool_)
VALID[5] = False


def evidence(values: Image, kind: str = "darkness") -> Evidence:
    z_mm = 0.02 * np.arange(len(values))
    return Evidence(values.astype(np.float32), VALID, z_mm, 0.02, 0.0, 60 * 0.02 / (2 * np.pi), kind)  # type: ignore[arg-type]


def wall(cell: float, spread: float = 0.05) -> Image:
    """A wall, half of it ``spread`` in front of 0 and half as far behind; a cell across the seam; unseen is large."""
    values = np.where(np.arange(60) % 2, spread, -spread) * np.ones((6, 1))
    values[1:4, -3:] = values[1:4, :3] = cell
    values[5] = 9.0
    return values


def test_the_spread_of_a_wall_is_that_of_what_lies_in_front_of_it() -> None:
    # the median size of −1, −1, −3 is 1, and a Gaussian's is 0.6745 of its standard deviation
    assert spread_of_wall(np.array([-1, -1, -3, 7, 0, 50], np.float32)) == pytest.approx(1 / 0.6745, rel=1e-3)
    assert spread_of_wall(np.array([0, 2], np.float32)) == 0


@pytest.mark.parametrize(
    ("sigmas", "cap", "low"),
    [
        (3.0, 0.7, 3 * 0.05 / 0.6745),
        (3.0, 0.3, 0.15),  # half of the cap
        (0.0, 0.7, 0.0),
        (9.0, 1.3, 0.0),  # 0.65 is more than anything shows
    ],
)
def test_a_threshold_is_sought_beyond_the_walls_own_spread_and_below_the_cap(
    sigmas: float, cap: float, low: float
) -> None:
    p = PLAIN.model_copy(update={"contrast_floor_sigmas": sigmas, "contrast_cap": cap})
    given = evidence(wall(0.6))
    assert bounds(given, given.values, p) == (pytest.approx(low, rel=1e-3), cap)
    as_relief = evidence(wall(0.6), "relief")
    assert bounds(as_relief, as_relief.values, p) == (p.relief_floor_mm, p.relief_cap_mm)


def test_what_lies_above_is_cell_where_it_was_seen() -> None:
    found = above_li(evidence(wall(0.6)), PLAIN)
    np.testing.assert_array_equal(found.mask, (wall(0.6) == 0.6) & VALID)
    assert 3 * 0.05 / 0.6745 < found.threshold < 0.6
    assert not found.was_raised


@pytest.mark.parametrize(("spread", "raised_to"), [(0.005, None), (0.012, 4 * 0.012 / 0.6745), (0.05, 0.1)])
def test_a_threshold_of_relief_lies_beyond_the_walls_own(spread: float, raised_to: float | None) -> None:
    """Of a wall without cells Li's threshold lies within its spread: it is raised to 4 of these, or half the cap."""
    cell = 0.15 if raised_to is None else spread
    found = above_li(evidence(wall(cell, spread), "relief"), PLAIN)
    assert found.was_raised is (raised_to is not None)
    if raised_to is not None:
        assert found.threshold == pytest.approx(raised_to, rel=1e-3)
        assert not found.mask.any()
    else:
        assert 0.005 < found.threshold < 0.15
        assert found.mask.sum() == 18


def test_a_wall_that_is_all_alike_has_no_threshold() -> None:
    with pytest.raises(EndoctError, match="shows no cells to threshold"):
        above_li(evidence(np.where(VALID, 0.0, 9.0)), PLAIN)


def test_small_cells_go_and_smoothing_reaches_around_the_seam() -> None:
    values = wall(0.6, 0.01)
    values[2, 30] = 0.6
    p = PLAIN.model_copy(update={"smallest_mm2": 2 * 0.02**2})
    found = above_li(evidence(values), p)
    assert found.mask.sum() == 18
    smooth = above_li(evidence(values), PLAIN.model_copy(update={"smooth_mm": 0.02})).smooth
    turned = evidence(np.roll(values, 30, axis=1))
    again = above_li(turned, PLAIN.model_copy(update={"smooth_mm": 0.02})).smooth
    np.testing.assert_allclose(again[:5], np.roll(smooth, 30, axis=1)[:5], atol=1e-6)
