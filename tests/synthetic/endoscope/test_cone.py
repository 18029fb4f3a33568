"""The cone mirror: where pixels look, against closed forms and brute force."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import COORDINATE_ATOL, RAY_MM

from endoct.base.arrays import Coordinates, Image
from endoct.base.errors import EndoctError
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import PixelMaps, pixel_maps
from endoct.synthetic.endoscope.cone import Cone, FrameView, band_centre_mm, cone_of, focal_length_px
from endoct.synthetic.sample.parameters import Endoscope, Sample

RADIUS_MM, APEX_MM, N_THETA, DZ_MM = 1.25, 2.0, 720, 0.01
CENTRE = (321.3, 238.6)
OPTICS = {"visible_length_mm": 1.0, "mirror_distance_mm": 4.0, "inner_px": 100.0, "outer_px": 205.0}

DRAWN = draw("learning", 1)


def wall_of(relief_mm: float | Image = 0.0, n_z: int = 700) -> Wall:
    relief = np.broadcast_to(np.float32(relief_mm), (n_z, N_THETA)).copy()
    zero = np.zeros_like(relief)
    return Wall(
        radius_mm=RADIUS_MM,
        dz_mm=DZ_MM,
        relief_mm=relief,
        cell=relief > 0.05,
        cell_id=(relief > 0.05).astype(np.int32),
        albedo=zero + 1,
        rim=zero,
        slope_z=np.gradient(relief, np.float32(DZ_MM), axis=0),
        slope_theta=zero,
        wet=zero,
        scene=None,  # type: ignore[arg-type]
    )


def sample_of(half_angle_deg: float = 45.0, distortion: float = 0.0, **changes: Any) -> Sample:
    """A probe with its apex at z = APEX_MM, on the bore's axis unless ``changes`` say otherwise."""
    drawn = DRAWN
    n = len(drawn.endoscope.z_mm)
    optics = OPTICS | {"half_angle_deg": half_angle_deg, "distortion": distortion}
    camera = drawn.endoscope.model_copy(
        update=optics
        | {
            "width_px": 640,
            "height_px": 480,
            "focal_px": focal_length_px(optics, OPTICS["inner_px"], OPTICS["outer_px"], RADIUS_MM),
            "inner_shift_px": (0.0, 0.0),
            "centre_px": (CENTRE,) * n,
            "offset_mm": ((0.0, 0.0),) * n,
            "roll_rad": (0.7,) * n,
            "probe_tilt_rad": 0.0,
            "dirt": (),
            "droplets": (),
            "debris": (),
        }
        | changes
    )
    band = band_centre_mm(camera, RADIUS_MM)
    return drawn.model_copy(update={"endoscope": camera.model_copy(update={"z_mm": (APEX_MM + band,) * n})})


def closed_form_mm(camera: Endoscope, r_px: Coordinates, radius_mm: float = RADIUS_MM) -> tuple[Coordinates, ...]:
    """z from the apex and m = cot(2a − ψ), of radii in the image; the lens is undone by a table."""
    a, f, d = math.radians(camera.half_angle_deg), camera.focal_px, camera.mirror_distance_mm
    t = np.linspace(0, 1.2 * camera.outer_px / f / (1 + camera.distortion), 20001)
    psi = np.arctan(np.interp(r_px, f * (t + camera.distortion_k1 * t**3), t))
    m = 1 / np.tan(2 * a - psi)
    return -d * math.cos(2 * a) + (radius_mm + d * math.sin(2 * a)) * m, m


def pixels(maps: PixelMaps) -> tuple[Coordinates, Coordinates, Coordinates, Coordinates]:
    """Radius and angle in the image, z from the apex, and θ, of the pixels that see the wall."""
    row, column = np.nonzero(maps.valid)
    dx, dy = column - CENTRE[0], row - CENTRE[1]
    z = maps.z_mm[row, column].astype(float) - APEX_MM
    return np.hypot(dx, dy), np.arctan2(dy, dx), z, maps.theta_rad[row, column].astype(float)


def apart(a: Coordinates, b: Coordinates) -> Coordinates:
    return np.angle(np.exp(1j * (a - b)))


def test_a_cone_of_45_degrees_is_linear_in_z() -> None:
    r = np.array([100.0, 150.0, 200.0])
    z = Cone(math.pi / 4, 4.0, 600.0).wall_z_mm(r, 1.25)
    np.testing.assert_allclose(z, (1.25 + 4.0) * r / 600.0)


