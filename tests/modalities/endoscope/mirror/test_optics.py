"""z of an image radius, against the closed form by hand and a ray traced off the cone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import COORDINATE_ATOL

from endoct.base.errors import EndoctError
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.optics import ConeOptics, assumed_cone, stated_optics, stretched, turned

RADII_PX = np.array([100.0, 130.0, 170.0, 200.0])


def cone(half_angle_deg: float = 45.0, distortion: tuple[float, ...] = (), focal_px: float = 700.0) -> ConeOptics:
    return ConeOptics(100.0, 200.0, float(np.deg2rad(half_angle_deg)), focal_px, 4.0, 1.25, distortion)


def test_a_cone_of_45_degrees_is_linear() -> None:
    z = cone().z_mm(RADII_PX)
    np.testing.assert_allclose(z, (1.25 + 4.0) / 700 * (RADII_PX - 150), atol=COORDINATE_ATOL)
    assert cone().visible_length_mm == pytest.approx(0.75)


@pytest.mark.parametrize("half_angle_deg", [40.0, 45.0, 48.0])
def test_the_closed_form_is_where_a_traced_ray_meets_the_wall(half_angle_deg: float) -> None:
    """The camera at the origin looks along +z; the cone's apex lies at z = 4 mm, its axis is the camera's."""
    half = np.deg2rad(half_angle_deg)
    met = []
    for r in RADII_PX:
        ray = np.array([r / 700, 1.0])  # (radial, axial)
        t = 4.0 * np.tan(half) / (np.tan(half) - ray[0])  # radial = (axial − 4)·tan(half angle)
        mirror = t * ray
        normal = np.array([np.cos(half), -np.sin(half)])
        out = ray - 2 * (ray @ normal) * normal
        met.append(mirror[1] - 4.0 + out[1] * (1.25 - mirror[0]) / out[0])
    expected = np.array(met) - (met[0] + met[-1]) / 2
    np.testing.assert_allclose(cone(half_angle_deg).z_mm(RADII_PX), expected, atol=COORDINATE_ATOL)


@given(
    st.floats(40, 50),
    st.floats(-0.3, 0.3),
    st.sampled_from([1, -1]),
)
def test_there_and_back(half_angle_deg: float, k1: float, sign: int) -> None:
    optics = cone(half_angle_deg, (k1, 0.1 * k1))
    optics = optics if sign > 0 else turned(optics)
    np.testing.assert_allclose(optics.r_px(optics.z_mm(RADII_PX)), RADII_PX, atol=1e-6)
    assert np.all(np.sign(np.diff(optics.z_mm(RADII_PX))) == sign)


def test_an_assumed_cone_is_linear_spans_the_visible_length_and_can_look_behind() -> None:
    ahead = assumed_cone(100.0, 200.0, 1.0, 1.25)
    np.testing.assert_allclose(ahead.z_mm(RADII_PX), [-0.5, -0.2, 0.2, 0.5])
    np.testing.assert_allclose(turned(ahead).z_mm(RADII_PX), [0.5, 0.2, -0.2, -0.5])
    np.testing.assert_allclose(turned(ahead).r_px(np.array([0.5])), [100.0])


@pytest.mark.parametrize("half_angle_deg", [40.0, 44.0, 45.0, 49.0])
def test_the_cone_is_found_by_how_uneven_a_feed_looks_with_the_assumed_one(half_angle_deg: float) -> None:
    """A feed that is even on the wall moves the image by 1/(dz/dr): that is all the assumed cone is told."""
    true = cone(half_angle_deg)
    inner, outer = (float(np.diff(true.z_mm(np.array([r - 0.01, r + 0.01])))[0]) for r in (100.0, 200.0))
    assumed = assumed_cone(100.0, 200.0, true.visible_length_mm, 1.25)
    found = stretched(assumed, (inner - outer) / (inner + outer))
    assert found.visible_length_mm == pytest.approx(true.visible_length_mm)
    off = np.abs(found.z_mm(RADII_PX) - true.z_mm(RADII_PX)).max()
    assert off < 0.1 * np.abs(assumed.z_mm(RADII_PX) - true.z_mm(RADII_PX)).max() + 1e-6


@given(st.floats(-2.0, 2.0))
def test_no_unevenness_is_too_large_to_be_answered(stretch: float) -> None:
    assert stretched(assumed_cone(100.0, 200.0, 0.8, 1.25), stretch).visible_length_mm == pytest.approx(0.8)


@pytest.mark.parametrize("sign", [1, -1])
def test_rays_go_on_by_the_slant(sign: int) -> None:
    mirror = cone(46.0) if sign > 0 else turned(cone(46.0))
    wider = replace(mirror, bore_radius_mm=1.26)
    ahead = wider.ahead_mm(RADII_PX) - mirror.ahead_mm(RADII_PX)
    np.testing.assert_allclose(mirror.slant(RADII_PX), sign * ahead / 0.01, rtol=1e-9)


def stated(**keys: object) -> tuple[ConeOptics, tuple[str, ...]]:
    return stated_optics(EndoscopeAcquisition.model_validate({"bore_diameter_mm": 2.5, **keys}), 100.0, 200.0)


MIRROR = {"cone_half_angle_deg": 45.0, "focal_px": 700.0, "mirror_distance_mm": 4.0}


def test_the_mirror_is_used_where_it_is_known_and_a_contradiction_is_noted() -> None:
    optics, notes = stated(**MIRROR, visible_length_mm=0.76)
    assert not optics.assumed
    assert notes == ()
    optics, notes = stated(**MIRROR, visible_length_mm=0.9)
    assert "0.75 mm" in notes[0]
    assert "0.90 mm" in notes[0]


def test_half_a_mirror_is_not_used_and_said_so() -> None:
    optics, notes = stated(visible_length_mm=0.9, focal_px=700.0)
    assert optics.assumed
    assert "cone_half_angle_deg" in notes[0]


def test_without_any_scale_the_error_says_what_to_add() -> None:
    with pytest.raises(EndoctError, match="visible_length_mm"):
        stated(focal_px=700.0)


def test_optics_that_cannot_be_are_refused() -> None:
    with pytest.raises(EndoctError, match="do not fit the annulus"):
        cone(focal_px=150.0)
