"""Two reliefs of one wall: bias, spread and limits by depth, where both know it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tolerances import RELIEF_BIAS_MM

from endoct.fusion.scoring.overlap import Surface
from endoct.fusion.scoring.scores import RIM_MM, compare_reliefs
from endoct.stitching.grid import SurfaceGrid

GRID = SurfaceGrid.full_circle(150, 400, z0_mm=0.0, dz_mm=0.02, radius_mm=1.25)
SEEN = np.ones(GRID.shape, np.bool_)
BIAS_MM, SPREAD_MM, FLOOR_MM = 0.03, 0.02, 0.5


def walls(cells: NDArray[np.bool_], valid: NDArray[np.bool_] = SEEN, roll: int = 0) -> tuple[Surface, Surface]:
    """Return a side with depth and one that is off by BIAS_MM with noise, and says so; both turned by ``roll``."""
    rng = np.random.default_rng(5)
    true = np.where(cells, FLOOR_MM, 0.0).astype(np.float32)
    noisy = (true + BIAS_MM + rng.normal(0, SPREAD_MM, GRID.shape)).astype(np.float32)
    noisy[:20] = np.nan
    images = (np.roll(image, roll, axis=1) for image in (cells, valid, true, noisy))
    mask, seen, exact, other = images
    error = np.full(GRID.shape, np.hypot(BIAS_MM, SPREAD_MM), np.float32)
    return Surface("oct", mask, seen, exact), Surface("endoscope", mask, seen, other, relief_error_mm=error)


def cell_on_seam() -> NDArray[np.bool_]:
    z, arc = GRID.z_mm[:, None], GRID.radius_mm * ((GRID.theta_rad + np.pi) % (2 * np.pi) - np.pi)
    return np.hypot(z - 1.8, arc) < 0.6


@pytest.mark.parametrize("roll", [0, 133])
def test_bias_and_spread_by_depth_wherever_the_seam_is(roll: int) -> None:
    compared = compare_reliefs(*walls(cell_on_seam(), roll=roll), GRID)
    assert compared is not None
    assert (compared.first, compared.second) == ("oct", "endoscope")
    assert compared.known == pytest.approx(130 / 150)
    wall, *between, floor, beyond = compared.strata
    # of each stratum there is what lies there: π (0.6 − rim)² of floor
    assert floor.area_mm2 == pytest.approx(np.pi * (0.6 - RIM_MM) ** 2, rel=0.03)
    assert (floor.low, floor.to) == (0.3, 0.7)
    assert beyond.median is None
    assert sum(one.area_mm2 for one in between) < 0.01
    for stratum in (wall, floor):
        assert stratum.median == pytest.approx(BIAS_MM, abs=RELIEF_BIAS_MM)
        assert stratum.mean == pytest.approx(BIAS_MM, abs=RELIEF_BIAS_MM)
        assert stratum.spread == pytest.approx(SPREAD_MM, rel=0.05)
        assert stratum.low_limit == pytest.approx(BIAS_MM - 1.96 * SPREAD_MM, abs=0.004)
        assert stratum.high_limit == pytest.approx(BIAS_MM + 1.96 * SPREAD_MM, abs=0.004)
        # |N(bias, spread)| below 2 √(bias² + spread²)
        assert stratum.within_two_errors == pytest.approx(0.982, abs=0.01)


def test_the_errors_of_both_sides_count() -> None:
    error = np.full(GRID.shape, 0.01, np.float32)
    compared = compare_reliefs(*(replace(side, relief_error_mm=error) for side in walls(cell_on_seam())), GRID)
    assert compared is not None
    # |N(0.03, 0.02)| below 2 · 0.01 √2; of one side's error it would be 0.302
    assert compared.strata[0].within_two_errors == pytest.approx(0.464, abs=0.01)


def test_what_a_side_did_not_observe_is_not_compared() -> None:
    half = SEEN.copy()
    half[:, 200:] = False
    compared = compare_reliefs(*walls(cell_on_seam(), half), GRID)
    assert compared is not None
    whole = compare_reliefs(*walls(cell_on_seam()), GRID)
    assert whole is not None
    assert compared.strata[3].area_mm2 == pytest.approx(whole.strata[3].area_mm2 / 2, rel=0.05)


def test_without_depth_on_both_sides_there_is_nothing_to_compare() -> None:
    deep, parallax = walls(cell_on_seam())
    assert compare_reliefs(deep, Surface("mask", deep.mask, SEEN), GRID) is None
    unknown = Surface("endoscope", deep.mask, SEEN, np.full(GRID.shape, np.nan, np.float32))
    nothing = compare_reliefs(deep, unknown, GRID)
    assert nothing is not None
    assert nothing.known == 0
    assert all(one.median is None for one in nothing.strata)
    bare = np.zeros(GRID.shape, np.bool_)
    flat = compare_reliefs(*walls(bare), GRID)
    assert flat is not None
    assert flat.strata[0].median == pytest.approx(BIAS_MM, abs=RELIEF_BIAS_MM)
    assert parallax.relief_error_mm is not None