@given(half_angle_deg=st.floats(30, 60), r_px=st.floats(60, 280), distance=st.floats(1, 20), k1=st.floats(-0.2, 0.5))
def test_cone_rays_meet_the_closed_form(half_angle_deg: float, r_px: float, distance: float, k1: float) -> None:
    a, f, radius = math.radians(half_angle_deg), 650.0, 1.25
    t = r_px / f
    image = np.array([f * t * (1 + k1 * t**2)])
    closed = -distance * math.cos(2 * a) + (radius + distance * math.sin(2 * a)) / math.tan(2 * a - math.atan(t))
    assert float(Cone(a, distance, f, k1).wall_z_mm(image, radius)[0]) == pytest.approx(closed, abs=COORDINATE_ATOL)


@pytest.mark.parametrize("half_angle_deg", [30.0, 42.0, 45.0, 60.0])
@pytest.mark.parametrize("distortion", [-0.2, 0.0, 0.02])
def test_the_annulus_spans_what_it_is_to_show(half_angle_deg: float, distortion: float) -> None:
    camera = sample_of(half_angle_deg, distortion).endoscope
    rims = np.array([camera.inner_px, camera.outer_px])
    assert np.ptp(cone_of(camera).wall_z_mm(rims, RADIUS_MM)) == pytest.approx(camera.visible_length_mm)
    ideal = camera.outer_px / (1 + distortion)
    assert ideal * (1 + camera.distortion_k1 * (ideal / camera.focal_px) ** 2) == pytest.approx(camera.outer_px)


def test_a_mirror_that_cannot_show_so_much_is_refused() -> None:
    with pytest.raises(EndoctError, match="visible_length_mm 5 at mirror_distance_mm 1") as caught:
        focal_length_px(
            {"visible_length_mm": 5.0, "mirror_distance_mm": 1.0, "half_angle_deg": 45.0, "distortion": 0.0},
            100.0,
            205.0,
            RADIUS_MM,
        )
    assert "expected up to 1." in str(caught.value)


@pytest.mark.parametrize("half_angle_deg", [30.0, 42.0, 45.0, 48.0, 60.0])
@pytest.mark.parametrize("distortion", [-0.05, 0.0, 0.02])
def test_pixels_see_the_wall_where_the_closed_form_says(half_angle_deg: float, distortion: float) -> None:
    sample = sample_of(half_angle_deg, distortion)
    r_px, angle, z, theta = pixels(pixel_maps(sample, wall_of(), 0))
    np.testing.assert_allclose(z, closed_form_mm(sample.endoscope, r_px)[0], atol=RAY_MM)
    np.testing.assert_allclose(RADIUS_MM * apart(theta, angle + 0.7), 0, atol=RAY_MM)
    assert r_px.size == pytest.approx(math.pi * (205.0**2 - 100.0**2), rel=0.001)


@pytest.mark.parametrize("half_angle_deg", [30.0, 45.0, 60.0])
def test_a_deeper_wall_is_seen_farther_along_the_ray(half_angle_deg: float) -> None:
    sample, deeper = sample_of(half_angle_deg), 0.3
    near, far = (pixel_maps(sample, wall_of(relief), 0) for relief in (0.0, deeper))
    r_px, _, z, _ = pixels(near)
    m = closed_form_mm(sample.endoscope, r_px)[1]
    np.testing.assert_allclose(pixels(far)[2] - z, deeper * m, atol=RAY_MM)
    np.testing.assert_allclose(far.depth_mm[far.valid], deeper, atol=RAY_MM)


# the bore's axis is off by e towards φ as the probe sees it, and leans by τ: the probe is off and leans the other way
E_MM, TAU_RAD, PHI_RAD = 0.015, 0.002, 0.9
MISALIGNED = {
    "offset_mm": ((-E_MM * math.cos(PHI_RAD), -E_MM * math.sin(PHI_RAD)),) * 16,
    "probe_tilt_rad": TAU_RAD,
    "probe_tilt_direction_rad": PHI_RAD + math.pi,
}


@pytest.mark.parametrize("half_angle_deg", [42.0, 45.0, 48.0])
def test_an_offset_and_a_tilt_move_what_is_seen_as_the_closed_form_says(half_angle_deg: float) -> None:
    sample = sample_of(half_angle_deg, 0.02, **MISALIGNED)
    r_px, angle, z, theta = pixels(pixel_maps(sample, wall_of(), 0))
    z0, m = closed_form_mm(sample.endoscope, r_px)
    off = E_MM + TAU_RAD * z0
    angle = angle + 0.7
    expected = z0 + (m * off + TAU_RAD * RADIUS_MM) * np.cos(angle - PHI_RAD)
    np.testing.assert_allclose(z, expected, atol=RAY_MM)
    # what the probe sees at θ lies at θ + (e/R) sin(θ − φ) as seen from the bore's axis, turned with it
    turned = apart(theta, angle) - off / RADIUS_MM * np.sin(angle - PHI_RAD)
    np.testing.assert_allclose(RADIUS_MM * turned, 0, atol=RAY_MM)


