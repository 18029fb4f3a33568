"""Rays against surfaces that can be worked out by hand."""

import math

import cv2
import numpy as np
import pytest

from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.cavities import covers, near
from endoct.synthetic.bone.scene import Crossings, build_scene, crossings, joined
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample
from tests.synthetic.bones import bone, hole
from tests.tolerances import SURFACE_MM

RADIUS = 1.25


def radially(sample: Sample, z_mm: Coordinates, theta_rad: Coordinates, tilt_rad: float = 0.0) -> Crossings:
    """Trace rays from the axis at ``theta_rad``, leaning towards +z by ``tilt_rad``, that pass R at ``z_mm``."""
    z, theta = np.broadcast_arrays(np.asarray(z_mm, dtype=np.float64), np.asarray(theta_rad, dtype=np.float64))
    across, along = math.cos(tilt_rad), math.sin(tilt_rad)
    direction = np.stack([across * np.cos(theta), across * np.sin(theta), np.full_like(theta, along)], axis=1)
    origin = np.zeros_like(direction)
    origin[:, 2] = z - RADIUS * math.tan(tilt_rad)
    return crossings(build_scene(sample), origin, direction, np.full(theta.size, 0.5), np.full(theta.size, 4.0))


def test_an_empty_cylinder_is_met_at_its_radius_squarely() -> None:
    theta = np.linspace(0, 6, 50)
    found = radially(bone(), np.full(50, 3.0), theta)
    np.testing.assert_allclose(found.entry_mm, RADIUS, atol=SURFACE_MM)
    np.testing.assert_allclose(found.normal, -np.stack([np.cos(theta), np.sin(theta), 0 * theta], 1), atol=1e-3)
    assert not found.cell.any()
    assert np.isnan(found.exit_mm).all()
    assert np.isnan(found.fluid_mm).all()


def test_rays_beyond_reach_meet_nothing() -> None:
    scene = build_scene(bone())
    found = crossings(scene, np.zeros((1, 3)), np.array([[1.0, 0, 0]]), np.zeros(1), np.full(1, 1.2))
    assert np.isnan(found.entry_mm[0])
    assert np.isnan(found.normal[0]).all()


def test_a_straight_hole_is_met_at_its_floor() -> None:
    found = radially(bone(hole()), np.array([3.0, 3.1, 2.0]), np.full(3, 1.0))
    floor = RADIUS + 0.6 * (1 - (0.1 / 0.3) ** 12) ** (1 / 12)
    np.testing.assert_allclose(found.entry_mm, [RADIUS + 0.6, floor, RADIUS], atol=SURFACE_MM)
    np.testing.assert_array_equal(found.cell, [1, 1, 0])


def test_a_leaning_hole_is_met_along_its_axis() -> None:
    lean = 0.4
    leaning = hole(lean_rad=lean, squareness=2.0)
    found = radially(bone(leaning), np.array([3.0]), np.array([1.0]), tilt_rad=lean)
    np.testing.assert_allclose(found.entry_mm, RADIUS / math.cos(lean) + 0.6, atol=SURFACE_MM)
    # an ellipsoid of semi-axes 0.3 and 0.6 about the place on the wall, met by the radial ray through it
    across, along = math.sin(lean) / 0.3, math.cos(lean) / 0.6
    straight = radially(bone(leaning), np.array([3.0]), np.array([1.0]))
    np.testing.assert_allclose(straight.entry_mm, RADIUS + 1 / math.hypot(across, along), atol=SURFACE_MM)


def test_an_oblique_ray_finds_the_undercut_beneath_a_lip() -> None:
    ball = hole(squareness=2.0, diameter_mm=0.8, depth_mm=0.7, bulge_mm=0.3)
    tilt = 0.5
    found = radially(bone(ball), np.array([3.2]), np.array([1.0]), tilt_rad=tilt)
    # a ball of radius 0.4 about (z, r) = (3, 1.55), met on its far side by the ray through (3.2, 1.25)
    along, away = np.array([math.sin(tilt), math.cos(tilt)]), np.array([0.2, -0.3])
    reach = -along @ away + math.sqrt((along @ away) ** 2 - away @ away + 0.4**2)
    np.testing.assert_allclose(found.entry_mm, RADIUS / math.cos(tilt) + reach, atol=SURFACE_MM)
    # bone lies above it: the radial ray through that place meets the bore's own wall
    z_hit = 3.2 + reach * along[0]
    assert radially(bone(ball), np.array([z_hit]), np.array([1.0])).entry_mm[0] == pytest.approx(RADIUS, abs=SURFACE_MM)


