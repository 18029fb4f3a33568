"""The levels of a recording, and B-scans without the lines that the detector draws."""

import numpy as np
import pytest

from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.background import (
    Background,
    bridge_rows,
    relative_power,
    with_lines_of,
    without_lines,
)
from endoct.modalities.oct.surface.wall import first_edge
from tests.modalities.oct.surface.drawn_bscans import FIRST_ROW, N_DEPTH, N_THETA, PIXEL_MM, SPACING, SPECKLE, speckled


def test_rows_under_a_line_are_interpolated() -> None:
    image = np.tile(np.array([1.0, 2.0, 99.0, 99.0, 5.0], np.float32), (2, 1))
    np.testing.assert_allclose(bridge_rows(image, np.array([0, 0, 1, 1, 0], bool))[0], [1, 2, 3, 4, 5])


@pytest.mark.parametrize("level", [50.0, 110.0])
def test_a_faint_line_is_taken_out_of_noise_and_wall_alike(level: float) -> None:
    # under a line 20 counts above the noise, darkness is seen at 70 and a wall at 110 as it is
    excess = np.zeros(N_DEPTH, np.float32)
    excess[80] = 20
    background = Background(50.0, 15.0, 110.0, excess, np.zeros_like(excess))
    image = np.full((4, N_DEPTH), level, np.float32)
    image[:, 80] = max(level, 70)
    np.testing.assert_allclose(without_lines(image, background), level, atol=1e-4)


def face_of(*, nearest_row: int) -> Circle:
    """A face that turns back at ``nearest_row`` and 80 rows deeper."""
    return Circle(0.2, 0.0, nearest_row * PIXEL_MM + 0.2 - 0.85, 0.85)


@pytest.mark.parametrize("glass_rows", [0, 25])
def test_a_line_of_one_bscan_is_not_the_wall(glass_rows: int) -> None:
    """A face at its turning point draws a line into every A-scan of its turn, before the wall and across a cell."""
    face = face_of(nearest_row=62 + glass_rows)
    wall = np.round(110 + 12 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    wall[400:450] = N_DEPTH
    rows = []
    for seed in range(8):
        image = speckled(np.full(N_THETA, 5.0), wall, seed)
        image[:, 60:65] = np.maximum(image[:, 60:65], 12)
        background = with_lines_of(image, SPECKLE, face, glass_rows * PIXEL_MM, PIXEL_MM)
        assert np.flatnonzero(background.line_excess).tolist()[:5] == [60, 61, 62, 63, 64]
        assert np.count_nonzero(background.line_excess) <= 6
        rows.append(first_edge(without_lines(image, background), FIRST_ROW, background, SPACING, OctParameters()))
    assert np.mean(np.abs(np.stack(rows) - wall)[:, :390] <= 8) > 0.98
    assert np.mean(np.stack(rows)[:, 402:448] > 130) > 0.96


def test_a_wall_all_around_at_one_depth_is_no_line() -> None:
    image = speckled(np.full(N_THETA, 5.0), np.full(N_THETA, 80))
    assert not with_lines_of(image, SPECKLE, face_of(nearest_row=10), 0.0, PIXEL_MM).line_excess.any()


def test_what_stands_out_far_from_where_a_face_turns_is_no_line_of_one_bscan() -> None:
    image = speckled(np.full(N_THETA, 5.0), np.full(N_THETA, 150))
    image[:, 60:65] = np.maximum(image[:, 60:65], 12)
    assert not with_lines_of(image, SPECKLE, face_of(nearest_row=30), 0.0, PIXEL_MM).line_excess.any()


def test_power_is_that_of_exponential_noise_over_its_median_and_never_overflows() -> None:
    noise = 10 * np.log10(np.random.default_rng(1).exponential(1, 200_000))
    median = float(np.median(noise))
    spread = 1.4826 * float(np.median(np.abs(noise - median)))
    power = relative_power(noise.astype(np.float32), median, spread)
    assert power.mean() == pytest.approx(1 / np.log(2), rel=0.02)
    assert np.isfinite(relative_power(np.array([1e9], np.float32), median, spread)).all()
