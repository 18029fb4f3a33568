"""Planes that cut the bore: drawn as dark lines into a grainy wall, found again with their errors, and no cells."""

import math
from dataclasses import replace

import numpy as np
import pytest

from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import Sampling
from endoct.fusion.result import CuttingPlane
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.planes import find_planes, without_planes
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.fusion.sides import place
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

RADIUS_MM, DZ_MM = 1.25, 0.04
GRID = SurfaceGrid.full_circle(150, 180, z0_mm=2.0, dz_mm=DZ_MM, radius_mm=RADIUS_MM, theta0_rad=0.3)
GRAIN = np.random.default_rng(4).normal(0, 0.04, GRID.shape).astype(np.float32)


def plane(z_mm: float, dip_deg: float, azimuth_deg: float) -> CuttingPlane:
    errors = dict.fromkeys(("z_error_mm", "dip_error_rad", "azimuth_error_rad"), 0.0)
    dip, azimuth = math.radians(dip_deg), math.radians(azimuth_deg)
    return CuttingPlane(z_mm=z_mm, dip_rad=dip, azimuth_rad=azimuth, support=1.0, radius_mm=RADIUS_MM, **errors)


def band(of: CuttingPlane, grid: SurfaceGrid = GRID, thick_mm: float = 0.12) -> np.ndarray:
    return np.abs(grid.z_mm[:, None] - of.z_at(grid.theta_rad)) <= thick_mm / 2


def wall(dark: np.ndarray, valid: np.ndarray | None = None, grain: np.ndarray = GRAIN) -> Evidence:
    valid = np.ones(GRID.shape, np.bool_) if valid is None else valid
    values = np.where(valid, grain + 0.6 * dark, 0).astype(np.float32)
    return Evidence(values, valid, GRID.z_mm, DZ_MM, GRID.theta0_rad, RADIUS_MM, "darkness")


STEEP, FLAT, ACROSS = plane(4.2, 55, 340), plane(5.5, 20, 100), plane(6.4, 45, 215)


def test_planes_are_found_with_what_their_errors_say() -> None:
    found = find_planes(wall(band(STEEP) | band(FLAT) | band(ACROSS)))
    assert len(found) == 3
    for drawn, one in zip((STEEP, FLAT, ACROSS), found, strict=True):
        off = one.z_mm - drawn.z_mm, one.dip_rad - drawn.dip_rad, (one.azimuth_rad - drawn.azimuth_rad)
        errors = one.z_error_mm, one.dip_error_rad, one.azimuth_error_rad
        assert np.all(np.abs(off) < 4 * np.array(errors))
        assert np.all(np.array(errors) < (0.01, math.radians(0.6), math.radians(2)))
        assert np.all(np.array(errors) > (0.0002, math.radians(0.005), math.radians(0.01)))
        assert one.support > 0.7  # less where lines cross or the image ends
        assert one.radius_mm == RADIUS_MM


def test_errors_are_those_of_many_walls() -> None:
    """Over 40 grainy walls, estimates spread as their standard errors say."""
    values = []
    for seed in range(40):
        grain = np.random.default_rng(seed).normal(0, 0.15, GRID.shape).astype(np.float32)
        (one,) = find_planes(wall(band(FLAT), grain=grain))
        values.append(
            (one.z_mm, one.dip_rad, one.azimuth_rad, one.z_error_mm, one.dip_error_rad, one.azimuth_error_rad)
        )
    spread, stated = np.std(values, axis=0)[:3], np.median(values, axis=0)[3:]
    assert np.all(stated / spread > 0.6)
    assert np.all(stated / spread < 1.7)


def test_the_seam_is_no_place_of_its_own() -> None:
    here = find_planes(wall(band(STEEP)))
    turned = find_planes(wall(np.roll(band(STEEP), 63, axis=1), grain=np.roll(GRAIN, 63, axis=1)))
    assert len(here) == len(turned) == 1
    assert turned[0].z_mm == pytest.approx(here[0].z_mm, abs=2e-3)
    off = (turned[0].azimuth_rad - here[0].azimuth_rad - 63 * GRID.dtheta_rad + math.pi) % (2 * math.pi) - math.pi
    assert abs(off) < 2e-3


def test_less_than_most_of_a_turn_is_no_plane() -> None:
    around = np.arange(GRID.n_theta)
    for share, there in ((0.4, 0), (0.6, 1)):
        assert len(find_planes(wall(band(FLAT) & (around < share * GRID.n_theta)))) == there
    unseen = np.broadcast_to(around >= 0.4 * GRID.n_theta, GRID.shape)
    assert len(find_planes(wall(band(FLAT), valid=unseen))) == 1
    assert len(find_planes(wall(band(FLAT), valid=~unseen))) == 0


