"""The agreement budget: it adds up, and each cause that is put in comes out as that cause."""

import numpy as np
import pytest
from numpy.typing import NDArray
from tolerances import BUDGET, BUDGET_OF_ONE_CAUSE

from endoct.base.numeric.circle import wrap_rad
from endoct.base.numeric.regions import label_in_order
from endoct.fusion.geometry.alignment import Alignment, as_covariance
from endoct.fusion.geometry.placement import IN_PLACE, Placement, Sampling
from endoct.fusion.result import Budget, NotVisible
from endoct.fusion.scoring.budget import PARTS, agreement_budget
from endoct.fusion.scoring.cells import invisible_cells, measure
from endoct.fusion.scoring.overlap import Surface
from endoct.stitching.grid import SurfaceGrid

GRID = SurfaceGrid.full_circle(200, 512, z0_mm=0.0, dz_mm=0.04, radius_mm=1.25)
SEEN = np.ones(GRID.shape, np.bool_)
RNG = np.random.default_rng(5)
DISCS = np.stack([RNG.uniform(0.4, 7.6, 60), RNG.uniform(0, 2 * np.pi, 60), RNG.uniform(0.15, 0.4, 60)], axis=1)


def wall(
    z_mm: NDArray[np.float64], theta_rad: NDArray[np.float64], discs: NDArray[np.float64] = DISCS
) -> NDArray[np.bool_]:
    mask = np.zeros((z_mm.size, theta_rad.size), np.bool_)
    for z, theta, radius in discs:
        mask |= np.hypot(z_mm[:, None] - z, 1.25 * wrap_rad(theta_rad - theta)[None]) < radius
    return mask


WALL = wall(GRID.z_mm, GRID.theta_rad)


def budget(
    a: Surface, b: Surface, grids: tuple[SurfaceGrid, SurfaceGrid] = (GRID, GRID), placing: Alignment = IN_PLACE
) -> tuple[Budget, dict[str, float]]:
    samplings = Sampling(grids[0], IN_PLACE), Sampling(grids[1], placing)
    found = agreement_budget((a, b), samplings, measure(a, b, GRID, aligned=True), GRID)
    assert found is not None
    both = a.valid & b.valid
    j = (a.mask & b.mask & both).sum() / ((a.mask | b.mask) & both).sum()
    assert found.one_minus_jaccard == pytest.approx(1 - j)
    parts = found.parts.by_cause()
    shares = {part: parts[part].share for part in PARTS}
    assert sum(shares.values()) == pytest.approx(1 - j)
    for part in PARTS:
        low, high = parts[part].interval
        assert low <= shares[part] + 1e-9
        assert high >= shares[part] - 1e-9
    return found, shares


def test_two_alike_lose_nothing() -> None:
    _, shares = budget(Surface("a", WALL, SEEN), Surface("b", WALL, SEEN))
    assert shares == pytest.approx(dict.fromkeys(PARTS, 0.0), abs=1e-12)


@pytest.mark.parametrize("moved", ["theta", "z"])
def test_a_misalignment_as_large_as_stated_is_alignment(moved: str) -> None:
    sd_mm = 0.03
    lost, predicted = [], []
    for error_mm in sd_mm * np.array([-1.4, -0.6, 0.2, 1.0]):  # of mean size 0.8 SD, as a normal error has
        turn, shift = (error_mm / 1.25, 0.0) if moved == "theta" else (0.0, error_mm)
        variances = (sd_mm / 1.25) ** 2 * (moved == "theta"), sd_mm**2 * (moved == "z"), 0.0
        placing = Alignment(0.0, 0.0, covariance=as_covariance(np.diag(variances)))
        other = wall(GRID.z_mm - shift, GRID.theta_rad - turn)
        found, shares = budget(Surface("a", WALL, SEEN), Surface("b", other, SEEN), placing=placing)
        lost.append(found.one_minus_jaccard)
        predicted.append(shares["alignment"])
        assert shares["sampling"] == pytest.approx(0, abs=1e-9)
    assert np.mean(predicted) == pytest.approx(np.mean(lost), rel=BUDGET_OF_ONE_CAUSE)


def test_wide_rows_are_sampling() -> None:
    rows = 0.1 + 0.2 * np.arange(39)
    coarse = SurfaceGrid.full_circle(39, 512, z0_mm=0.1, dz_mm=0.2, radius_mm=1.25).with_rows(rows)
    shown = wall(rows, GRID.theta_rad)
    mask, valid = Placement.averaging(coarse, IN_PLACE, GRID).mask(shown, np.ones(shown.shape, np.bool_))
    for a, b, grids in (
        (Surface("a", WALL, SEEN), Surface("b", mask, valid), (GRID, coarse)),
        (Surface("a", mask, valid), Surface("b", WALL, SEEN), (coarse, GRID)),
    ):
        found, shares = budget(a, b, grids)
        assert found.one_minus_jaccard > 0.05
        assert shares["sampling"] == pytest.approx(found.one_minus_jaccard, abs=BUDGET)
        assert shares["visibility"] == 0


