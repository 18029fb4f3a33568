"""The endoscope's light and sensor, against the laws they follow."""

import math

import numpy as np
import pytest
from tolerances import LIGHT_REL, NOISE_REL

from endoct.base.arrays import Coordinates, Image
from endoct.synthetic.bone.wall import Wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import compressed, displayed, noise_free, noisy, pixel_maps, render_frame
from endoct.synthetic.endoscope.cone import FrameView, cone_of, focal_length_px
from endoct.synthetic.endoscope.lighting import light, lighting_of, lit_frame
from endoct.synthetic.endoscope.sight import View, follow, view
from endoct.synthetic.sample.parameters import Debris, Droplet, Sample, Speck
from tests.synthetic.fingerprints import KINDS, changed

RADIUS_MM, CENTRE, INNER_PX, OUTER_PX = 1.25, (159.7, 120.4), 50.0, 105.0
MIDDLE_PX = (INNER_PX + OUTER_PX) / 2
EVEN = {
    "exposure": 1.0,
    "saturated": 0.0,
    "fibre_ring_mm": 0.0,
    "bone_albedo": 0.0,
    "vignetting": 0.0,
    "bright_side": 0.0,
    "gloss": 0.0,
    "ring_gain": 0.0,
    "inner_shift_px": (0.0, 0.0),
    "dirt": (),
    "droplets": (),
    "debris": (),
    "colour": False,
}
DRAWN = draw("learning", 1)


def sample_of(half_angle_deg: float = 45.0, **changes: object) -> Sample:
    optics = {"visible_length_mm": 1.0, "mirror_distance_mm": 4.0, "half_angle_deg": half_angle_deg, "distortion": 0.02}
    n = len(DRAWN.endoscope.z_mm)
    motion = {
        "z_mm": (2.0,) * n,
        "offset_mm": ((0.0, 0.0),) * n,
        "centre_px": (CENTRE,) * n,
        "roll_rad": (0.0,) * n,
        "probe_tilt_rad": 0.0,
        "width_px": 320,
        "height_px": 240,
        "inner_px": INNER_PX,
        "outer_px": OUTER_PX,
        "focal_px": focal_length_px(optics, INNER_PX, OUTER_PX, RADIUS_MM),
    }
    camera = DRAWN.endoscope.model_copy(update=optics | motion | EVEN | changes)
    return DRAWN.model_copy(update={"endoscope": camera, "seed": 7})


def wall_of(relief_mm: float = 0.0, wet: float = 0.0, slope_z: float = 0.0) -> Wall:
    zero = np.zeros((500, 720), np.float32)
    return Wall(
        radius_mm=RADIUS_MM,
        dz_mm=0.01,
        relief_mm=zero + np.float32(relief_mm),
        cell=zero > 0,
        cell_id=np.zeros(zero.shape, np.int32),
        albedo=zero + 1,
        rim=zero,
        slope_z=zero + np.float32(slope_z),
        slope_theta=zero,
        wet=zero + np.float32(wet),
        scene=None,  # type: ignore[arg-type]
    )


def seen_light(sample: Sample, wall: Wall) -> tuple[View, Image]:
    frame = FrameView.of(sample.endoscope, 0, wall.radius_mm)
    seen = view(frame)
    reached, lit = lit_frame(frame, wall, lighting_of(sample, wall))
    return seen, light(frame, lit, seen, follow(reached, frame, seen)).T


def tan_psi(sample: Sample, r_px: Coordinates) -> Coordinates:
    camera = sample.endoscope
    t = np.linspace(0, 1.2 * OUTER_PX / camera.focal_px, 20001)
    return np.interp(r_px, camera.focal_px * (t + camera.distortion_k1 * t**3), t)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_makes_the_frame_that_was_published(kind: str) -> None:
    assert changed("frame", kind) == []


