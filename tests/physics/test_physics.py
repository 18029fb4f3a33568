"""What rendered pixels, and real ones, have of the physics: each figure is measured by ``benchmarks/physics``."""

from pathlib import Path

import numpy as np
import pytest
from tolerances import (
    ALL_LIGHT_REL,
    ATTENUATION_DB,
    DENSITY_LENGTH_REL,
    DENSITY_SLOPE,
    DIRECT_LIGHT_REL,
    LIGHT_OF_FRAME_REL,
    POINT_SPREAD_REL,
    RAY_MM,
    REAL_SKEW,
    ROLL_OFF_DB,
    SPECKLE_CONTRAST,
    SPECKLE_SIGMA_DB,
    SPECKLE_SKEW,
)

from benchmarks.light import cell
from benchmarks.physics import bscans, mirror
from benchmarks.physics import recordings as real
from benchmarks.physics.inside import inside


def test_bone_and_noise_are_fully_developed_speckle() -> None:
    for found in bscans.bone_and_noise()[:2]:
        assert found.contrast == pytest.approx(1, abs=SPECKLE_CONTRAST)
        assert found.sigma_db == pytest.approx(bscans.RAYLEIGH_DB, abs=SPECKLE_SIGMA_DB)
        assert found.skew == pytest.approx(bscans.RAYLEIGH_SKEW, abs=SPECKLE_SKEW)


def test_grains_of_speckle_are_as_long_as_theory_says() -> None:
    deep_mm, deep, along_mm, along = bscans.grain()
    drawn = bscans.plain().oct
    assert bscans.gaussian_fwhm(deep_mm, deep) == pytest.approx(np.sqrt(2) * 0.012, rel=POINT_SPREAD_REL)
    expected = np.sqrt(2) * drawn.lateral_resolution_mm
    assert bscans.gaussian_fwhm(along_mm, along) == pytest.approx(expected, rel=POINT_SPREAD_REL)


@pytest.mark.parametrize("roll_off_db", [6.0, 10.0])
def test_sensitivity_rolls_off_as_sinc_and_gauss(roll_off_db: float) -> None:
    found, theory = bscans.roll_off_curve(np.arange(20, 500, 60.0), roll_off_db)
    assert theory[-1] < theory[0] - 0.7 * roll_off_db
    np.testing.assert_allclose(found, theory, atol=ROLL_OFF_DB)


@pytest.mark.parametrize("resolution_mm", [0.0085, 0.012])
def test_a_face_is_as_thick_as_the_axial_resolution(resolution_mm: float) -> None:
    assert bscans.axial_spread(resolution_mm)[2] == pytest.approx(resolution_mm, rel=POINT_SPREAD_REL)


def test_an_edge_is_as_soft_as_the_lateral_resolution() -> None:
    _, _, found, drawn = bscans.knife_edge()
    assert found == pytest.approx(drawn, rel=POINT_SPREAD_REL)


def test_light_falls_in_bone_as_beer_and_lambert_say() -> None:
    _, found, theory = bscans.attenuation(0.1)
    assert abs(np.mean(found - theory)) < ATTENUATION_DB
    assert np.sqrt(np.mean((found - theory) ** 2)) < 2 * ATTENUATION_DB


def test_oct_and_ct_show_the_same_density_of_bone() -> None:
    found = inside(every=4)
    assert found.slope == pytest.approx(1, abs=DENSITY_SLOPE)
    assert found.correlation > 0.8
    assert found.length_mm == pytest.approx(found.expected_mm, rel=DENSITY_LENGTH_REL)


@pytest.mark.parametrize("half_angle_deg", [42.0, 45.0, 48.0])
def test_pixels_and_rings_follow_the_closed_forms_of_a_cone(half_angle_deg: float) -> None:
    _, z, expected = mirror.z_of_r(half_angle_deg)
    np.testing.assert_allclose(z, expected, atol=RAY_MM)
    _, drift, expected = mirror.ring_centres(half_angle_deg)
    assert np.abs(expected).min() > 5 * RAY_MM
    np.testing.assert_allclose(drift, expected, atol=RAY_MM)


def test_frames_are_as_bright_as_rays_are_dense_on_the_wall() -> None:
    for half_angle_deg in (42.0, 48.0):
        _, found, expected = mirror.light_along(half_angle_deg)
        np.testing.assert_allclose(found, expected, rtol=LIGHT_OF_FRAME_REL)
    _, found, expected = mirror.light_around()
    assert np.ptp(expected) > 0.2
    np.testing.assert_allclose(found, expected, rtol=LIGHT_OF_FRAME_REL)


def test_a_cell_is_as_bright_as_traced_photons_say() -> None:
    """Direct light on wall and floor, and the light that other bone throws on them."""
    sample, wall = cell.bore(0.5)
    rendered, traced = cell.rendered(sample, wall), cell.traced(sample, 1_000_000)
    counted = 0.02  # one standard error of the photons on the floor
    direct, all_ = cell.rendered_over_traced(rendered, traced, floor=False)
    assert direct == pytest.approx(1, abs=DIRECT_LIGHT_REL)
    assert all_ == pytest.approx(1, abs=ALL_LIGHT_REL / 3)
    direct, all_ = cell.rendered_over_traced(rendered, traced, floor=True)
    assert direct == pytest.approx(1, abs=DIRECT_LIGHT_REL + counted)
    assert all_ == pytest.approx(1, abs=ALL_LIGHT_REL)


def test_real_speckle_is_a_logarithm_cut_at_zero(recordings: Path) -> None:
    """Skew, from −0.9 where it is bright to +0.8 in the noise, follows from one scale and each region's level."""
    regions, _ = real.swept_source(recordings / "axsun-oct")
    skew = np.array([region.skew for region in regions])
    model = np.array([region.model_skew for region in regions])
    assert skew.min() < -0.8
    assert skew.max() > 0.7
    assert np.abs(skew - model).max() < REAL_SKEW
    assert np.corrcoef(skew, model)[0, 1] > 0.98
    assert all(0.9 < region.contrast < 1.25 for region in regions)