def test_a_septum_is_left_and_bone_met_again() -> None:
    # two balls of radius 0.2 behind one another, 0.05 mm apart; the first opens onto the wall
    first = hole(squareness=2.0, diameter_mm=0.4, depth_mm=0.3, bulge_mm=0.1)
    second = hole(squareness=2.0, diameter_mm=0.4, depth_mm=0.75, bulge_mm=0.55)
    found = radially(bone(first, second), np.array([3.0, 3.1]), np.full(2, 1.0))
    half = math.sqrt(0.2**2 - np.array([0.0, 0.1])[1] ** 2)
    np.testing.assert_allclose(found.entry_mm, RADIUS + 0.1 + np.array([0.2, half]), atol=SURFACE_MM)
    np.testing.assert_allclose(found.exit_mm, RADIUS + 0.55 - np.array([0.2, half]), atol=SURFACE_MM)
    np.testing.assert_allclose(found.reentry_mm, RADIUS + 0.55 + np.array([0.2, half]), atol=SURFACE_MM)
    np.testing.assert_array_equal(found.cell, [1, 1])


def test_dust_ends_a_hole_and_fluid_is_entered_before_its_floor() -> None:
    dusty = radially(bone(hole(filling="dust", fill_mm=0.25)), np.array([3.0]), np.array([1.0]))
    assert dusty.entry_mm[0] == pytest.approx(RADIUS + 0.25, abs=0.005)
    assert dusty.dust[0]
    wet = radially(bone(hole(filling="fluid", fill_mm=0.25)), np.array([3.0, 2.0]), np.full(2, 1.0))
    np.testing.assert_allclose(wet.entry_mm, [RADIUS + 0.6, RADIUS], atol=SURFACE_MM)
    np.testing.assert_allclose(wet.fluid_mm, [RADIUS + 0.25, np.nan], atol=SURFACE_MM)
    assert not wet.dust.any()


def test_joining_only_adds_air_and_at_most_a_quarter_of_the_edge() -> None:
    rng = np.random.default_rng(1)
    bore, cells, edge = rng.normal(size=500), rng.normal(size=(500, 3)), rng.uniform(0.005, 0.15, (500, 3))
    cells[:200] = bore[:200, None] + rng.uniform(-0.2, 0.2, (200, 3))
    got = joined(bore, cells, edge)
    added = got - np.maximum(bore, cells.max(axis=1))
    assert added.min() >= 0
    assert np.all(added <= edge.max(axis=1) / 4 + 1e-12)
    assert added.max() > 0.01


@pytest.mark.parametrize("kind", ["phantom", "mastoid"])
def test_no_surface_is_stepped_over(kind: str) -> None:
    """Along oblique rays, no place sampled every 10 µm before the entry is outside both bore and cavities."""
    sample = draw("learning", 3, ranges={"bore.bone": (kind,), "bore.dust": (0.0, 0.0), "bore.lining": (0.0, 0.0)})
    scene, n = build_scene(sample), 200
    rng = np.random.default_rng(0)
    theta, tilt = rng.uniform(0, 2 * np.pi, n), rng.uniform(-0.3, 0.3, n)
    direction = np.stack([np.cos(tilt) * np.cos(theta), np.cos(tilt) * np.sin(theta), np.sin(tilt)], axis=1)
    origin = np.stack([np.full(n, 0.2), np.zeros(n), rng.uniform(1, sample.bore.length_mm - 1, n)], axis=1)
    found = crossings(scene, origin, direction, np.full(n, 0.5), np.full(n, 4.0))
    assert np.isfinite(found.entry_mm).all()
    steps = np.arange(0.5, 3.2, 0.01)
    places = (origin[:, None] + steps[None, :, None] * direction[:, None]).reshape(-1, 3)
    before = (steps[None] < found.entry_mm[:, None] - 0.005).ravel()
    outside = np.hypot(places[:, 0], places[:, 1]) > RADIUS + float(scene.relief.displacement_mm.max()) + 0.02
    places = places[before & outside]
    air = np.zeros(len(places), np.bool_)
    for number in range(len(sample.bore.cells)):
        alone = np.full((len(places), 1), number)
        here = near(scene.cells, alone, places, np.ones_like(places), np.float64)
        air |= covers(scene.cells.inverse, here, np.zeros(len(places)))[:, 0]
    assert len(air) > 200
    assert air.all()


def test_the_number_of_threads_changes_nothing() -> None:
    sample = draw("learning", 2)
    theta = np.linspace(0, 2 * np.pi, 700, endpoint=False)
    before = cv2.getNumThreads()
    found = []
    try:
        for threads in (1, 2):
            cv2.setNumThreads(threads)
            found.append(radially(sample, np.full(700, 3.0), theta, 0.1))
            assert cv2.getNumThreads() == threads
    finally:
        cv2.setNumThreads(before)
    for name in vars(found[0]):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(found[1], name), err_msg=name)


def test_where_a_ray_ends_does_not_depend_on_those_traced_with_it() -> None:
    sample = draw("learning", 2)
    theta = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    together = radially(sample, np.full(300, 3.0), theta, 0.1)
    for part in (slice(0, 1), slice(7, 20), slice(40, 140)):
        alone = radially(sample, np.full(theta[part].size, 3.0), theta[part], 0.1)
        for name, values in vars(alone).items():
            np.testing.assert_array_equal(values, getattr(together, name)[part], err_msg=name)
