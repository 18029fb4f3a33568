"""The wall in one B-scan."""

import numpy as np
import pytest

from endoct.modalities.oct.calibration import Background
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.bore import gap_rows
from endoct.modalities.oct.surface.fixed_lines import bridge_rows, with_lines_of, without_lines
from endoct.modalities.oct.surface.projection import maximum_intensity
from endoct.modalities.oct.surface.trust import trusted, wall_sigmas
from endoct.modalities.oct.surface.wall import brightest, first_edge
from endoct.stitching.arrays import Image

N_THETA, N_DEPTH, PIXEL_MM, COLUMN_MM = 600, 200, 0.005, 0.013
NO_LINE = np.zeros(N_DEPTH, np.float32)
BACKGROUND = Background(noise=50.0, noise_sigma=15.0, wall=110.0, line_excess=NO_LINE, noise_power=1.91)
SPECKLE = Background(noise=-1.59, noise_sigma=4.95, wall=10.0, line_excess=NO_LINE)  # dB over the mean noise
FIRST_ROW = np.full(N_THETA, 20)


def bscan(wall: np.ndarray, level: float = 110.0, seed: int = 0) -> Image:
    rng = np.random.default_rng(seed)
    behind = np.arange(N_DEPTH) - wall[:, None]
    mean = np.where(behind >= 0, np.maximum(level - 0.5 * behind, 50), 50)
    return (mean + rng.normal(0, 15, mean.shape)).astype(np.float32)


