"""Figures show what is there, where it is, to scale."""

import base64
import io
import math

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import ArrayLike
from PIL import Image
from tolerances import COORDINATE_ATOL

from endoct.fusion.scoring.overlap import BOTH, NEITHER, ONLY_A, ONLY_B, difference
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.figures.cylinder import CUT_FACE, END_FACE, NOT_OBSERVED, TILT_RAD, CutBore, cast_half
from endoct.workbench.report.figures.drawing import MARGIN_IN, new_figure, place, render, width_of, wrapped
from endoct.workbench.report.figures.wall_panels import show_surface, thinned, wall_panel
from endoct.workbench.report.wording import value_text

GRID = SurfaceGrid.full_circle(100, 512, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25)
OUTER_MM = 2.5


def test_the_difference_image_tells_the_four_cases() -> None:
    a, b = np.array([[True, True, False, False]]), np.array([[True, False, True, False]])
    np.testing.assert_array_equal(difference(a, b, np.ones_like(a)), [[BOTH, ONLY_A, ONLY_B, NEITHER]])


def test_a_wall_panel_is_drawn_to_scale_with_z_downwards() -> None:
    figure = new_figure(4, 6)
    axes = figure.add_subplot()
    wall_panel(axes, GRID, "wall")
    figure.draw_without_rendering()
    corner, aside, below = axes.transData.transform([(0, 1), (90, 1), (0, 2)])
    quarter_turn_mm = math.pi / 2 * GRID.radius_mm
    assert corner[1] - below[1] == pytest.approx((aside[0] - corner[0]) / quarter_turn_mm, rel=1e-6)
    assert below[1] < corner[1]


def test_axes_lie_where_they_are_placed_and_no_words_above_a_panel_touch() -> None:
    figure = new_figure(5, 3)
    axes = place(figure, 0.5, 0.25, 2.0, 1.5)
    assert width_of(axes) == pytest.approx(2.0)
    frame = axes.get_position(original=True).get_points() * figure.get_size_inches()
    np.testing.assert_allclose(frame[0], [MARGIN_IN + 0.5, MARGIN_IN + 3 - 0.25 - 1.5])
    np.testing.assert_allclose(frame[1] - frame[0], [2.0, 1.5])
    wall_panel(axes, GRID, "wall")
    figure.draw_without_rendering()
    rows = [text.get_window_extent() for text in axes.texts if text.get_text() in ("0", "arc (mm)")]
    boxes = sorted([*rows, axes.title.get_window_extent()], key=lambda box: float(box.y0))
    assert len(boxes) == 3
    # the title stands on the left, where its descenders may reach the height of the words in the middle
    assert boxes[0].y0 > axes.bbox.y1
    assert boxes[1].y0 >= boxes[0].y1
    assert not boxes[2].overlaps(boxes[1])


@pytest.mark.parametrize("theta0_rad", [0.0, math.pi / 2])
def test_a_sample_is_drawn_at_its_theta_whatever_column_the_grid_starts_with(theta0_rad: float) -> None:
    grid = SurfaceGrid.full_circle(4, 64, z0_mm=0, dz_mm=0.1, radius_mm=1.25, theta0_rad=theta0_rad)
    values = np.zeros(grid.shape)
    values[:, int(grid.column_of(math.radians(45)))] = 1
    axes = new_figure(2, 2).add_subplot()
    wall_panel(axes, grid, "wall")
    show_surface(axes, grid, values, values >= 0, "gray")
    shown = np.asarray(axes.images[0].get_array())[0, :, 0]
    assert shown.argmax() == pytest.approx(45 / 360 * 64, abs=1)


def test_samples_not_observed_are_left_transparent() -> None:
    valid = np.ones(GRID.shape, np.bool_)
    valid[10:20] = False
    axes = new_figure(2, 2).add_subplot()
    wall_panel(axes, GRID, "wall")
    show_surface(axes, GRID, np.full(GRID.shape, np.nan), valid, "gray")
    alpha = np.asarray(axes.images[0].get_array())[..., 3]
    np.testing.assert_array_equal(alpha == 255, valid)