@pytest.mark.parametrize("half_angle_deg", [42.0, 45.0, 48.0])
def test_the_centres_of_rings_drift_with_their_radius_as_the_closed_form_says(half_angle_deg: float) -> None:
    sample = sample_of(half_angle_deg, 0.02, roll_rad=(0.0,) * 16, **MISALIGNED)
    camera = sample.endoscope
    r_px, angle, z, _ = pixels(pixel_maps(sample, wall_of(), 0))
    ring_px = np.array([115.0, 150.0, 190.0])
    z0, m = closed_form_mm(camera, ring_px)
    steps = (closed_form_mm(camera, ring_px + 0.5)[0] - closed_form_mm(camera, ring_px - 0.5)[0]).astype(float)
    for r0, level, slope, mm_per_px in zip(ring_px, z0, m, steps, strict=True):
        near = np.abs(r_px - r0) < 4
        # every pixel near the ring, moved along its radius to where z has the ring's value
        ring = r_px[near] + (level - z[near]) / mm_per_px
        design = np.stack([np.ones(ring.size), np.cos(angle[near]), np.sin(angle[near])], axis=1)
        _, x, y = np.linalg.lstsq(design, ring, rcond=None)[0]
        drift_mm = -(slope * (E_MM + TAU_RAD * level) + TAU_RAD * RADIUS_MM)
        np.testing.assert_allclose(
            np.array([x, y]) * mm_per_px, drift_mm * np.array([math.cos(PHI_RAD), math.sin(PHI_RAD)]), atol=RAY_MM
        )


def test_a_ray_ends_on_the_first_bone_it_meets() -> None:
    """Against steps of 0.4 µm with float64, over pits with steep sides and thin bone between them."""
    rng = np.random.default_rng(4)
    z, column = np.mgrid[:700, :N_THETA].astype(np.float32)
    relief = 0.004 * rng.standard_normal((700, N_THETA)).astype(np.float32)
    for _ in range(120):
        at_z, at_column, size = rng.uniform(200, 500), rng.uniform(0, N_THETA), rng.uniform(0.05, 0.3)
        around = (np.mod(column - at_column + N_THETA / 2, N_THETA) - N_THETA / 2) * 2 * np.pi * RADIUS_MM / N_THETA
        inside = np.hypot((z - at_z) * DZ_MM, around) < size
        relief[inside] = np.maximum(relief[inside], rng.uniform(0.05, 1.0))
    sample, wall = sample_of(42.0, offset_mm=((0.03, -0.02),) * 16), wall_of(relief)
    camera, seen = sample.endoscope, pixel_maps(sample, wall, 0)
    chosen = rng.choice(np.flatnonzero(seen.valid), 150, replace=False)
    row, col = np.divmod(chosen, camera.width_px)
    dx, dy = col - CENTRE[0], row - CENTRE[1]
    rays = cone_of(camera).rays(np.hypot(dx, dy))
    theta = np.arctan2(dy, dx) + 0.7
    rho = np.arange(1.15, 2.4, 0.0004)[:, None]
    x, y = 0.03 + rho * np.cos(theta), -0.02 + rho * np.sin(theta)
    along = APEX_MM + rays.z_mm + (rho - rays.rho_mm) * rays.inward / rays.outward
    excess = np.hypot(x, y) - RADIUS_MM
    excess -= wall.at(wall.relief_mm, along.ravel(), np.arctan2(y, x).ravel()).reshape(rho.size, -1)
    first = np.argmax(excess >= 0, axis=0)
    radius = np.hypot(x, y)[first, np.arange(chosen.size)]
    miss = np.abs(seen.depth_mm.ravel()[chosen] + RADIUS_MM - radius)
    assert (seen.cell.ravel()[chosen] > 0).mean() > 0.2
    assert np.median(miss) < RAY_MM
    # where a ray runs down a side, its place there is known to the width of a step of the maps
    assert np.mean(miss < 2 * RAY_MM) > 0.95
    far = np.abs(seen.z_mm.ravel()[chosen] - along[first, np.arange(chosen.size)]) > DZ_MM
    assert far.mean() < 0.02, "rays that cut a corner thinner than a step"


def test_a_view_is_that_of_its_frame() -> None:
    camera = draw("learning", 3).endoscope
    views = [FrameView.of(camera, k, RADIUS_MM) for k in (0, 2)]
    for k, view in zip((0, 2), views, strict=True):
        assert (view.centre_px, view.roll_rad) == (camera.centre_px[k], camera.roll_rad[k])
        assert (view.offset_mm, view.middle_mm) == (camera.offset_mm[k], camera.z_mm[k])
        assert view.apex_mm + band_centre_mm(camera, RADIUS_MM) == pytest.approx(camera.z_mm[k])
    for name in ("centre_px", "roll_rad", "offset_mm", "middle_mm"):
        assert getattr(views[0], name) != getattr(views[1], name)
