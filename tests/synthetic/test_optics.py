"""Beams, faces, speckle and the cone mirror, against values worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import COORDINATE_ATOL

from endoct.synthetic.beams import beam_angle_rad, distance_to_circle_mm, trace
from endoct.synthetic.bscan import Appearance, build_appearance, noise_free_field, oversampled, speckle
from endoct.synthetic.cone import wall_z_mm
from endoct.synthetic.draw import draw
from endoct.synthetic.parameters import Sample
from endoct.synthetic.wall import Wall, build_wall

N = 720
TURN = 2 * np.pi * np.arange(N) / N


@pytest.fixture(scope="module")
def sample() -> Sample:
    drawn = draw("quick", 2)
    # nothing that could cross the outer face
    plain = drawn.oct.model_copy(update={"sheath": (), "detector_line_db": -60.0})
    return drawn.model_copy(update={"oct": plain})


@pytest.fixture(scope="module")
def wall(sample: Sample) -> Wall:
    return build_wall(sample)


@pytest.fixture(scope="module")
def appearance(sample: Sample, wall: Wall) -> Appearance:
    return build_appearance(sample, wall)


@given(radius=st.floats(0.5, 1.5), offset=st.floats(0.0, 0.3), direction=st.floats(0, 6.3), alpha=st.floats(0, 6.3))
def test_a_beam_ends_on_the_circle(radius: float, offset: float, direction: float, alpha: float) -> None:
    rho = float(distance_to_circle_mm(radius, offset, np.array([alpha - direction]))[0])
    x = offset * math.cos(direction) + rho * math.cos(alpha)
    y = offset * math.sin(direction) + rho * math.sin(alpha)
    assert math.hypot(x, y) == pytest.approx(radius, abs=COORDINATE_ATOL)
    assert rho > 0


def test_beams_of_an_offset_catheter_by_hand() -> None:
    along, across = distance_to_circle_mm(0.85, 0.2, np.array([0.0, np.pi / 2]))
    assert along == pytest.approx(0.65)
    assert across == pytest.approx(math.sqrt(0.85**2 - 0.2**2))


def test_the_wall_is_hit_where_it_is(sample: Sample, wall: Wall) -> None:
    echoes = trace(sample.oct, wall, 0, TURN, reach_mm=6.0)
    z = np.full(N, echoes.wall_z_mm)
    relief = wall.at(wall.relief_mm, z, echoes.wall_theta_rad)
    assert np.all(np.isfinite(echoes.wall_path_mm))
    miss = np.abs(echoes.wall_radius_mm - wall.radius_mm - relief)
    assert np.median(miss) < 0.001
    assert np.quantile(miss, 0.95) < 0.02  # the steep side of a cell lies between two steps


def test_the_angle_on_the_wall_differs_from_the_beams_by_up_to_asin_e_over_r(sample: Sample, wall: Wall) -> None:
    echoes = trace(sample.oct, wall, 0, TURN, reach_mm=6.0)
    apart = np.angle(np.exp(1j * (echoes.wall_theta_rad - echoes.alpha_rad)))
    most = math.asin(sample.oct.offset_mm[0] / wall.radius_mm)
    assert np.abs(apart).max() == pytest.approx(most, rel=0.1)


def test_the_outer_face_appears_where_the_closed_form_says(sample: Sample, wall: Wall, appearance: Appearance) -> None:
    oct_ = sample.oct
    slice_index = 7
    echoes = trace(oct_, wall, slice_index, TURN, reach_mm=2.4)
    field = noise_free_field(oct_, echoes, wall, appearance, 512, np.random.default_rng(0))
    gamma = beam_angle_rad(oct_, slice_index, TURN) - oct_.offset_direction_rad[slice_index]
    e, outer_radius = oct_.offset_mm[slice_index], oct_.capillary_outer_diameter_mm / 2
    outer = -e * np.cos(gamma) + np.sqrt(outer_radius**2 - (e * np.sin(gamma)) ** 2)
    inner = -e * np.cos(gamma) + np.sqrt((outer_radius - oct_.glass_mm) ** 2 - (e * np.sin(gamma)) ** 2)
    expected = (outer + (oct_.glass_index - 1) * (outer - inner) - oct_.first_sample_mm) / oct_.axial_pixel_mm
    window = np.rint(expected).astype(int)[None, :] + np.arange(-6, 7)[:, None]
    brightness = np.abs(field[window, np.arange(N)[None, :]]) ** 2
    found = (brightness * window).sum(axis=0) / brightness.sum(axis=0)
    assert np.abs(found - expected).max() < 0.25
    assert np.abs(field[:50]).max() == pytest.approx(0, abs=1e-2)


def test_bone_is_fully_developed_speckle() -> None:
    field = speckle(np.random.default_rng(1), (400, 2000), 0.7, 2.5)
    level_db = 20 * np.log10(np.abs(field))
    assert np.mean(np.abs(field) ** 2) == pytest.approx(1, rel=0.03)
    assert level_db.std() == pytest.approx(5.57, abs=0.1)
    skew = np.mean((level_db - level_db.mean()) ** 3) / level_db.std() ** 3
    assert skew == pytest.approx(-1.14, abs=0.1)


def test_speckle_has_no_seam_and_its_grain_is_the_resolution() -> None:
    field = speckle(np.random.default_rng(2), (600, 600), 0.7, 3.0)

    def correlation(shift: int) -> float:
        product = field * np.conj(np.roll(field, shift, axis=1))
        return float(np.abs(product.mean()))

    # a field blurred with √2·3 samples correlates as exp(−s²/(4·2·3²))
    assert correlation(4) == pytest.approx(math.exp(-16 / 72), abs=0.05)
    across_the_seam = np.abs(np.mean(field[:, 0] * np.conj(field[:, -1])))
    assert across_the_seam == pytest.approx(math.exp(-1 / 72), abs=0.1)


def test_oversampling_does_not_depend_on_the_blocks() -> None:
    field = speckle(np.random.default_rng(3), (32, 90), 0.7, 2.5)
    whole = oversampled(field, 0, 90, 7)
    parts = np.concatenate([oversampled(field, 0, 40, 7), oversampled(field, 40, 90, 7)], axis=1)
    np.testing.assert_allclose(whole, parts, atol=1e-5)
    assert whole.shape == (32, 630)
    np.testing.assert_allclose(whole[:, 3::7], field, atol=1e-5)


def test_a_cone_of_45_degrees_is_linear_in_z() -> None:
    r = np.array([100.0, 150.0, 200.0])
    z = wall_z_mm(r, 600.0, 4.0, math.pi / 4, 1.25)
    np.testing.assert_allclose(z, (1.25 + 4.0) * r / 600.0)


@given(half_angle_deg=st.floats(42, 48), r_px=st.floats(60, 280), distance=st.floats(3, 6))
def test_cone_rays_meet_the_published_closed_form(half_angle_deg: float, r_px: float, distance: float) -> None:
    a, f, radius = math.radians(half_angle_deg), 650.0, 1.25
    closed = -distance * math.cos(2 * a) + (radius + distance * math.sin(2 * a)) / math.tan(2 * a - math.atan(r_px / f))
    assert float(wall_z_mm(np.array([r_px]), f, distance, a, radius)[0]) == pytest.approx(closed, abs=1e-9)
