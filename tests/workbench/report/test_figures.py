"""Figures show what is there, where it is, to scale."""

import base64
import io
import math

import numpy as np
import pytest
from PIL import Image
from tolerances import COORDINATE_ATOL

from endoct.fusion.scoring.overlap import BOTH, NEITHER, ONLY_A, ONLY_B, difference
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.figures.drawing import MARGIN_IN, new_figure, place, render, width_of, wrapped
from endoct.workbench.report.figures.wall_panels import draw_outline, show_surface, thinned, wall_panel
from endoct.workbench.report.wording import value_text

GRID = SurfaceGrid.full_circle(100, 512, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25)


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


def test_an_outline_runs_on_over_the_seam_half_a_sample_beyond_what_it_marks() -> None:
    grid = SurfaceGrid.full_circle(10, 36, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
    share = np.zeros(grid.shape, np.float32)
    share[3:6, [35, 0, 1]] = 1  # from 350° to 10°
    axes = new_figure(4, 4).add_subplot()
    draw_outline(axes, grid, share, "black")
    points = np.concatenate([path.vertices for path in axes.collections[0].get_paths()])
    assert points[:, 0].min() == pytest.approx(-10)
    assert sorted({round(float(x)) for x in points[:, 0] if 10 < x < 350}) == [15, 345]
    assert (points[:, 1].min(), points[:, 1].max()) == pytest.approx((0.25, 0.55))
    draw_outline(axes, grid, np.zeros(grid.shape, np.float32), "black")
    assert len(axes.collections) == 1


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
