"""Openings by their darkness, and what depth is worth in them, on drawn walls and by hand."""

import numpy as np
import pytest

from endoct.base.arrays import Image, Mask
from endoct.modalities.endoscope.parallax.openings import (
    DARK,
    DARKEST_WALL,
    DOUBTED,
    FEWEST,
    SHALLOW_MM,
    darkness,
    lie_behind,
    more_error_mm,
)
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

GRID = SurfaceGrid.full_circle(100, 400, z0_mm=0.0, dz_mm=0.02, radius_mm=0.02 * 400 / (2 * np.pi))


def panorama(logs: Image, valid: Mask | None = None) -> Panorama:
    whole = np.ones(GRID.shape, np.float32)
    seen = whole > 0 if valid is None else valid
    return Panorama(GRID, np.exp(logs).astype(np.float32), None, seen, whole, "camera", True, True)


def wall(darker_by: float) -> Image:
    logs = np.full(GRID.shape, -1.0, np.float32)
    logs[40:60, :8] -= darker_by
    logs[40:60, -12:] -= darker_by
    return logs


def test_what_is_darker_than_the_wall_is_an_opening_across_the_seam_too() -> None:
    dark = darkness(panorama(wall(0.3)))
    assert dark.shape == GRID.shape
    assert (dark[43:57, :5] == 1).all()
    assert (dark[43:57, -9:] == 1).all()
    assert dark[:37].max() == 0
    assert dark[:, 12:380].max() == 0


@pytest.mark.parametrize(("darker_by", "surely"), [(0.5 * DARK, 0), ((DARK + DARKEST_WALL) / 2, 0.5), (0.25, 1)])
def test_how_surely_it_is_one_grows_with_its_darkness(darker_by: float, surely: float) -> None:
    assert darkness(panorama(wall(darker_by)))[50, 0] == pytest.approx(surely, abs=1e-3)


def test_neither_the_light_nor_its_slow_change_makes_an_opening() -> None:
    slope = np.linspace(-0.5, 0.5, GRID.shape[0], dtype=np.float32)[:, None]
    plain = darkness(panorama(wall(0.3)))
    np.testing.assert_allclose(darkness(panorama(wall(0.3) - 2)), plain, atol=1e-3)
    tilted = darkness(panorama(wall(0.3) + 0.2 * slope))
    assert tilted[20:80, 50:350].max() < 0.5
    assert tilted[50, 0] > 0.5


def test_what_is_not_seen_is_no_opening_and_darkens_nothing() -> None:
    logs = wall(0.3)
    seen = np.ones(GRID.shape, np.bool_)
    seen[:, 100:140] = False
    logs[:, 100:140] = -5
    dark = darkness(panorama(logs, seen))
    assert dark[:, 60:180].max() == 0
    assert dark[50, 0] == 1


def test_an_opening_is_doubted_the_more_the_darker_and_the_shallower_it_is() -> None:
    dark = np.array([1, 1, 1, 0.5, 0, 1], np.float32)
    depth_mm = np.array([0, SHALLOW_MM / 2, SHALLOW_MM, 0, 0, -0.05], np.float32)
    more_mm = more_error_mm(dark, depth_mm, np.full(6, 0.04, np.float32))
    assert more_mm == pytest.approx(DOUBTED * np.array([0.04, 0.02, 0, 0.02, 0, 0.04]))


def test_openings_lie_behind_the_wall_if_one_in_ten_does() -> None:
    dark = np.zeros(4 * FEWEST, np.float32)
    dark[: 2 * FEWEST] = 1
    known = np.ones(dark.shape, np.bool_)
    depth_mm = np.zeros(dark.shape, np.float32)
    assert not lie_behind(dark, depth_mm, known)
    deep = depth_mm.copy()
    deep[: FEWEST // 2] = 1.2 * SHALLOW_MM  # a quarter of them
    assert lie_behind(dark, deep, known)
    assert not lie_behind(dark, deep + 0.3 * (dark == 0), known)
    assert not lie_behind(dark, 0.5 * deep, known)
    deep[FEWEST // 10 :] = 0  # one in twenty
    assert not lie_behind(dark, deep, known)


def test_a_few_openings_or_a_little_wall_judge_nothing() -> None:
    dark, depth_mm = np.ones(4 * FEWEST, np.float32), np.zeros(4 * FEWEST, np.float32)
    known = np.ones(dark.shape, np.bool_)
    dark[FEWEST - 1 :] = 0
    assert lie_behind(dark, depth_mm, known)
    assert lie_behind(1 - dark, depth_mm, known)
    dark[FEWEST - 1 : 2 * FEWEST] = 1
    assert not lie_behind(dark, depth_mm, known)
    known[FEWEST - 1 : 2 * FEWEST] = False
    assert lie_behind(dark, depth_mm, known)