def test_thinning_keeps_means_majorities_and_places() -> None:
    grid = SurfaceGrid.full_circle(4000, 4096, z0_mm=0.5, dz_mm=0.005, radius_mm=1.25)
    rng = np.random.default_rng(0)
    values = rng.random(grid.shape).astype(np.float32)
    half = np.zeros(grid.shape, np.bool_)
    half[:, :2048] = True
    coarse, mean, majority = thinned(grid, values, half)
    assert coarse.n_theta < 2048
    assert coarse.n_z < 2500
    assert mean.mean() == pytest.approx(values[: coarse.n_z * 2].mean(), abs=1e-4)
    assert majority.sum() == coarse.n_z * coarse.n_theta // 2
    # the middle of the first block is where its samples are
    assert coarse.z0_mm == pytest.approx(grid.z_mm[: grid.n_z // coarse.n_z].mean(), abs=COORDINATE_ATOL)
    across = grid.n_theta // coarse.n_theta
    assert coarse.theta0_rad == pytest.approx(grid.theta_rad[:across].mean(), abs=COORDINATE_ATOL)


def test_thinning_averages_over_finite_samples_only() -> None:
    grid = SurfaceGrid.full_circle(2000, 4096, z0_mm=0, dz_mm=0.001, radius_mm=1.25)
    values = np.ones(grid.shape, np.float32)
    values[::2] = np.nan
    values[:, 2048:] = np.nan
    _, mean = thinned(grid, values)
    columns = mean.shape[1] // 2
    np.testing.assert_array_equal(mean[:, :columns], 1)
    assert np.isnan(mean[:, columns:]).all()


class _Shell:
    """A half shell, cast; asked for its colour at a place of the cut."""

    def __init__(self, depth_mm: np.ndarray, seen: np.ndarray, middle_deg: float) -> None:
        mapping = ScalarMappable(Normalize(0, 1), "viridis")
        bore = CutBore(GRID, depth_mm.astype(np.float32), depth_mm, seen, mapping, True, OUTER_MM)
        self.image, self.extent = cast_half(bore, math.radians(middle_deg))

    def at(self, z_mm: float, v_mm: float) -> np.ndarray:
        left, right, bottom, top = self.extent
        rows, columns = self.image.shape[:2]
        column = round((z_mm - left) / (right - left) * (columns - 1))
        return self.image[round((top - v_mm) / (top - bottom) * (rows - 1)), column]


def _hue(rgba: ArrayLike) -> np.ndarray:
    rgb = np.asarray(rgba)[:3]
    return rgb / np.linalg.norm(rgb)


def test_a_plain_bore_shows_its_wall_between_two_cut_faces_and_its_end_face_at_the_mouth() -> None:
    shell = _Shell(np.zeros(GRID.shape), np.ones(GRID.shape, np.bool_), 90)
    for v_mm in (1.4, 2.4, -1.4, -2.4):
        np.testing.assert_allclose(shell.at(2, v_mm)[:3], CUT_FACE, atol=1e-6)
    np.testing.assert_allclose(_hue(shell.at(2, 0)), _hue(colormaps["viridis"](0.0)), atol=0.02)
    # beyond the mouth a ray enters through the end face at w = (z_near − z0) / tan(tilt)
    deep = -0.025 - 2.0 * math.tan(TILT_RAD)
    np.testing.assert_allclose(shell.at(deep, 0)[:3], END_FACE, atol=1e-6)
    # and leaves through the far end where it has not met the wall by then
    assert shell.at(4.9, 0)[3] == 0
    assert shell.at(4.9, 1.4)[3] == 1


def test_a_pit_is_seen_where_it_is_in_the_right_half_and_a_deeper_one_by_its_depth() -> None:
    theta, z = np.meshgrid(np.degrees(GRID.theta_rad), GRID.z_mm)
    depth_mm = np.where((np.abs(theta - 90) < 25) & (np.abs(z - 3) < 0.8), 1.0, 0.0)
    seen = np.ones(GRID.shape, np.bool_)
    first, second = _Shell(depth_mm, seen, 90), _Shell(depth_mm, seen, 270)
    # its floor is met at w = 2.25 mm: the ray came in that much × tan(tilt) nearer to the mouth
    floor = _hue(first.at(3.2 - 2.25 * math.tan(TILT_RAD), 0))
    np.testing.assert_allclose(floor, _hue(colormaps["viridis"](1.0)), atol=0.02)
    plain = _hue(second.at(3.2 - 2.25 * math.tan(TILT_RAD), 0))
    assert np.abs(floor - plain).max() > 0.3
    # the pit's far side, half a millimetre behind the wall: it belongs to samples that lie on the wall
    side = _hue(first.at(3.8 - 1.75 * math.tan(TILT_RAD), 0))
    np.testing.assert_allclose(side, _hue(colormaps["viridis"](0.0)), atol=0.02)
    # θ grows upwards
    upper = _Shell(np.where(np.abs(theta - 130) < 15, 1.0, 0.0), seen, 90)
    assert np.abs(_hue(upper.at(1, 1.0)) - plain).max() > 0.1
    np.testing.assert_allclose(_hue(upper.at(1, -1.0)), plain, atol=0.02)


def test_wall_that_was_not_observed_is_marked_in_the_shell() -> None:
    seen = np.zeros(GRID.shape, np.bool_)
    shell = _Shell(np.zeros(GRID.shape), seen, 90)
    np.testing.assert_allclose(_hue(shell.at(2, 0)), _hue(NOT_OBSERVED), atol=1e-3)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("jaccard", 0.73649, "0.736"),
        ("z_shift_mm", -0.43217, "−0.432 mm"),
        ("theta_shift_rad", 1.5, "1.5000 rad (85.94°)"),
        ("both_mm2", 6.0804, "6.08 mm²"),
        ("slope_cost_per_mm", 100.0, "100 per mm"),
        ("twist_rad_per_mm", -0.01, "−0.0100 rad per mm (−0.57° per mm)"),
        ("ratio", 3.17928, "3.179"),
        ("mirrored", True, "yes"),
        ("dz_mm", None, "–"),
        ("wavelet", "sym4", "sym4"),
        ("n_theta", 2048, "2048"),
    ],
)
def test_values_are_said_with_their_unit_and_sensible_digits(name: str, value: object, text: str) -> None:
    assert value_text(name, value) == text


def test_titles_are_broken_to_the_width_of_their_panel() -> None:
    lines = wrapped("frame 6, z = 1.20 mm: as recorded, with the annulus found", 2.4).split("\n")
    assert len(lines) == 2
    assert max(map(len, lines)) <= 34


def test_a_page_embeds_a_line_drawing_as_it_is_and_a_smaller_copy_of_a_large_picture() -> None:
    drawing, picture = new_figure(4, 3), new_figure(4, 3)
    place(drawing, 0.5, 0.25, 3, 2).plot([0, 1], [0, 1])
    place(picture, 0.5, 0.25, 3, 2).imshow(np.random.default_rng(0).random((600, 600)), aspect="auto")
    small, large = render(drawing, "small"), render(picture, "large")
    png, jpeg = (base64.b64decode(one.embedded.split(",", 1)[1]) for one in (small, large))
    assert small.embedded.startswith("data:image/png;base64,")
    assert png == small.png
    assert large.embedded.startswith("data:image/jpeg;base64,")
    assert len(jpeg) < len(large.png)
    with Image.open(io.BytesIO(jpeg)) as embedded, Image.open(io.BytesIO(large.png)) as lossless:
        assert embedded.size == lossless.size