def test_cells_of_which_there_is_no_sign_are_visibility_and_others_segmentation() -> None:
    rng = np.random.default_rng(1)
    order = np.argsort(DISCS[:, 0])
    hidden = wall(GRID.z_mm, GRID.theta_rad, DISCS[order[:12]])
    missed = wall(GRID.z_mm, GRID.theta_rad, DISCS[order[-12:]])
    relief = np.where(WALL & ~hidden, 0.1, 0.0) + rng.normal(0, 0.01, GRID.shape)
    # B calls only some of what it has signs of a cell
    b = Surface("b", WALL & ~hidden & ~missed, SEEN, relief.astype(np.float32))
    found, shares = budget(Surface("a", WALL, SEEN), b)
    alone = lambda cells: (cells & ~(b.mask)).sum() / WALL.sum()  # noqa: E731
    assert shares["alignment"] == shares["sampling"] == 0
    assert shares["visibility"] == pytest.approx(alone(hidden), abs=BUDGET)
    assert shares["segmentation"] == pytest.approx(alone(missed), abs=BUDGET)
    assert found.not_visible["b"].area_mm2 == pytest.approx(
        (hidden & ~b.mask).sum() * GRID.dz_mm * GRID.dtheta_mm, rel=0.1
    )
    assert found.not_visible["a"] == NotVisible(cells=0, area_mm2=0)


def test_what_one_side_did_not_cover_stands_beside() -> None:
    half = SEEN.copy()
    half[100:] = False
    found, shares = budget(Surface("a", WALL, SEEN), Surface("b", WALL & half, half))
    assert found.not_covered["b"] == pytest.approx(WALL[100:].sum() * GRID.dz_mm * GRID.dtheta_mm)
    assert found.not_covered["a"] == pytest.approx(0)
    assert shares == pytest.approx(dict.fromkeys(PARTS, 0.0), abs=1e-12)


def test_no_cells_no_budget() -> None:
    nothing = Surface("a", ~SEEN, SEEN)
    samplings = Sampling(GRID, IN_PLACE), Sampling(GRID, IN_PLACE)
    assert agreement_budget((nothing, nothing), samplings, (), GRID) is None


def test_faint_signs_are_told_from_bare_wall_by_size() -> None:
    """Speckle hides a small cell before it hides a large one of the same depth."""
    rng = np.random.default_rng(2)
    discs = np.array([[2.0, 1.0, 0.06], [4.0, 3.0, 0.5], [6.0, 5.0, 0.5]])
    labels = label_in_order(wall(GRID.z_mm, GRID.theta_rad, discs))
    contrast = rng.normal(0, 0.5, GRID.shape) + 0.12 * (labels == 1) + 0.12 * (labels == 2)
    side = Surface("b", ~SEEN, SEEN, contrast=contrast.astype(np.float32))
    hidden = invisible_cells(side, labels, [1, 2, 3], GRID)
    assert 2 not in hidden
    assert 3 in hidden
    assert invisible_cells(side, labels, [1, 2, 3, 9], GRID) == hidden  # a speck that fell between the samples
    drawn = Surface("b", ~SEEN, SEEN)
    assert invisible_cells(drawn, labels, [1, 2, 3], GRID) == []


def test_cells_of_its_own_are_no_bare_wall() -> None:
    """Bare wall is what neither side calls a cell and the side observed, with or without many cells of its own."""
    rng = np.random.default_rng(4)
    own = wall(GRID.z_mm, GRID.theta_rad, DISCS[DISCS[:, 0] < 5])
    others = np.array([[6.0, 0.1, 0.3], [6.0, 3.0, 0.3], [7.2, 4.0, 0.3]])  # the first over the seam
    labels = label_in_order(wall(GRID.z_mm, GRID.theta_rad, others) & ~own)
    seam, bare, unseen = (labels[np.argmin(np.abs(GRID.z_mm - z)), round(t / GRID.dtheta_rad)] for z, t, _ in others)
    assert len({seam, bare, unseen, 0}) == 4
    contrast = rng.normal(0, 0.3, GRID.shape) + 0.9 * own + 0.3 * (labels == seam)
    seen = SEEN.copy()
    seen[GRID.z_mm > 6.7] = False
    contrast[~seen] = 1.0
    side = Surface("b", own, seen, contrast=contrast.astype(np.float32))
    assert own[seen].mean() > 0.1
    assert invisible_cells(side, labels, [1, 2, 3], GRID) == [bare]
