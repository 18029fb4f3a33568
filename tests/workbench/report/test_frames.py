"""Frames of a side and numbers of each: what is drawn of them, where and in which words."""

import math
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from endoct.modalities.contract import Picture
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.report.figures import frames
from endoct.workbench.report.figures.drawing import SKY, VERMILION, new_figure
from endoct.workbench.report.figures.frames import curve_styles, place_label, show_picture
from endoct.workbench.report.per_frame import main_and_others, number_rows, numbers_per_frame, range_text
from endoct.workbench.report.side_findings import SideFindings, alone, flag_rows

GRID = SurfaceGrid.full_circle(6, 16, z0_mm=0.0, dz_mm=0.2, radius_mm=1.0)
PER_FRAME = {
    "slice_z_mm": np.arange(5.0),
    "bridged": np.array([False, True, True, False, True]),
    "start_angle_rad": np.array([3.0, 3.1, -3.1, -3.0, np.nan]),
    "residual_mm": np.array([0.01, 0.02, 0.01, 0.05, 0.01]),
    "offset_mm": np.arange(10.0).reshape(5, 2),
    "steady": np.ones(5),
    "many": np.ones((5, 9)),
}
PICTURES = {
    k: (
        Picture("raw", "B-scan", np.arange(12.0).reshape(3, 4), "angle (rad)", "depth (px)", (0, 2 * np.pi), (10, 30)),
        Picture(
            "flat", "slice 7 flat", np.ones((4, 8, 3), np.uint8), "x (mm)", "y (mm)", (-1, 1), (0.5, -0.5),
            {"wall": np.array([[0.0, 0.25], [0.5, -0.25]]), "edge": np.zeros((2, 2))}, "It is flat.",
        ),
    )
    for k in (1, 3)
}  # fmt: skip


def side(**changed: Any) -> SideFindings:
    ones = np.ones(GRID.shape, np.float32)
    depth = np.where(np.arange(16) == 3, np.float32(0.3), np.float32(0)) * ones
    given = {"pictures": PICTURES, "per_frame": PER_FRAME, "depth": depth} | changed
    panorama = Panorama(GRID, ones, given["depth"], ones > 0, ones, "oct", True, True, "slice", given["per_frame"])
    return alone(panorama, given["pictures"])


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """What is drawn, not rendered."""
    made: list[Figure] = []
    monkeypatch.setattr(frames, "render", lambda figure, name: made.append(figure) or name)
    return made


def test_a_picture_is_drawn_pixel_for_pixel_in_degrees_or_to_scale() -> None:
    raw, flat = PICTURES[1]
    axes = new_figure(3, 3).add_subplot()
    show_picture(axes, raw, {})
    # four columns over a turn lie 120° apart, and a pixel reaches half of that to either side
    assert axes.images[0].get_extent() == pytest.approx([-60, 420, 35, 5])
    assert (axes.get_xlim(), axes.get_ylim()) == (pytest.approx((-60, 420)), pytest.approx((35, 5)))
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("angle (°)", "depth (px)", "auto")
    assert axes.get_xticks().tolist() == [0, 90, 180, 270, 360]
    assert axes.get_legend() is None
    axes = new_figure(3, 3).add_subplot()
    show_picture(axes, flat, curve_styles(side()), x_label=False, y_label=False)
    assert axes.images[0].get_extent() == pytest.approx([-1 - 1 / 7, 1 + 1 / 7, -0.5 - 1 / 6, 0.5 + 1 / 6])
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("", "", 1.0)
    assert [line.get_color() for line in axes.lines] == [VERMILION, SKY]
    assert np.asarray(axes.lines[0].get_xydata()).tolist() == [[0, 0.25], [0.5, -0.25]]
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["wall", "edge"]


def test_frames_are_rows_of_pictures_with_their_places_over_them(drawn: list[Figure]) -> None:
    told = frames.draw_frames(side())
    assert told is not None
    titles = [axes.get_title("left").replace("\n", " ") for axes in drawn[0].axes]
    assert titles == ["slice 1, z = 1.00 mm: B-scan", "slice 7 flat", "slice 3, z = 3.00 mm: B-scan", "slice 7 flat"]
    boxes = [axes.get_position(original=True) for axes in drawn[0].axes]
    assert boxes[0].x0 == boxes[2].x0 < boxes[1].x0 == boxes[3].x0
    assert boxes[0].y0 > boxes[2].y1
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])
    assert [axes.get_legend() is not None for axes in drawn[0].axes] == [False, False, False, True], "the last frame's"
    assert told.caption == (
        "Frames at 2 places along the recording, before and after. Drawn in: wall (orange), edge (blue, dashed). It is "
        "flat."
    )
    gap = Picture("raw", "B-scan", np.array([[1.0, np.nan]]), "x (px)", "y (px)", (0, 1), (0, 1))
    one = frames.draw_frames(side(pictures={9: (gap, gap)}))
    assert one is not None
    assert one.caption.startswith("Frames at 1 place along the recording")
    assert one.caption.endswith("Hatched: not valid.")
    assert place_label(side(), 9) == "slice 9"
    below = [axes.get_position(original=True) for axes in drawn[1].axes]
    assert below[0].x0 == below[1].x0, "pictures of a camera lie below each other"
    assert frames.draw_frames(side(pictures={})) is None


