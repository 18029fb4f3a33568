"""The wall in one B-scan."""

import numpy as np
import pytest

from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.wall import (
    AT_ONCE,
    BAND_MM,
    BONUS_PER_MM,
    FRONT_PER_MM,
    _best_path,
    brightest,
    favour_bore,
    first_edge,
    gap_rows,
    largest,
    maximum_intensity,
    trusted,
    wall_sigmas,
)
from endoct.modalities.oct.surface.wall_evidence import Background
from tests.modalities.oct.surface.drawn_bscans import (
    BACKGROUND,
    COLUMN_MM,
    FIRST_ROW,
    N_DEPTH,
    N_THETA,
    NO_LINE,
    PIXEL_MM,
    SPACING,
    SPECKLE,
    bscan,
    speckled,
)


def test_a_wavy_wall_with_a_pit_is_followed() -> None:
    wall = np.round(100 + 20 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    wall[200:240] += 40
    row = first_edge(bscan(wall), FIRST_ROW, BACKGROUND, SPACING, OctParameters())
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
    row = first_edge(image, FIRST_ROW, BACKGROUND, Spacing(PIXEL_MM, column_mm), OctParameters())
    turned = first_edge(
        np.roll(image, turn, axis=0), FIRST_ROW, BACKGROUND, Spacing(PIXEL_MM, column_mm), OctParameters()
    )
    np.testing.assert_array_equal(np.roll(row, turn), turned)


def test_noise_alone_has_no_surface() -> None:
    row = first_edge(bscan(np.full(N_THETA, N_DEPTH)), FIRST_ROW, BACKGROUND, SPACING, OctParameters())
    # at the very end of the range a few samples decide, which is as good as no surface
    assert np.all(row > N_DEPTH - 15)


def test_a_wall_fainter_than_noise_is_found() -> None:
    wall = np.round(90 + 15 * np.sin(2 * np.pi * np.arange(N_THETA) / N_THETA)).astype(int)
    power = np.where(np.arange(N_THETA) < 350, 5.0, 0.5)
    row = first_edge(speckled(power, wall), FIRST_ROW, SPECKLE, SPACING, OctParameters())
    assert np.mean(np.abs(row - wall) <= 10) > 0.97


def test_darkness_where_bone_should_be_is_a_cell() -> None:
    wall = np.full(N_THETA, 80)
    wall[100:130], wall[400:450] = 130, N_DEPTH  # a floor, and none in reach
    images = [speckled(np.full(N_THETA, 5.0), wall, seed) for seed in range(8)]
    rows = np.stack([first_edge(image, FIRST_ROW, SPECKLE, SPACING, OctParameters()) for image in images])
    assert np.mean(np.abs(rows - wall)[:, :390] <= 8) > 0.98
    assert np.mean(rows[:, 402:448] > 110) > 0.97


def test_a_bright_speck_before_the_wall_is_not_the_wall() -> None:
    wall = np.full(N_THETA, 120)
    image = bscan(wall)
    image[300:302, 60:62] = 250
    row = first_edge(image, FIRST_ROW, BACKGROUND, SPACING, OctParameters())
    assert np.max(np.abs(row[290:310] - 120)) < 8


def test_the_path_is_closed_wherever_the_turn_begins() -> None:
    """In noise as strong as the wall's evidence, columns are held by both their neighbours, also over the seam."""
    rng = np.random.default_rng(1)
    states = 20 + np.round(6 * np.sin(2 * np.pi * np.arange(160) / 160)).astype(int)
    evidence = rng.normal(0, 1, (160, 40)).astype(np.float32)
    evidence[np.arange(160), states] += 1
    path = _best_path(evidence, 0.5, 3.0)
    assert np.mean(np.abs(path - states) <= 2) > 0.7
    for turn in range(1, 160, 3):
        turned = _best_path(np.roll(evidence, turn, axis=0), 0.5, 3.0)
        np.testing.assert_array_equal(turned, np.roll(path, turn))


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


def test_surfaces_without_any_evidence_are_no_bore() -> None:
    rows = (FIRST_ROW + 40).astype(np.intp)
    evidence = np.full((N_THETA, N_DEPTH + 1), -1, np.float32)
    assert np.isnan(gap_rows(rows, FIRST_ROW, evidence, PIXEL_MM)).all()


@pytest.mark.parametrize("turn", [0, 211])
def test_a_third_of_wrong_surfaces_in_noise_does_not_move_the_bore(turn: int) -> None:
    rng = np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(N_THETA) / N_THETA
    true = 60 + 5 * np.cos(angle + 1) + 4 * np.cos(2 * angle)
    rows = FIRST_ROW + true + rng.normal(0, 1.5, N_THETA)
    rows[rng.random(N_THETA) < 0.25] -= 25  # specks before the wall
    rows[:60] += 50  # a cell over the seam
    evidence = np.full((N_THETA, N_DEPTH + 1), 1, np.float32)
    evidence[:100] = 40  # a bright side
    rows = np.roll(np.round(rows).astype(np.intp), turn)
    found = gap_rows(rows, FIRST_ROW, np.roll(evidence, turn, axis=0), PIXEL_MM)
    assert np.abs(found - np.roll(true, turn)).max() < 3
    assert np.abs(found - np.roll(true, turn)).mean() < 1


def test_evidence_is_raised_at_the_bore_and_lowered_before_it() -> None:
    wall = 60 + 0.25 * np.arange(N_THETA) % 20
    evidence = np.random.default_rng(2).normal(size=(N_THETA, N_DEPTH + 1)).astype(np.float32)
    before = evidence.copy()
    favour_bore(evidence, wall, SPACING)
    bonus, front = (per_mm * SPACING.column_mm for per_mm in (BONUS_PER_MM, FRONT_PER_MM))
    bands = (np.arange(N_DEPTH + 1) - wall[:, None]) * PIXEL_MM / BAND_MM
    expected = bonus * np.clip(2 - np.abs(bands), 0, 1) - front * np.clip(-2 - bands, 0, 1)
    np.testing.assert_allclose((evidence - before)[:, :N_DEPTH], expected[:, :N_DEPTH], atol=1e-3)


@pytest.mark.parametrize("n", [1, 2, AT_ONCE - 1, AT_ONCE, AT_ONCE + 1, 3 * AT_ONCE, 5 * AT_ONCE + 7])
def test_the_largest_is_found_at_every_place(n: int) -> None:
    for place in range(n):
        values = -np.arange(1, n + 1, dtype=np.float32)
        values[place] = 0.5
        assert largest(values) == 0.5
    assert largest(np.full(n, -np.inf, np.float32)) == -np.inf


def test_the_maximum_is_taken_literally() -> None:
    image = np.zeros((3, 10), np.float32)
    image[:, 2], image[0, 5], image[1, 7], image[2, 9] = 9, 3, 4, 5
    np.testing.assert_array_equal(brightest(image, np.array([3, 3, 3])), [5, 7, 9])
    np.testing.assert_array_equal(maximum_intensity(image, np.array([3, 3, 3]), np.zeros(10, bool)), [3, 4, 5])


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
    good = trusted(image, row, BACKGROUND, SPACING)
    assert not good[102:138].any()
    assert good[:90].all()
    assert good[150:].all()


@pytest.mark.parametrize(("tail_sigmas", "untrusted"), [(1.0, False), (2.0, True), (6.0, True)])
@pytest.mark.parametrize("turn", [0, 300])
def test_darkness_behind_something_bright_says_something_where_walls_are_not_as_dark(
    tail_sigmas: float, untrusted: bool, turn: int
) -> None:
    """By the median of what is left 0.3 to 0.6 mm behind a wall, over the spread of the noise; also over the seam."""
    rng = np.random.default_rng(3)
    row = np.full(N_THETA, 50)
    depth = np.arange(N_DEPTH) - row[:, None]
    mean = np.where(depth >= 25, 50 + 15 * tail_sigmas, np.where(depth >= 0, 110.0, 50.0))
    mean[:40, 75:] = 50
    image = (mean + rng.normal(0, 5, mean.shape)).astype(np.float32)
    good = trusted(np.roll(image, turn - 20, axis=0), row, BACKGROUND, SPACING)
    opaque = np.roll(np.arange(N_THETA) < 40, turn - 20)
    assert (~good[opaque]).mean() == pytest.approx(float(untrusted), abs=0.1)
    assert good[~opaque].all()


ALL_AROUND = np.full(N_THETA, 100)


EVERYWHERE = np.ones(N_THETA, np.bool_)


@pytest.mark.parametrize("power", [1.0, 3.0, 9.0])
def test_a_wall_stands_out_by_its_power_in_standard_errors(power: float) -> None:
    image = speckled(np.full(N_THETA, power), ALL_AROUND)
    sigmas = wall_sigmas(image, ALL_AROUND, EVERYWHERE, SPECKLE, SPACING)
    samples = 8 * 20  # 0.1 mm around and 0.1 mm deep
    assert sigmas == pytest.approx((1 + power - 1.5) * np.sqrt(samples), rel=0.1)
    turned = wall_sigmas(np.roll(image, 77, axis=0), ALL_AROUND, EVERYWHERE, SPECKLE, SPACING)
    assert turned == pytest.approx(sigmas, rel=1e-9)


def test_a_wall_stands_out_of_darkness_that_was_cut_off() -> None:
    image = np.where(np.arange(N_DEPTH) < 100, np.zeros((N_THETA, 1)), 60).astype(np.float32)
    background = Background(noise=0.0, noise_sigma=0.0, wall=60.0, line_excess=NO_LINE, floor=NO_LINE)
    assert wall_sigmas(image, ALL_AROUND, EVERYWHERE, background, SPACING) > 100


def test_noise_does_not_stand_out_whatever_flecks_it_has() -> None:
    image = speckled(np.zeros(N_THETA), ALL_AROUND)
    image[:150, 100:110] += 25
    assert wall_sigmas(image, ALL_AROUND, EVERYWHERE, SPECKLE, SPACING) == 0
    assert wall_sigmas(image, np.full(N_THETA, N_DEPTH), EVERYWHERE, SPECKLE, SPACING) == 0