def test_what_is_no_thin_dark_line_is_no_plane() -> None:
    rng = np.random.default_rng(1)
    assert find_planes(wall(np.zeros(GRID.shape))) == ()
    assert find_planes(wall(-1.0 * band(FLAT))) == ()  # bright
    assert find_planes(wall(0.12 * band(FLAT))) == ()  # faint: 0.07, in a grain of 0.04
    assert find_planes(wall(band(FLAT, thick_mm=0.9))) == ()
    assert find_planes(wall(band(STEEP)[:, rng.permutation(GRID.n_theta)])) == ()
    one_row = np.zeros(GRID.shape, np.bool_)
    one_row[60] = True
    assert len(find_planes(wall(one_row))) == 1
    far = 0.26 * RADIUS_MM
    assert find_planes(replace(wall(one_row), z_mm=far * np.arange(GRID.n_z), dz_mm=far)) == ()
    smooth = 0.02 * GRAIN
    assert len(find_planes(wall(0.3 * band(FLAT), grain=smooth))) == 1
    assert find_planes(wall(0.13 * band(FLAT), grain=smooth)) == ()  # 0.08
    dotted = band(FLAT) & (np.arange(GRID.n_theta) % 3 == 0)
    assert find_planes(replace(wall(dotted), theta0_rad=0.0)) == ()


def test_what_ends_with_the_image_or_beside_what_was_not_seen_is_no_line() -> None:
    dark, valid = np.zeros(GRID.shape, np.bool_), np.ones(GRID.shape, np.bool_)
    dark[:2] = dark[-2:] = True
    assert find_planes(wall(dark)) == ()
    dark[60:63], valid[50:60], valid[63:73] = True, False, False
    assert find_planes(wall(dark, valid)) == ()


def test_planes_that_cut_the_axis_at_one_place_are_all_found() -> None:
    found = find_planes(wall(band(STEEP) | band(plane(4.2, 55, 160))))
    assert sorted(round(math.degrees(one.azimuth_rad)) for one in found) == [160, 340]


def test_a_side_knows_its_planes_and_their_lines_are_no_cells() -> None:
    """A hole of 96 mm; its planes lie in its own mm, and on a grid where the side is placed."""
    scale = 48 / RADIUS_MM
    grid = replace(GRID, z0_mm=scale * GRID.z0_mm, dz_mm=scale * DZ_MM, radius_mm=48.0)
    pit = np.zeros(GRID.shape, np.bool_)
    pit[100:115, 40:60] = True
    light = (100 * np.exp(-GRAIN - 1.2 * (band(STEEP) | pit))).astype(np.float32)
    seen = np.ones(GRID.shape, np.bool_)
    side = Side("image", Panorama(grid, light, None, seen, seen.astype(np.float32), "image", True, True))
    cells = segment_side(side, SegmentParameters(), "dark")
    (found,) = cells.planes
    assert found.radius_mm == 48
    assert found.z_mm == pytest.approx(scale * STEEP.z_mm, abs=scale * 0.02)
    assert cells.mask[pit].mean() > 0.8
    assert cells.mask[band(STEEP)].mean() < 0.05
    assert "without planes that cut the bore" in cells.of
    plain = segment_side(side, SegmentParameters(outlines=False), "dark")
    assert plain.planes == ()
    assert plain.mask[band(STEEP)].mean() > 0.5
    where = Alignment(0.5, 10.0)
    (placed,) = place(side, cells, Sampling(grid, where), grid).planes
    assert placed == found.moved(where)
    assert placed.z_mm == pytest.approx(found.z_mm + 10)


def test_a_line_in_a_plane_is_no_cell_and_a_cavity_is_one() -> None:
    cavity = np.zeros(GRID.shape, np.bool_)
    cavity[15:40, 80:100] = True
    beside = np.zeros(GRID.shape, np.bool_)
    beside[120:124, 10:14] = True
    line = band(STEEP)
    assert line[cavity].any()
    left = without_planes(line | cavity | beside, (STEEP,), GRID)
    assert left[cavity].all()
    assert left[beside].all()
    assert not (left & line & ~np.roll(cavity, 3, 0) & ~np.roll(cavity, -3, 0) & ~cavity).any()
    apart = np.roll(line, 12, axis=0)  # 0.48 mm beside the plane
    assert np.array_equal(without_planes(apart, (STEEP,), GRID), apart)
    edge = np.zeros(GRID.shape, np.bool_)
    edge[:4] = True  # the end of z may cut a thick cell
    assert np.array_equal(without_planes(edge, (plane(2.05, 0, 0),), GRID), edge)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("z_reversed", [False, True])
def test_a_plane_of_b_lies_in_as_frame(mirrored: bool, z_reversed: bool) -> None:
    where = Alignment(0.7, 3.0, z_scale=1.5, mirrored=mirrored, z_reversed=z_reversed)
    of_b = plane(4.0, 40, 75).model_copy(update={"z_error_mm": 0.1, "dip_error_rad": 0.01})
    of_a, theta = of_b.moved(where), np.linspace(0, 6, 9)
    assert np.allclose(of_a.z_at(where.theta_to_a(theta)), where.z_to_a(of_b.z_at(theta)))
    assert of_a.z_error_mm == pytest.approx(0.15)
    steeper = plane(4.0, 40 + math.degrees(1e-6), 75).moved(where)
    assert of_a.dip_error_rad == pytest.approx(0.01 * (steeper.dip_rad - of_a.dip_rad) / 1e-6, rel=1e-3)


def test_lengths_of_a_plane_are_scaled() -> None:
    wide = plane(4.0, 40, 75).model_copy(update={"z_error_mm": 0.1}).scaled(40)
    assert (wide.z_mm, wide.z_error_mm, wide.radius_mm) == pytest.approx((160, 4, 50))
    assert wide.dip_rad == pytest.approx(math.radians(40))