def test_depth_lies_beside_its_frames_whose_places_are_marked(drawn: list[Figure]) -> None:
    told = frames.draw_depth(side())
    assert told is not None
    wall, *parts = (axes for axes in drawn[0].axes if axes.get_title("left"))
    marks = wall.lines[-4:]  # white below each colour
    assert [float(np.asarray(line.get_ydata())[0]) for line in marks] == [1, 1, 3, 3]
    assert [axes.get_title("left") for axes in parts] == ["(b) slice 1, z = 1.00 mm", "(c) slice 3, z = 3.00 mm"]
    colours = [marks[k].get_color() for k in (1, 3)]
    assert [axes.spines["left"].get_edgecolor() for axes in parts] == [to_rgba(colour) for colour in colours]
    assert "Right: the frames" in told.caption
    for nothing in (None, np.full(GRID.shape, np.nan, np.float32)):
        assert frames.draw_depth(side(depth=nothing)) is None


def test_numbers_are_drawn_two_in_a_row_with_crosses_where_frames_are_flagged(drawn: list[Figure]) -> None:
    told = frames.draw_quality(side())
    assert told is not None
    assert "Red crosses: bridged." in told.caption
    titles = [axes.get_title("left") for axes in drawn[0].axes]
    assert len(titles) == len(main_and_others(side())[0])
    boxes = [axes.get_position(original=True) for axes in drawn[0].axes]
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])
    for axes in drawn[0].axes:
        assert np.asarray(axes.lines[0].get_xdata()).tolist() == [0, 1, 2, 3, 4]
        crosses = next(line for line in axes.lines if line.get_marker() == "x")
        assert np.asarray(crosses.get_xdata()).tolist() == [1, 2, 4]
    labelled = [bool(axes.get_xlabel()) for axes in drawn[0].axes]
    assert labelled[-1]
    assert sum(labelled) == min(2, len(titles))
    assert frames.draw_quality(side(per_frame={"slice_z_mm": np.arange(1.0), "a": np.ones(1)})) is None


@pytest.mark.parametrize(
    ("usual", "shown", "shaded"),
    [
        ((0.0, 4.0), (-0.48, 4.48), (0, 4)),
        ((2.0, math.inf), (0.76, 3.24), (2, 3.24)),
        ((-math.inf, 0.0), (-0.36, 3.36), (-0.36, 0)),
    ],
)
def test_the_usual_range_is_shaded_and_in_view(
    usual: tuple[float, float], shown: tuple[float, float], shaded: tuple[float, float]
) -> None:
    axes = new_figure(2, 2).add_subplot()
    frames._show_usual(axes, np.array([1.0, np.nan, 3.0]), usual)
    assert axes.get_ylim() == pytest.approx(shown)
    band = axes.patches[0].get_extents().transformed(axes.transData.inverted())
    assert (band.y0, band.y1) == pytest.approx(shaded)


def test_angles_run_around_their_mean_and_vectors_are_components() -> None:
    numbers = {one.name: one for one in numbers_per_frame(side())}
    assert list(numbers) == ["offset_mm [0]", "offset_mm [1]", "residual_mm", "start_angle_rad", "steady"]
    angle = numbers["start_angle_rad"]
    assert angle.values[:4] == pytest.approx(np.degrees([3.0, 3.1, 2 * np.pi - 3.1, 2 * np.pi - 3.0]))
    assert angle.unit == "°"
    assert not numbers["steady"].varies
    assert numbers["residual_mm"].varies
    assert numbers["residual_mm"].axis_title.endswith("(mm)")
    main, others = main_and_others(side())
    assert {one.name for one in main} | {one.name for one in others} >= set(numbers) - {"steady"}
    assert "steady" not in {one.name for one in others}
    rows = {row[0]: row[-1] for row in number_rows(side())}
    assert rows["steady"] == "1"
    assert rows["offset_mm [1]"] == "1.4 to 8.6 mm"
    low, high = np.percentile([3.0, 3.1, 2 * np.pi - 3.1, 2 * np.pi - 3.0], (5, 95))
    assert (
        rows["start_angle_rad"] == f"{math.degrees(low):.3g} to {math.degrees(high):.3g}° ({low:.3g} to {high:.3g} rad)"
    )


def test_ranges_and_flags_in_words() -> None:
    assert range_text((0.6, 1.0)) == "0.6 to 1"
    assert range_text((15, math.inf)) == "at least 15"
    assert range_text((-math.inf, -3)) == "at most −3"
    assert list(flag_rows(side())) == [["bridged", "3 of 5", "1–2, 4", "1.00–2.00, 4.00 mm"]]
    assert list(flag_rows(side(per_frame=PER_FRAME | {"bridged": np.zeros(5, np.bool_)}))) == []
    unplaced = {name: values for name, values in PER_FRAME.items() if name != "slice_z_mm"}
    (row,) = flag_rows(side(per_frame=unplaced))
    assert row[-1] == "–"
