"""The baked maps against traced rays, and against cells taken one by one."""

from dataclasses import fields
from functools import partial

import numpy as np
import pytest

from endoct.synthetic.bone.baked_maps import Traced, part_of_wall
from endoct.synthetic.bone.cavities import cavities, clearance, covers, near
from endoct.synthetic.bone.scene import crossings
from endoct.synthetic.bone.wall import Wall, WallMaps, build_wall
from endoct.synthetic.draw import draw
from tests.synthetic.bones import bone, hole
from tests.synthetic.fingerprints import KINDS, changed
from tests.tolerances import BAKED_MM


@pytest.fixture(scope="module", params=["phantom", "mastoid"])
def wall(request: pytest.FixtureRequest) -> Wall:
    ranges = {"bore.bone": (request.param,), "bore.dust": (0.1, 0.1), "bore.fluid": (0.1, 0.1)}
    return build_wall(draw("learning", 4, ranges=ranges))


def radial_rays(wall: Wall, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    theta = columns * wall.dtheta_rad
    origin = np.stack([0 * theta, 0 * theta, rows * wall.dz_mm], axis=1)
    return origin, np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_makes_the_wall_that_was_published(kind: str) -> None:
    assert changed("wall", kind) == []


def test_relief_fluid_and_ids_are_those_of_traced_rays(wall: Wall) -> None:
    rng = np.random.default_rng(0)
    rows, columns = (rng.integers(0, size, 700) for size in wall.relief_mm.shape)
    origin, direction = radial_rays(wall, rows, columns)
    found = crossings(wall.scene, origin, direction, np.full(700, 0.5), np.full(700, 4.0))
    off = np.abs(found.entry_mm - wall.radius_mm - wall.relief_mm[rows, columns])
    assert np.mean(off > BAKED_MM) < 0.003  # rays that graze a lip
    np.testing.assert_array_equal(np.isfinite(found.fluid_mm), wall.wet[rows, columns] > 0)
    deep = wall.cell[rows, columns] & (found.cell > 0)
    assert np.mean(found.cell[deep] != wall.cell_id[rows, columns][deep]) < 0.05  # a ray may run on into a neighbour


@pytest.mark.parametrize("parts", [1, 3])
def test_parts_traced_elsewhere_change_nothing(parts: int) -> None:
    sample = bone(hole(), hole(z_mm=3.4, lean_rad=0.3), hole(theta_rad=4.0, filling="fluid", fill_mm=0.2))
    asked: list[int] = []

    def elsewhere(part: int) -> list[Traced]:
        asked.append(part)
        return part_of_wall(sample, part, parts)

    alone, shared = build_wall(sample), build_wall(sample, 1, [partial(elsewhere, part) for part in range(parts)])
    assert asked == list(range(parts))
    for field in fields(WallMaps):
        np.testing.assert_array_equal(getattr(alone, field.name), getattr(shared, field.name))
    assert np.count_nonzero(np.unique(shared.cell_id)) == 3


def test_ids_are_those_of_the_deepest_cavity_that_is_open() -> None:
    sample = draw("learning", 4, ranges={"bore.bone": ("phantom",), "bore.cell_fraction": (0.25, 0.25)})
    wall = build_wall(sample)
    rng = np.random.default_rng(1)
    rows, columns = (rng.integers(0, size, 700) for size in wall.relief_mm.shape)
    origin, direction = radial_rays(wall, rows, columns)
    deepest, expected = np.zeros(700), np.zeros(700, np.int32)
    all_ = cavities(sample.bore.cells, wall.radius_mm)
    for number, cell in enumerate(sample.bore.cells):
        rays = near(all_, np.full((700, 1), number), origin, direction, np.float64)
        own_side = np.cos(columns * wall.dtheta_rad - cell.theta_rad) > 0.3
        inside, depth = own_side.copy(), np.zeros(700)
        for t in np.arange(wall.radius_mm, wall.radius_mm + 1.7, 0.02):
            at = np.full(700, t)
            inside &= covers(all_.inverse, rays, at)[:, 0]
            depth[inside] = t
            if not inside.any():
                break
        more = depth > deepest + 0.02
        deepest[more], expected[more] = depth[more], number + 1
    open_ = wall.cell[rows, columns]
    assert open_.sum() > 100
    assert np.mean(wall.cell_id[rows, columns][open_] != expected[open_]) < 0.02  # as deep to within a step


def test_a_shallow_wide_hole_is_open_all_over_its_outline_down_to_its_floor() -> None:
    radius, half, deep = 1.25, 0.64, 0.09
    wall = build_wall(bone(hole(diameter_mm=2 * half, depth_mm=deep)))
    z = wall.dz_mm * np.arange(wall.relief_mm.shape[0])[:, None] - 3.0
    away = wall.dtheta_rad * np.arange(wall.relief_mm.shape[1])[None, :] - 1.0
    across = np.hypot(z, radius * np.sin(away))
    # towards its sides the wall is 0.175 mm off the plane through its middle, twice the hole's depth
    outline = (across < half - 0.005) & (np.cos(away) > 0)
    assert wall.cell[outline].all()
    assert not wall.cell[across > half + 0.005].any()
    floor = radius + 0 * outline
    for _ in range(20):
        s = np.hypot(z, floor * np.sin(away)) / half
        floor = (radius + deep * np.clip(1 - s**12, 0, 1) ** (1 / 12)) / np.cos(away)
    flat = outline & (across < 0.53)
    np.testing.assert_allclose(wall.relief_mm[flat], (floor - radius)[flat], atol=BAKED_MM)


def test_turning_the_cells_rolls_the_maps() -> None:
    cells = hole(lean_rad=0.3, aspect=0.7), hole(theta_rad=2.0, z_mm=3.4, diameter_mm=0.9, squareness=3.0)
    plain = build_wall(bone(*cells))
    columns = 137
    turned = [cell.model_copy(update={"theta_rad": cell.theta_rad + columns * plain.dtheta_rad}) for cell in cells]
    rolled = build_wall(bone(*turned))
    same = np.roll(plain.cell_id, columns, axis=1) == rolled.cell_id
    assert same.mean() > 0.9999
    off = np.abs(np.roll(plain.relief_mm, columns, axis=1) - rolled.relief_mm)[same]
    assert np.mean(off > BAKED_MM) < 1e-4


def test_a_hole_full_of_dust_keeps_its_id_and_is_not_missing() -> None:
    # across a wider one the flat dust would lie behind the curved wall
    brim = build_wall(bone(hole(diameter_mm=0.2, filling="dust", fill_mm=0.0)))
    assert not brim.cell.any()
    node_mm2 = brim.dz_mm * brim.radius_mm * brim.dtheta_rad
    assert np.count_nonzero(brim.cell_id == 1) * node_mm2 == pytest.approx(0.01 * np.pi, rel=0.08)
    half = build_wall(bone(hole(filling="dust", fill_mm=0.3)))
    assert np.count_nonzero(half.cell) * node_mm2 == pytest.approx(0.09 * np.pi, rel=0.03)


def test_a_lining_rounds_the_edge_and_leaves_the_wall_beyond_it() -> None:
    sharp, lined = (build_wall(bone(hole(edge_mm=edge))) for edge in (0.005, 0.15))
    row, column = round(3.0 / sharp.dz_mm), round(1.0 / sharp.dtheta_rad)
    away_mm = (np.arange(sharp.relief_mm.shape[0]) - row) * sharp.dz_mm
    for wall, rounded in ((sharp, 0.005), (lined, 0.15)):
        profile = wall.relief_mm[:, column]
        assert np.abs(profile[np.abs(away_mm) > 0.3 + rounded]).max() < 1e-6
    gained = lined.relief_mm - sharp.relief_mm
    assert gained.min() > -1e-6
    beside = (np.abs(away_mm) > 0.31) & (np.abs(away_mm) < 0.4)
    assert gained[beside, column].max() > 0.01


def test_the_bore_alone_departs_as_its_parameters_say() -> None:
    sample = bone(wander_mm=0.01)
    relief = build_wall(sample).relief_mm
    assert float(relief.std()) == pytest.approx(0.01, rel=0.3)
    assert np.abs(relief[:, 0] - relief[:, -1]).max() < np.abs(np.diff(relief, axis=1)).max() * 1.5


def test_clearance_near_a_floor_is_a_distance() -> None:
    all_ = cavities([hole()], 1.25)
    radii = np.array([1.80, 1.84, 1.86])
    heading = np.tile([np.cos(1.0), np.sin(1.0), 0.0], (3, 1))
    origin = np.tile([0.0, 0.0, 3.0], (3, 1))
    rays = near(all_, np.zeros((3, 1), np.intp), origin, heading, np.float64)
    air = clearance(all_.inverse, rays, radii).air_mm[:, 0]
    np.testing.assert_allclose(air, [0.05, 0.01, -0.01], atol=1e-9)
