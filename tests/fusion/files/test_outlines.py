"""Regions of ImageJ that are composed of several outlines, or are no polygons."""

from pathlib import Path

import numpy as np
import pytest
import roifile

from endoct.base.errors import EndoctError
from endoct.fusion.files.outlines import fill, filled

SHAPE = (40, 60)
MOVE, LINE, QUADRATIC, CUBIC, CLOSE = range(5)


def box(x: float, y: float, width: float, height: float) -> list[float]:
    return [MOVE, x, y, LINE, x + width, y, LINE, x + width, y + height, LINE, x, y + height, CLOSE]


def composed(path: Path, segments: list[float]) -> Path:
    region = roifile.ImagejRoi(
        roitype=roifile.ROI_TYPE.RECT, shape_roi_size=len(segments), multi_coordinates=np.array(segments, np.float32)
    )
    region.tofile(path / "a.roi")
    return path / "a.roi"


def test_a_composed_region_with_a_hole_and_an_island(tmp_path: Path) -> None:
    segments = [*box(10, 4, 20, 12), *box(12, 6, 16, 8), *box(15, 8, 3, 3), *box(40, 20, 5, 2)]
    mask = filled(composed(tmp_path, segments), SHAPE)
    expected = np.zeros(SHAPE, np.bool_)
    expected[4:16, 10:30] = True
    expected[6:14, 12:28] = False
    expected[8:11, 15:18] = expected[20:22, 40:45] = True
    np.testing.assert_array_equal(mask, expected)


def test_a_composed_region_runs_over_the_seam(tmp_path: Path) -> None:
    mask = filled(composed(tmp_path, [*box(55, 4, 10, 6), *box(57, 5, 6, 4)]), SHAPE)
    expected = np.zeros(SHAPE, np.bool_)
    expected[4:10, 55:], expected[4:10, :5] = True, True
    expected[5:9, 57:], expected[5:9, :3] = False, False
    np.testing.assert_array_equal(mask, expected)


def test_curves_of_a_composed_region(tmp_path: Path) -> None:
    k = 10 * 0.5522847  # four cubic curves that make a circle of radius 10
    circle = [MOVE, 30.0, 10.0, CUBIC, 30 + k, 10, 40, 20 - k, 40, 20, CUBIC, 40, 20 + k, 30 + k, 30, 30, 30]
    circle += [CUBIC, 30 - k, 30, 20, 20 + k, 20, 20, CUBIC, 20, 20 - k, 30 - k, 10, 30, 10, CLOSE]
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    within = np.hypot(rows + 0.5 - 20, columns + 0.5 - 30)
    mask = filled(composed(tmp_path, circle), SHAPE)
    assert mask[within < 9.9].all()
    assert not mask[within > 10.1].any()
    # the parabola through (0, 0) and (20, 0) with its top at (10, 10)
    mask = filled(composed(tmp_path, [MOVE, 0, 0, QUADRATIC, 10, 20, 20, 0, CLOSE]), SHAPE)
    assert mask.sum() == pytest.approx(2 / 3 * 20 * 10, abs=3)
    assert mask[:9, 9:11].all()
    assert not mask[10:].any()


@pytest.mark.parametrize(
    "segments",
    [
        [LINE, 1.0, 1.0, LINE, 5.0, 1.0, LINE, 5.0, 5.0],
        [MOVE, 1.0, 1.0, LINE, 5.0],
        [MOVE, 1.0, 1.0, 7.0, 5.0, 5.0],
        [MOVE, 1.0, 1.0, 0.5, 5.0, 5.0],
        [MOVE, 1.0, 1.0, LINE, 5.0, 5.0, CLOSE],
        [CLOSE],
        [MOVE, 1.0, 1.0, LINE, np.nan, 1.0, LINE, 5.0, 5.0, CLOSE],
        [np.nan],
    ],
)
def test_a_composed_region_that_is_none(segments: list[float], tmp_path: Path) -> None:
    with pytest.raises(EndoctError) as raised:
        filled(composed(tmp_path, segments), SHAPE)
    assert "\n" not in str(raised.value)


def test_an_area_has_so_many_outlines_at_most(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="too many outlines"):
        filled(composed(tmp_path, box(1, 1, 2, 2) * 10_001), SHAPE)


def test_a_rectangle_between_samples(tmp_path: Path) -> None:
    region = roifile.ImagejRoi(
        roitype=roifile.ROI_TYPE.RECT,
        version=227,
        options=roifile.ROI_OPTIONS.SUB_PIXEL_RESOLUTION,
        left=10, top=5, right=14, bottom=8, xd=10.6, yd=5.6, widthd=3.0, heightd=1.0,
    )  # fmt: skip
    region.tofile(tmp_path / "a.roi")
    mask = filled(tmp_path / "a.roi", SHAPE)
    assert np.argwhere(mask).tolist() == [[6, 11], [6, 12], [6, 13]]


@pytest.mark.parametrize(
    ("told", "found"),
    [
        ({"roitype": roifile.ROI_TYPE.RECT, "subtype": roifile.ROI_SUBTYPE.TEXT, "text": "a"}, "text in a rectangle"),
        ({"roitype": roifile.ROI_TYPE.RECT, "rounded_rect_arc_size": 4}, "round corners"),
        ({"roitype": roifile.ROI_TYPE.POLYGON, "options": roifile.ROI_OPTIONS.SPLINE_FIT}, "a curve fitted"),
        ({"roitype": roifile.ROI_TYPE.POINT}, "found point"),
    ],
)
def test_regions_whose_points_are_no_corners(told: dict[str, object], found: str, tmp_path: Path) -> None:
    points = np.array([[5, 5], [15, 5], [15, 15]], np.float32)
    region = roifile.ImagejRoi.frompoints(points)
    for name, value in told.items():
        setattr(region, name, value)
    region.tofile(tmp_path / "a.roi")
    with pytest.raises(EndoctError, match=f"encloses nothing; .*{found}"):
        filled(tmp_path / "a.roi", SHAPE)


def test_outlines_that_would_take_minutes_to_fill_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = box(10, 4, 20, 9), [*box(10, 4, 20, 9), *box(30, 4, 20, 9)]
    n_tests = 4 * 10 * 21  # four corners, and the samples around
    monkeypatch.setattr("endoct.fusion.files.outlines._MOST_TESTS", n_tests)
    assert filled(composed(tmp_path, one), SHAPE).sum() == 20 * 9
    monkeypatch.setattr("endoct.fusion.files.outlines._MOST_TESTS", 2 * n_tests - 1)
    with pytest.raises(EndoctError, match="would take minutes to fill"):
        filled(composed(tmp_path, two), SHAPE)
    monkeypatch.setattr("endoct.fusion.files.outlines._MOST_TESTS", n_tests - 1)
    with pytest.raises(EndoctError, match="would take minutes to fill"):
        fill(np.array([(4, 10), (4, 30), (13, 30), (13, 10)], np.float64), SHAPE)
    monkeypatch.setattr("endoct.fusion.files.outlines._MOST_OF_PATH", len(one) - 1)
    with pytest.raises(EndoctError, match="a path of 13 numbers"):
        filled(composed(tmp_path, one), SHAPE)