@pytest.mark.parametrize("half_angle_deg", [30.0, 45.0, 60.0])
def test_the_wall_is_as_bright_as_rays_of_light_are_dense_on_it(half_angle_deg: float) -> None:
    """Rays leave the pinhole evenly over solid angle; how densely they arrive needs neither a cosine nor a path."""
    sample = sample_of(half_angle_deg)
    seen, found = seen_light(sample, wall_of())
    r = np.array([MIDDLE_PX, *np.linspace(INNER_PX + 2, OUTER_PX - 2, 23)])
    step = 1e-3
    psi = [np.arctan(tan_psi(sample, r + k * step)) for k in (-1, 0, 1)]
    z = [cone_of(sample.endoscope).wall_z_mm(r + k * step, RADIUS_MM) for k in (-1, 1)]
    density = np.sin(psi[1]) * (psi[2] - psi[0]) / (z[1] - z[0])
    outward = cone_of(sample.endoscope).rays(np.array([MIDDLE_PX])).outward[0]
    expected = outward * density[1:] / density[0]
    order = np.argsort(seen.r_px)
    rendered = np.interp(r[1:], seen.r_px[order], found[order, 0])
    np.testing.assert_allclose(rendered, expected, rtol=LIGHT_REL)


@pytest.mark.parametrize("half_angle_deg", [30.0, 45.0, 60.0])
def test_light_falls_with_the_cosine_and_the_unfolded_path(half_angle_deg: float) -> None:
    sample = sample_of(half_angle_deg)
    a, d = math.radians(half_angle_deg), sample.endoscope.mirror_distance_mm
    for relief in (0.0, 0.2):
        seen, found = seen_light(sample, wall_of(relief))
        # the pinhole as the mirror shows it lies at R + d sin 2a from the wall, in the plane of the ray
        psi = np.arctan(tan_psi(sample, np.append(seen.r_px.astype(float), MIDDLE_PX)))
        radius = np.append(np.full(seen.r_px.size, RADIUS_MM + relief), RADIUS_MM)
        path = (radius + d * math.sin(2 * a)) / np.sin(2 * a - psi)
        irradiance = np.sin(psi) / (path * radius)
        expected = np.sin(2 * a - psi) * irradiance / irradiance[-1]
        np.testing.assert_allclose(found[:, 0], expected[:-1], rtol=LIGHT_REL)


def test_a_wall_that_leans_is_lit_by_its_own_cosine() -> None:
    sample = sample_of(60.0)
    seen, plain = seen_light(sample, wall_of())
    leaning = seen_light(sample, wall_of(slope_z=0.3))[1]
    incidence = np.pi / 2 - (2 * np.pi / 3 - np.arctan(tan_psi(sample, seen.r_px.astype(float))))
    expected = np.cos(incidence - math.atan(-0.3)) / np.cos(incidence)
    np.testing.assert_allclose((leaning / plain)[:, 0], expected, rtol=LIGHT_REL)


def test_a_glossy_wall_shines_where_it_faces_the_ray_and_most_where_it_is_wet() -> None:
    """With a half angle of 48° the wall is seen squarely at ψ = 6°."""
    matt, glossy = (sample_of(48.0, gloss=g, gloss_rad=0.05) for g in (0.0, 0.5))
    seen, without = seen_light(matt, wall_of())
    shine = seen_light(glossy, wall_of())[1] - without
    incidence = np.arctan(tan_psi(matt, seen.r_px.astype(float))) - math.radians(6)
    lobe = 0.5 * without[:, 0] / np.cos(incidence) * np.exp(-0.5 * (np.tan(incidence) / 0.05) ** 2)
    np.testing.assert_allclose(shine[:, 0], lobe, rtol=10 * LIGHT_REL, atol=1e-5)
    wet = seen_light(matt, wall_of(wet=1.0))[1]
    square = np.abs(incidence) < 0.02
    assert (wet[square] > 1.1 * without[square]).all(), "a fluid shines where it is square"
    assert (wet[~(np.abs(incidence) < 0.15)] < 0.7 * without[~(np.abs(incidence) < 0.15)]).all(), (
        "and is dark elsewhere"
    )


