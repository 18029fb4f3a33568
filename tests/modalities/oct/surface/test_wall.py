"""The wall in one B-scan."""

import numpy as np
import pytest

from endoct.modalities.oct.bscan import Spacing
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.wall import _best_path, first_edge
from tests.modalities.oct.surface.drawn_bscans import (
    BACKGROUND,
    COLUMN_MM,
    FIRST_ROW,
    N_DEPTH,
    N_THETA,
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
