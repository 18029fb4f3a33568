"""What is painted on a wall is what the samples say: by the brush's radius in mm, on the circle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.page.painting import Shape, painted, shapes_from

GRID = SurfaceGrid.full_circle(60, 200, z0_mm=0.5, dz_mm=0.05, radius_mm=1.25)
UNEVEN = GRID.with_rows(0.5 + 0.05 * np.arange(60) + 0.02 * np.sin(np.arange(60)))


def brush(*points: tuple[float, float], radius_mm: float = 0.3, adds: bool = True) -> Shape:
    return Shape(np.array(points), adds, radius_mm)


@pytest.mark.parametrize("grid", [GRID, UNEVEN])
def test_a_dot_holds_the_samples_within_its_radius(grid: SurfaceGrid):
    mask = painted([brush((1.0, 2.0))], grid)
    apart = np.hypot((grid.theta_rad - 1.0) * 1.25, grid.z_mm[:, None] - 2.0)
    assert (mask == (apart <= 0.3)).all()
    assert mask.any()


@given(st.floats(-6.0, 6.0), st.floats(0.6, 3.3), st.floats(0.05, 0.6), st.integers(-2, 2))
def test_a_stroke_does_not_know_where_the_seam_is(theta_rad: float, z_mm: float, length_rad: float, turns: int):
    around = 2 * np.pi
    stroke = [(theta_rad, z_mm), (theta_rad + length_rad, z_mm + 0.1)]
    mask = painted([brush(*stroke)], GRID)
    elsewhere = painted([brush(*[(theta + turns * around, z) for theta, z in stroke])], GRID)
    assert abs(int(mask.sum()) - int(elsewhere.sum())) <= 2  # of samples just at the radius
    assert (mask != elsewhere).sum() <= 2
    step = 37
    moved = painted([brush(*[(theta + step * GRID.dtheta_rad, z) for theta, z in stroke])], GRID)
    assert (np.roll(mask, step, axis=1) != moved).sum() <= 4


def test_a_stroke_covers_what_lies_along_it():
    mask = painted([brush((6.0, 1.0), (7.0, 1.0), (7.0, 2.0))], GRID)  # over the seam
    for theta_rad, z_mm in ((6.2, 1.0), (0.05, 1.1), (7.0 - 2 * np.pi, 1.8)):
        assert mask[np.argmin(abs(GRID.z_mm - z_mm)), round(float(GRID.column_of(theta_rad))) % 200]
    assert not mask[:, 100].any()
    area_mm2 = mask.sum() * GRID.dz_mm * GRID.dtheta_mm
    assert area_mm2 == pytest.approx(2 * 0.3 * (1.25 + 1.0) + np.pi * 0.3**2, rel=0.08)


def test_a_polygon_is_filled_over_the_seam():
    corners = [(-0.4, 1.0), (0.4, 1.0), (0.4, 2.0), (-0.4, 2.0)]
    mask = painted([Shape(np.array(corners), True, None)], GRID)
    assert mask[20, 0]
    assert mask[20, -5]
    assert not mask[20, 100]
    assert mask.sum() * GRID.dz_mm * GRID.dtheta_mm == pytest.approx(0.8 * 1.25, rel=0.1)


def test_later_shapes_lie_over_earlier_ones_and_over_the_ground():
    ground = np.zeros(GRID.shape, np.bool_)
    ground[10:50, 50:150] = True
    erased = painted([brush((np.pi, 2.0), radius_mm=0.5, adds=False)], GRID, ground)
    assert not erased[30, 100]
    assert erased[12, 60]
    again = painted([brush((np.pi, 2.0), radius_mm=0.5, adds=False), brush((np.pi, 2.0), radius_mm=0.1)], GRID, ground)
    assert again[30, 100]
    assert ground[30, 100]  # which is not changed


def test_what_lies_beyond_the_ends_paints_nothing():
    assert not painted([brush((1.0, -5.0)), brush((1.0, 99.0))], GRID).any()
    assert painted([brush((1.0, 0.4))], GRID).any()


def stroke(points: object, radius_mm: object = 1.0, adds: object = True) -> list[object]:
    return [{"points": points, "radius_mm": radius_mm, "adds": adds}]


@pytest.mark.parametrize(
    "posted",
    [
        None,
        {},
        [1],
        [{"adds": True}],
        stroke([[0, 1]], adds=1),
        stroke([[0, 1]], radius_mm=None),
        stroke([[0, 1]], radius_mm=-1),
        stroke([[0, 1]], radius_mm=float("nan")),
        stroke([]),
        stroke([[0, float("inf")]]),
        stroke([[1e9, 1]]),
        stroke([[True, 1]]),
        stroke([[0, 1, 2]]),
        stroke([[0, 1]] * 20_001),
        stroke([[0, 1]]) * 5001,
    ],
)
def test_what_is_no_drawing_is_refused(posted: object):
    with pytest.raises(EndoctError):
        shapes_from(posted)
