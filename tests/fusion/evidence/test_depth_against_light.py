"""Depth by parallax beside light: floors a rim hides, deep and bright floors, stains, a mirror that shows no depth."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.arrays import Coordinates, Mask
from endoct.fusion.evidence.depth_against_light import with_depth_against_light
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

N_Z, N_THETA, STEP_MM, ERROR_MM = 150, 300, 0.02, 0.03
ROWS, COLUMNS = np.mgrid[:N_Z, :N_THETA]
RADIUS_MM = N_THETA * STEP_MM / (2 * np.pi)


def disc(row: float, column: float) -> Mask:
    across = np.mod(COLUMNS - column + N_THETA / 2, N_THETA) - N_THETA / 2
    return np.asarray(np.hypot(ROWS - row, across) * STEP_MM <= 0.25)


HIDDEN, DEEP, STAIN, BRIGHT, A_LITTLE_SHORT = disc(40, 1), disc(40, 80), disc(40, 200), disc(110, 40), disc(110, 150)
PITCH_BLACK = disc(110, 240)
DARKNESS = np.select([HIDDEN | DEEP, STAIN, A_LITTLE_SHORT, PITCH_BLACK], [1.0, 0.2, 0.5, 2.5])
DEPTH_MM = np.select([DEEP, BRIGHT, A_LITTLE_SHORT, PITCH_BLACK], [0.9, 0.4, 0.2, 1.6])
UNSEEN = disc(40, 140)


def panorama(depth_mm: float | Coordinates = DEPTH_MM) -> Panorama:
    """Under light that is uneven around the bore, with noise, and something that no frame sees."""
    light = 0.5 + 0.05 * np.cos(2 * np.pi * COLUMNS / N_THETA)
    noise = np.random.default_rng(3).normal(1, 0.03, (N_Z, N_THETA))
    intensity = (light * noise * np.exp(-DARKNESS)).astype(np.float32)
    depth = np.where(UNSEEN, np.nan, depth_mm).astype(np.float32)
    error = np.where(UNSEEN, np.nan, ERROR_MM).astype(np.float32)
    grid = SurfaceGrid.full_circle(N_Z, N_THETA, z0_mm=1.0, dz_mm=STEP_MM, radius_mm=RADIUS_MM)
    weight = (~UNSEEN).astype(np.float32)
    return Panorama(
        grid, intensity, None, ~UNSEEN, weight, "camera", True, True, parallax_depth_mm=depth, parallax_error_mm=error
    )


@pytest.fixture(scope="module")
def held() -> Panorama:
    return with_depth_against_light(panorama())


def test_a_dark_place_that_seems_to_lie_at_the_wall_is_not_known(held: Panorama) -> None:
    """Across the seam, too."""
    depth_mm, error_mm = held.parallax_depth_mm, held.parallax_error_mm
    assert depth_mm is not None
    assert error_mm is not None
    assert np.isnan(depth_mm[HIDDEN]).mean() > 0.99
    np.testing.assert_array_equal(np.isnan(depth_mm), np.isnan(error_mm))
    assert depth_mm.dtype == error_mm.dtype == np.float32


def test_wall_stains_bright_and_deep_floors_stay_as_sure_as_they_were(held: Panorama) -> None:
    """However dark: light tells of no more than 1.5 mm."""
    assert held.parallax_error_mm is not None
    wall = ~(HIDDEN | DEEP | STAIN | BRIGHT | A_LITTLE_SHORT | PITCH_BLACK | UNSEEN)
    for where in (wall, STAIN, BRIGHT, DEEP, PITCH_BLACK):
        error_mm = held.parallax_error_mm[where]
        assert np.isfinite(error_mm).mean() > 0.99
        assert np.nanmedian(error_mm) == pytest.approx(ERROR_MM, rel=0.15)
    np.testing.assert_array_equal(held.parallax_depth_mm[wall], panorama().parallax_depth_mm[wall])  # type: ignore[index]


def test_a_depth_a_little_less_than_the_light_tells_is_less_sure_by_that(held: Panorama) -> None:
    """Darkness 0.5 tells of 0.3 mm; 0.2 mm were found."""
    assert held.parallax_error_mm is not None
    assert np.nanmedian(held.parallax_error_mm[A_LITTLE_SHORT]) == pytest.approx(np.hypot(ERROR_MM, 0.1), rel=0.2)


def test_where_nearly_all_that_is_dark_seems_to_lie_at_the_wall_frames_show_no_depth() -> None:
    flat = with_depth_against_light(panorama(np.where(DEEP | PITCH_BLACK, np.nan, 0.0)))
    assert np.isnan(flat.parallax_depth_mm).all()  # type: ignore[arg-type]
    assert np.isnan(flat.parallax_error_mm).all()  # type: ignore[arg-type]
    half = with_depth_against_light(panorama(np.where(PITCH_BLACK, 0.0, DEPTH_MM)))
    assert np.isfinite(half.parallax_depth_mm).any(), "half of it is not nearly all"  # type: ignore[arg-type]
    speck = (np.hypot(ROWS - 40, COLUMNS - 80) < 6) & DEEP
    assert 0 < speck.mean() < 0.01
    bright = panorama(np.where(speck, 0.0, np.where(DARKNESS > 0, np.nan, DEPTH_MM)))
    held = with_depth_against_light(bright)
    assert np.isfinite(held.parallax_depth_mm).any(), "too little is dark to tell"  # type: ignore[arg-type]


def test_a_panorama_without_depth_stays_as_it_is() -> None:
    without = replace(panorama(), parallax_depth_mm=None, parallax_error_mm=None)
    assert with_depth_against_light(without) is without
    nowhere = with_depth_against_light(panorama(np.nan)).parallax_depth_mm
    assert nowhere is not None
    assert np.isnan(nowhere).all()
