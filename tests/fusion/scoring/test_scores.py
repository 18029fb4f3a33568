"""The scores of two masks: by hand, and as SciPy and scikit-image have them."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import dice, jaccard
from skimage.measure import label

from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.geometry.placement import IN_PLACE, Sampling
from endoct.fusion.result import PairScores
from endoct.fusion.scoring.cells import measure
from endoct.fusion.scoring.overlap import Surface
from endoct.fusion.scoring.scores import pair_scores, score_sides
from endoct.stitching.grid import SurfaceGrid

GRID = SurfaceGrid.full_circle(300, 256, z0_mm=0.0, dz_mm=0.03, radius_mm=1.25)
SEEN = np.ones(GRID.shape, np.bool_)


def wall(discs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return discs (z mm, θ rad, radius mm) on the wall."""
    mask = np.zeros(GRID.shape, np.bool_)
    for z, theta, radius in discs:
        mask |= np.hypot(GRID.z_mm[:, None] - z, 1.25 * wrap_rad(GRID.theta_rad - theta)[None]) < radius
    return mask


LATTICE = np.array([[z, theta, 0.15 + 0.05 * k] for k, z in enumerate((1, 2.5, 4, 5.5, 7)) for theta in (0.1, 2, 4)])


def card(a: NDArray[np.bool_], b: NDArray[np.bool_], seen_by_b: NDArray[np.bool_] = SEEN, **of_b: Any) -> PairScores:
    one, two = Surface("a", a, SEEN), Surface("b", b & seen_by_b, seen_by_b, **of_b)
    return pair_scores(one, two, measure(one, two, GRID, aligned=True), GRID, 0.1)


def test_two_alike() -> None:
    found = card(wall(LATTICE), wall(LATTICE))
    assert found.grid.jaccard == 1
    assert found.grid.jaccard_interval == (1, 1)
    assert (found.boundary.mean_mm, found.boundary.within_share) == (0, 1)
    cells = found.cells
    assert (cells.precision, cells.recall, cells.quality, cells.matched) == (1, 1, 1, 15)
    assert found.area_mm2.bias == 0
    assert found.drift.z_mm.per_mm == 0


def test_overlap_as_scipy_has_it() -> None:
    rng = np.random.default_rng(0)
    a = wall(LATTICE)
    b = wall(LATTICE + rng.normal(0, 0.05, LATTICE.shape))
    seen = rng.random(GRID.shape) < 0.8
    found = card(a, b, seen).grid
    assert found.jaccard == pytest.approx(1 - jaccard(a[seen], b[seen]))
    assert found.dice == pytest.approx(1 - dice(a[seen], b[seen]))
    sample_mm2 = GRID.dz_mm * GRID.dtheta_mm
    areas = (a & b, a & ~b, ~a & b, ~a & ~b)
    said = (found.both_mm2, found.only_a_mm2, found.only_b_mm2, found.neither_mm2)
    assert said == pytest.approx([(part & seen).sum() * sample_mm2 for part in areas])
    assert found.sites == label((np.roll(a | b, 40, axis=1) & np.roll(seen, 40, axis=1)), connectivity=2).max()


def test_cells_by_hand() -> None:
    # B misses three cells, adds one, joins nothing; of those matched each overlaps with itself
    extra = np.array([[8.2, 3.0, 0.3]])
    found = card(wall(LATTICE), wall(np.r_[LATTICE[3:], extra])).cells
    assert (found.of_reference, found.of_other, found.matched) == (15, 13, 12)
    assert found.recall == pytest.approx(12 / 15)
    assert found.precision == pytest.approx(12 / 13)
    assert found.quality == pytest.approx(12 / (12 + 3 / 2 + 1 / 2))
    low, high = found.recall_interval
    assert low < 12 / 15 < high


def test_quality_is_the_panoptic_quality_of_labels() -> None:
    rng = np.random.default_rng(1)
    a, b = wall(LATTICE), wall(LATTICE + rng.normal(0, 0.12, LATTICE.shape))
    found = card(a, b).cells
    # labels of the plain image, the seam turned to where no cell lies
    turned = [label(np.roll(mask, 40, axis=1), connectivity=2) for mask in (a, b)]
    overlaps = []
    for k in range(1, turned[0].max() + 1):
        for other in np.unique(turned[1][turned[0] == k]):
            if other:
                one, two = turned[0] == k, turned[1] == other
                overlaps.append((one & two).sum() / (one | two).sum())
    matched = [overlap for overlap in overlaps if overlap > 0.5]
    total = turned[0].max() + turned[1].max()
    assert 0 < len(matched) < 15
    assert found.quality == pytest.approx(2 * sum(matched) / total)


def test_cells_the_other_did_not_observe_count_for_nothing() -> None:
    half = SEEN.copy()
    half[160:] = False
    found = card(wall(LATTICE), wall(LATTICE), half).cells
    assert found.of_reference == found.matched == 9
    assert found.recall == 1


def test_kinds_of_cells_are_all_of_them() -> None:
    a, b = wall(LATTICE), wall(LATTICE[3:])
    relief = np.where(a, 0.05 + 0.1 * (GRID.z_mm[:, None] > 4.7), 0).astype(np.float32)
    found = card(a, b, relief_mm=relief)
    for rows in found.strata.by_kind().values():
        assert sum(row.sites for row in rows) == found.grid.sites == 15
        area = sum(row.area_mm2 for row in rows)
        assert sum(row.area_mm2 * (row.jaccard or 0) for row in rows) / area == pytest.approx(found.grid.jaccard)
    shallow, deep, deepest = found.strata.depth_mm
    assert (shallow.sites, deep.sites, deepest.sites) == (9, 6, 0)
    assert deepest.jaccard is None
    assert shallow.only_first == pytest.approx(3 / 9)
    assert deep.only_first == 0


def test_drift_is_the_slope_that_was_put_in() -> None:
    scaled = LATTICE * [1.02, 1, 1] + [-0.08, 0.02, 0]
    found = card(wall(LATTICE), wall(scaled)).drift
    assert found.pairs == 15
    assert found.z_mm.per_mm == pytest.approx(0.02, abs=0.002)
    assert found.arc_mm.mean == pytest.approx(0.02 * 1.25, abs=0.003)
    assert abs(found.arc_mm.per_mm) < 0.002


def test_nothing_to_score() -> None:
    found = card(~SEEN, ~SEEN)
    assert found.grid.jaccard is found.boundary is found.cells is found.area_mm2 is found.drift is None
    one_sided = card(wall(LATTICE), ~SEEN)
    assert one_sided.grid.jaccard == 0
    assert one_sided.cells.precision is None
    assert one_sided.cells.recall == 0


def test_sides_that_are_not_aligned_have_cells_but_no_scores() -> None:
    rng = np.random.default_rng(6)
    surfaces = [Surface(name, wall(LATTICE + rng.normal(0, 0.05, LATTICE.shape)), SEEN) for name in "ab"]
    samplings = Sampling(GRID, IN_PLACE), Sampling(GRID, IN_PLACE)
    scored = score_sides((surfaces[0], surfaces[1]), GRID, samplings, 0.1)
    assert scored.scores == pair_scores(*surfaces, scored.cells, GRID, 0.1)
    assert scored.budget is not None
    assert scored.budget.one_minus_jaccard == pytest.approx(1 - scored.scores.grid.jaccard)
    assert {cell.seen_by for cell in scored.cells} == {"both"}
    alone = score_sides((surfaces[0], surfaces[1]), GRID, None, 0.1)
    assert (alone.scores, alone.budget) == (None, None)
    assert {cell.seen_by for cell in alone.cells} == {"a", "b"}