def test_bone_seen_squarely_in_the_middle_of_the_annulus_has_a_light_of_one() -> None:
    # 2a − ψ = 90° in the middle of the annulus
    sample = sample_of(48.0)
    psi = math.degrees(math.atan(float(tan_psi(sample, np.array([MIDDLE_PX]))[0])))
    sample = sample_of(45 + psi / 2)
    seen, found = seen_light(sample, wall_of())
    assert found[np.abs(seen.r_px - MIDDLE_PX) < 0.5].mean() == pytest.approx(1.0, rel=0.005)


def test_the_probe_lights_one_side_more_and_the_lens_shows_the_middle_of_the_image_best() -> None:
    seen, even = seen_light(sample_of(), wall_of())
    uneven = seen_light(sample_of(bright_side=0.3, bright_side_rad=1.0, vignetting=0.4), wall_of())[1]
    angle = np.arctan2(seen.y_px, seen.x_px)
    expected = (1 + 0.3 * np.cos(angle - 1.0)) * (1 - 0.4 * (seen.r_px / OUTER_PX) ** 2)
    np.testing.assert_allclose((uneven / even)[:, 0], expected, rtol=LIGHT_REL)


def test_what_lies_on_mirror_and_wall_is_seen_there() -> None:
    plain = sample_of()
    things = sample_of(
        dirt=(Speck(x_px=-75, y_px=0, sigma_px=3, loss=0.8),),
        droplets=(Droplet(x_px=0, y_px=75, radius_px=10, bend_px=4, shine=0.4),),
        debris=(Debris(z_mm=2.0, theta_rad=0.0, size_mm=0.1, gain=1.4),),
    )
    seen, without = seen_light(plain, wall_of())
    found = seen_light(things, wall_of())[1]
    frame = pixel_maps(things, wall_of(), 0)
    hidden = frame.obscured.ravel()[seen.pixel]
    changed = np.abs(found - without)[:, 0] > 0.25 * without[:, 0]
    assert changed.sum() > 100
    assert (hidden[changed]).mean() > 0.9
    speck = np.argmin(np.hypot(seen.x_px + 75, seen.y_px))
    away = math.hypot(seen.x_px[speck] + 75, seen.y_px[speck])
    kept = 1 - 0.8 * math.exp(-0.5 * (away / 3) ** 2)
    assert found[speck, 0] == pytest.approx(kept * without[speck, 0], rel=LIGHT_REL)
    # through the droplet everything looks larger: the view leads towards its middle by at most bend_px
    z, bent = (pixel_maps(one, wall_of(), 0).z_mm for one in (plain, things))
    mm_per_px = 1.0 / (OUTER_PX - INNER_PX)
    assert np.nanmax(np.abs(bent - z)) == pytest.approx(4 * mm_per_px, rel=0.05)
    column, row = round(CENTRE[0]), round(CENTRE[1] + 75)
    assert (bent - z)[row + 5, column] < 0 < (bent - z)[row - 5, column]
    assert not pixel_maps(plain, wall_of(), 0).obscured.any()


def test_noise_grows_with_the_light_as_shot_noise_does() -> None:
    camera = sample_of(full_well=5000.0, read_noise=20.0).endoscope
    levels = np.linspace(0, 0.9, 10, dtype=np.float32)
    signal = np.repeat(levels[:, None], 200_000, axis=1)
    values = noisy(camera, signal, np.random.default_rng(3))
    np.testing.assert_allclose(values.mean(axis=1), levels, atol=1e-4)
    slope, offset = np.polyfit(levels, values.var(axis=1, dtype=np.float64), 1)
    assert slope == pytest.approx(1 / 5000, rel=NOISE_REL)
    assert offset == pytest.approx((20 / 5000) ** 2, rel=NOISE_REL)


