"""How the cells of two sides agree as objects: by hand, and against scipy's regression."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import linregress

from endoct.fusion.scoring.cells import Cell, area_limits, cell_scores, depth_limits, drift
from endoct.stitching.grid import SurfaceGrid

GRID = SurfaceGrid.full_circle(100, 256, z0_mm=0.0, dz_mm=0.05, radius_mm=1.25)
CELL = Cell(
    side="a", id=1, area_mm2=0.3, z_mm=1.0, theta_rad=1.0, depth_median_mm=None, depth_p95_mm=None, volume_mm3=None,
    depth_of=None, contrast=None, touches_edge=False, observed_by_other=1.0, covered=1.0, seen_by="both", partner=1,
    overlap=0.8,
)  # fmt: skip


def pairs(n: int, *, z_slope: float = 0.0, turn_slope: float = 0.0, noise_mm: float = 0.02) -> list[Cell]:
    """Return ``n`` matched cells of each side, some over the seam; B's lie apart by noise, and ever farther."""
    rng = np.random.default_rng(n)
    cells = []
    for k in range(n):
        z, theta = 0.7 * k, rng.uniform(-0.05, 0.05) if k % 2 else rng.uniform(1, 5)
        own = replace(
            CELL, id=k + 1, partner=k + 1, z_mm=z, theta_rad=theta % (2 * np.pi), area_mm2=rng.uniform(0.2, 0.6),
            own_depth_mm=rng.uniform(0.1, 0.6),
        )  # fmt: skip
        turned = (theta + 0.02 + turn_slope * z + rng.normal(0, noise_mm) / 1.25) % (2 * np.pi)
        cells += [
            own,
            replace(
                own, side="b", z_mm=z + 0.03 + z_slope * z + rng.normal(0, noise_mm), theta_rad=turned,
                area_mm2=own.area_mm2 + rng.normal(0.05, 0.02),
                own_depth_mm=own.own_depth_mm + rng.normal(-0.1, 0.03),
            ),
        ]  # fmt: skip
    return cells


@pytest.mark.parametrize("n", [6, 15])
def test_cells_drift_apart_as_a_regression_has_it(n: int) -> None:
    cells = pairs(n, z_slope=0.04, turn_slope=-0.03)
    found = drift("a", "b", cells, GRID)
    assert found is not None
    assert (found.pairs, found.length_mm) == (n, pytest.approx(0.7 * (n - 1)))
    a, b = ([cell for cell in cells if cell.side == side] for side in "ab")
    at = np.array([cell.z_mm for cell in a])
    turns = np.array([two.theta_rad - one.theta_rad for one, two in zip(a, b, strict=True)])
    turns = np.angle(np.exp(1j * turns)) * 1.25
    for line, apart in (
        (found.z_mm, [two.z_mm - one.z_mm for one, two in zip(a, b, strict=True)]),
        (found.arc_mm, turns),
    ):
        fit = linregress(at, apart)
        assert line.per_mm == pytest.approx(fit.slope)
        assert line.per_mm_error == pytest.approx(fit.stderr)
        assert line.mean == pytest.approx(np.mean(apart))


def test_few_cells_or_cells_at_one_place_do_not_drift() -> None:
    assert drift("a", "b", pairs(5), GRID) is None
    assert drift("a", "b", [replace(cell, z_mm=1.0) for cell in pairs(8)], GRID) is None
    at_the_end = [replace(cell, touches_edge=cell.id > 5) for cell in pairs(8)]
    assert drift("a", "b", at_the_end, GRID) is None


def test_areas_and_depths_agree_within_limits() -> None:
    cells = pairs(9)
    cells[0] = replace(cells[0], touches_edge=True)  # not seen whole: its pair does not count
    a, b = ([cell for cell in cells if cell.side == side and cell.id > 1] for side in "ab")
    areas = np.array([two.area_mm2 - one.area_mm2 for one, two in zip(a, b, strict=True)])
    found = area_limits("a", "b", cells)
    assert found is not None
    assert (found.pairs, found.bias) == (8, pytest.approx(areas.mean()))
    assert (found.low, found.high) == pytest.approx(areas.mean() + 1.96 * areas.std(ddof=1) * np.array([-1, 1]))
    cells[2] = replace(cells[2], own_depth_mm=None, depth_median_mm=0.3, depth_of="b")  # as deep as B says
    depths = [two.own_depth_mm - one.own_depth_mm for one, two in zip(a, b, strict=True) if one.id != 2]
    found = depth_limits("a", "b", cells)
    assert found is not None
    assert (found.pairs, found.bias) == (7, pytest.approx(np.mean(depths)))
    assert depth_limits("a", "b", cells[:6]) is None


def test_precision_recall_and_quality_by_hand() -> None:
    """Four of A and three of B count. Two pairs match, one overlaps too little; one of A's partners does not count."""
    a = [replace(CELL, id=k, partner=k, overlap=overlap) for k, overlap in ((1, 0.9), (2, 0.6), (3, 0.4), (4, 0.7))]
    b = [replace(cell, side="b") for cell in a]
    b[3] = replace(b[3], observed_by_other=0.4)
    a += [replace(CELL, id=5, partner=None, overlap=0.0, covered=None, observed_by_other=0.1)]
    a[2], b[2] = replace(a[2], covered=0.5), replace(b[2], covered=0.49)
    found = cell_scores("a", "b", [*a, *b])
    assert found is not None
    assert (found.of_reference, found.of_other, found.matched) == (4, 3, 2)
    assert (found.precision, found.recall) == (pytest.approx(2 / 3), pytest.approx(2 / 4))
    assert found.quality == pytest.approx((0.9 + 0.6) / (2 + (2 + 1) / 2))
    assert found.overlap_of_matched == pytest.approx(0.75)
    assert (found.half_covered_of_reference, found.half_covered_of_other) == (1, pytest.approx(2 / 3))
    assert cell_scores("a", "b", []) is None
    alone = cell_scores("a", "b", a[:1])
    assert alone is not None
    assert (alone.recall, alone.precision, alone.overlap_of_matched) == (0, None, None)