def test_a_wavy_wall_with_a_pit_is_followed() -> None:
    wall = np.round(100 + 20 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    wall[200:240] += 40
    row = first_edge(bscan(wall), FIRST_ROW, BACKGROUND, PIXEL_MM, COLUMN_MM, OctParameters())
    error = np.abs(row - wall)
    assert np.median(error) <= 1
    assert np.mean(error > 3) < 0.02


@pytest.mark.parametrize("column_mm", [COLUMN_MM, 0.004])
@pytest.mark.parametrize("turn", [137, 400])
def test_turning_the_bscan_turns_the_wall(turn: int, column_mm: float) -> None:
    wall = np.round(100 + 20 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    wall[590:] += 30
    wall[:15] += 30
    image = bscan(wall)
    row = first_edge(image, FIRST_ROW, BACKGROUND, PIXEL_MM, column_mm, OctParameters())
    turned = first_edge(np.roll(image, turn, axis=0), FIRST_ROW, BACKGROUND, PIXEL_MM, column_mm, OctParameters())
    np.testing.assert_array_equal(np.roll(row, turn), turned)


def test_noise_alone_has_no_surface() -> None:
    row = first_edge(bscan(np.full(N_THETA, N_DEPTH)), FIRST_ROW, BACKGROUND, PIXEL_MM, COLUMN_MM, OctParameters())
    # at the very end of the range a few samples decide, which is as good as no surface
    assert np.all(row > N_DEPTH - 15)


def speckled(power_behind: np.ndarray, wall: np.ndarray, seed: int = 0) -> Image:
    """Noise of mean power 1, and bone of ``power_behind`` (n_theta,) more behind ``wall``; dB."""
    rng = np.random.default_rng(seed)
    mean = 1 + np.where(np.arange(N_DEPTH) >= wall[:, None], power_behind[:, None], 0)
    return (10 * np.log10(rng.exponential(mean))).astype(np.float32)


def test_a_wall_fainter_than_noise_is_found() -> None:
    wall = np.round(90 + 15 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    power = np.where(np.arange(N_THETA) < 350, 5.0, 0.5)
    row = first_edge(speckled(power, wall), FIRST_ROW, SPECKLE, PIXEL_MM, COLUMN_MM, OctParameters())
    assert np.mean(np.abs(row - wall) <= 10) > 0.97


def test_darkness_where_bone_should_be_is_a_cell() -> None:
    wall = np.full(N_THETA, 80)
    wall[100:130], wall[400:450] = 130, N_DEPTH  # a floor, and none in reach
    row = first_edge(speckled(np.full(N_THETA, 5.0), wall), FIRST_ROW, SPECKLE, PIXEL_MM, COLUMN_MM, OctParameters())
    assert np.mean(np.abs(row - wall)[:390] <= 8) > 0.98
    assert np.mean(row[402:448] > 110) > 0.95


def test_the_bore_runs_on_where_it_is_not_seen() -> None:
    angle = 2 * np.pi * np.arange(N_THETA) / N_THETA
    true = 60 + 6 * np.cos(angle) + 3 * np.sin(2 * angle)
    rows = np.round(FIRST_ROW + true).astype(np.intp)
    rows[50:130] += 40
    rows[300:380] = N_DEPTH
    evidence = np.ones((N_THETA, N_DEPTH + 1), np.float32)
    assert np.abs(gap_rows(rows, FIRST_ROW, evidence, PIXEL_MM) - true).max() < 2
    rows[:] = N_DEPTH
    assert np.isnan(gap_rows(rows, FIRST_ROW, evidence, PIXEL_MM)).all()


def test_a_bright_speck_before_the_wall_is_not_the_wall() -> None:
    wall = np.full(N_THETA, 120)
    image = bscan(wall)
    image[300:302, 60:62] = 250
    row = first_edge(image, FIRST_ROW, BACKGROUND, PIXEL_MM, COLUMN_MM, OctParameters())
    assert np.max(np.abs(row[290:310] - 120)) < 8


def test_something_opaque_and_its_shadow_are_not_trusted() -> None:
    wall = np.full(N_THETA, 60)
    rng = np.random.default_rng(1)
    image = (np.where(np.arange(N_DEPTH) >= wall[:, None], 105, 50) + rng.normal(0, 5, (N_THETA, N_DEPTH))).astype(
        np.float32
    )
    image[100:140] = rng.normal(50, 5, (40, N_DEPTH))
    image[105:135, 40:60] = 200
    row = wall.copy()
    row[100:140], row[105:135] = N_DEPTH, 40
    good = trusted(image, row, BACKGROUND, PIXEL_MM, COLUMN_MM)
    assert not good[102:138].any()
    assert good[:90].all()
    assert good[150:].all()


ALL_AROUND = np.full(N_THETA, 100)
EVERYWHERE = np.ones(N_THETA, np.bool_)


@pytest.mark.parametrize("power", [1.0, 3.0, 9.0])
def test_a_wall_stands_out_by_its_power_in_standard_errors(power: float) -> None:
    image = speckled(np.full(N_THETA, power), ALL_AROUND)
    found = wall_sigmas(image, ALL_AROUND, EVERYWHERE, SPECKLE, PIXEL_MM, COLUMN_MM)
    samples = 8 * 20  # 0.1 mm around and 0.1 mm deep
    assert found == pytest.approx((1 + power - 1.5) * np.sqrt(samples), rel=0.1)
    turned = wall_sigmas(np.roll(image, 77, axis=0), ALL_AROUND, EVERYWHERE, SPECKLE, PIXEL_MM, COLUMN_MM)
    assert turned == pytest.approx(found, rel=1e-9)


def test_a_wall_stands_out_of_darkness_that_was_cut_off() -> None:
    image = np.where(np.arange(N_DEPTH) < 100, np.zeros((N_THETA, 1)), 60).astype(np.float32)
    background = Background(noise=0.0, noise_sigma=0.0, wall=60.0, line_excess=NO_LINE)
    assert wall_sigmas(image, ALL_AROUND, EVERYWHERE, background, PIXEL_MM, COLUMN_MM) > 100


def test_noise_does_not_stand_out_whatever_flecks_it_has() -> None:
    image = speckled(np.zeros(N_THETA), ALL_AROUND)
    image[:150, 100:110] += 25
    assert wall_sigmas(image, ALL_AROUND, EVERYWHERE, SPECKLE, PIXEL_MM, COLUMN_MM) == 0
    assert wall_sigmas(image, np.full(N_THETA, N_DEPTH), EVERYWHERE, SPECKLE, PIXEL_MM, COLUMN_MM) == 0


def test_the_maximum_is_taken_literally() -> None:
    image = np.zeros((3, 10), np.float32)
    image[:, 2], image[0, 5], image[1, 7], image[2, 9] = 9, 3, 4, 5
    np.testing.assert_array_equal(brightest(image, np.array([3, 3, 3])), [5, 7, 9])
    np.testing.assert_array_equal(maximum_intensity(image, np.array([3, 3, 3])), [3, 4, 5])


def test_rows_under_a_line_are_interpolated() -> None:
    image = np.tile(np.array([1.0, 2.0, 99.0, 99.0, 5.0], np.float32), (2, 1))
    np.testing.assert_allclose(bridge_rows(image, np.array([0, 0, 1, 1, 0], bool))[0], [1, 2, 3, 4, 5])


@pytest.mark.parametrize("level", [50.0, 110.0])
def test_a_faint_line_is_taken_out_of_noise_and_wall_alike(level: float) -> None:
    # under a line 20 counts above the noise, darkness is seen at 70 and a wall at 110 as it is
    excess = np.zeros(N_DEPTH, np.float32)
    excess[80] = 20
    background = Background(50.0, 15.0, 110.0, excess)
    image = np.full((4, N_DEPTH), level, np.float32)
    image[:, 80] = max(level, 70)
    np.testing.assert_allclose(without_lines(image, background), level, atol=1e-4)


def test_a_line_of_one_bscan_is_not_the_wall() -> None:
    """A face at its turning point draws a line into every A-scan of its turn, before the wall and across a cell."""
    wall = np.round(110 + 12 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    wall[400:450] = N_DEPTH
    image = speckled(np.full(N_THETA, 5.0), wall)
    image[:, 60:65] = np.maximum(image[:, 60:65], 12)
    background = with_lines_of(image, SPECKLE, PIXEL_MM)
    assert np.flatnonzero(background.line_excess).tolist() == [60, 61, 62, 63, 64]
    row = first_edge(without_lines(image, background), FIRST_ROW, background, PIXEL_MM, COLUMN_MM, OctParameters())
    assert np.mean(np.abs(row - wall)[:390] <= 8) > 0.98
    assert np.mean(row[402:448] > 130) > 0.95


def test_a_wall_all_around_at_one_depth_is_no_line() -> None:
    image = speckled(np.full(N_THETA, 5.0), np.full(N_THETA, 80))
    assert not with_lines_of(image, SPECKLE, PIXEL_MM).line_excess.any()