def test_the_display_saturates_and_has_its_gamma() -> None:
    signal = np.array([[-0.1, 0.0, 0.1, 0.5, 1.0, 7.0]], np.float32)
    expected = np.rint(255 * np.array([0, 0, 0.1, 0.5, 1, 1]) ** (1 / 1.8))
    np.testing.assert_allclose(displayed(signal)[0], expected, atol=1)


def test_compression_keeps_colours_apart_and_costs_what_its_quality_says() -> None:
    rows, columns = np.mgrid[:64, :64]
    frame = np.stack([200 + 0 * rows, 2 * rows, 2 * columns], axis=-1).astype(np.uint8)
    rough, fine = (compressed(sample_of(jpeg_quality=q).endoscope, frame).astype(int) for q in (10.0, 100.0))
    assert np.abs(fine - frame).max() <= 5
    assert np.abs(rough - frame).mean() > 2 * np.abs(fine - frame).mean()
    grey = compressed(sample_of(jpeg_quality=100.0).endoscope, frame[..., 0])
    assert np.abs(grey.astype(int) - frame[..., 0]).max() <= 2


@pytest.mark.parametrize("colour", [False, True])
def test_a_frame_and_its_twin_without_noise(colour: bool) -> None:
    sample = sample_of(colour=colour, full_well=1e5, read_noise=0.0, jpeg_quality=100.0)
    wall = wall_of()
    lighting = lighting_of(sample, wall)
    frame, twin = (one(sample, wall, lighting, 3) for one in (render_frame, noise_free))
    assert frame.shape == twin.shape == ((240, 320, 3) if colour else (240, 320))
    assert frame.dtype == twin.dtype == np.uint8
    np.testing.assert_array_equal(frame, render_frame(sample, wall, lighting, 3))
    assert (frame != render_frame(sample, wall, lighting, 4)).any(), "every frame has noise of its own"
    seen = pixel_maps(sample, wall, 3)
    # even at its best, JPEG halves the resolution of colour
    assert np.abs(frame[seen.valid].astype(int) - twin[seen.valid]).mean() < 2
    # the annulus stands out of its surround
    assert np.median(twin[seen.valid]) > 2 * np.median(twin[~seen.valid])


def test_the_rim_out_of_focus_is_blurred_more() -> None:
    sample = sample_of(defocus_px=0.6, defocus_slope_px=3.0, focus_at_outer=True)
    lighting = lighting_of(sample, wall_of())
    image = noise_free(sample, wall_of(), lighting, 0).astype(float)
    row = image[round(CENTRE[1])]
    # width over which the profile rises, by the steepest slope over the step
    inner, outer = (row[round(CENTRE[0] + r) - 12 : round(CENTRE[0] + r) + 13] for r in (INNER_PX, OUTER_PX))
    sharpness = [np.abs(np.diff(edge)).max() / np.ptp(edge) for edge in (inner, outer)]
    assert sharpness[1] > 2 * sharpness[0]
    swapped = sample_of(defocus_px=0.6, defocus_slope_px=3.0, focus_at_outer=False)
    assert np.abs(noise_free(swapped, wall_of(), lighting, 0).astype(float) - image).max() > 20


@pytest.mark.parametrize(("bone", "lined"), [("phantom", False), ("tube", False), ("network", True)])
def test_only_cells_of_bone_have_a_lining(bone: str, lined: bool) -> None:
    """Deep places are redder where they are lined: green comes back as 0.70 of red, and as 0.88 where they are not."""
    sample = sample_of(colour=True, gloss=0.0, ring_gain=0.0, fluid_gloss=0.0, droplets=(), dirt=(), debris=())
    sample = sample.model_copy(update={"bore": sample.bore.model_copy(update={"bone": bone})})
    _, light_of = seen_light(sample, wall_of(0.3))
    assert np.median(light_of[:, 1] / light_of[:, 0]) == pytest.approx(0.70 if lined else 0.88, abs=0.001)
