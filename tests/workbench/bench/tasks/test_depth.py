"""The task "depth": what is not known counts, and places lie where they are seen."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip
from endoct.workbench.bench.program import Program
from endoct.workbench.bench.rivals.depth import darkness, flat, li_constant, optical_flow, plane_sweep
from endoct.workbench.bench.task import Case, Declined
from endoct.workbench.bench.tasks.depth import TASK, Depths, Views, judge, ours, own_cases

N_Z, N_THETA, DZ_MM, RADIUS_MM = 150, 512, 0.02, 1.25
SLANT = (0.1, 0.6)
"""At the first and the last row of a strip."""
DEEP_MM = 0.5


def made_views() -> tuple[Views, Depths]:
    """A textured wall with one deep, darker stretch across the seam, seen by frames 0.15 mm apart, with noise."""
    rng = np.random.default_rng(5)
    grid = SurfaceGrid.full_circle(N_Z, N_THETA, z0_mm=0.0, dz_mm=DZ_MM, radius_mm=RADIUS_MM)
    cell = np.zeros(grid.shape, bool)
    cell[50:100, : N_THETA // 8] = cell[50:100, -N_THETA // 8 :] = True
    relief = np.where(cell, DEEP_MM, 0.0).astype(np.float32)
    fine = np.cumsum(rng.normal(size=(2 * N_Z, N_THETA)), axis=0)
    texture = 0.2 * (fine - np.mean([np.roll(fine, k, 0) for k in range(-6, 7)], axis=0))
    along_mm = np.linspace(-0.5, 0.5, 51)
    slant = np.linspace(*SLANT, along_mm.size)
    middles = np.arange(0.3, N_Z * DZ_MM - 0.3, 0.15)
    strips, total, count = [], np.zeros(grid.shape), np.zeros(grid.shape)
    for middle in middles:
        rows = np.flatnonzero(np.abs(grid.z_mm - middle) <= 0.5)
        m = np.interp(grid.z_mm[rows] - middle, along_mm, slant)[:, None]
        # what a ray that passes the wall at z meets: the floor at z + slant · depth, where that is deep
        floor = np.clip(rows[:, None] + np.rint(m * DEEP_MM / DZ_MM).astype(int), 0, N_Z - 1)
        on_floor = cell[floor, np.arange(N_THETA)] & cell[rows]
        at = np.where(on_floor, floor, rows[:, None])
        light = np.exp(texture[at, np.arange(N_THETA)] - 0.7 * on_floor + 0.01 * rng.normal(size=at.shape))
        valid = np.ones(at.shape, bool)
        valid[:, 200:204] = False  # dirt on the probe
        strips.append(
            Strip(grid.z_mm[rows], grid.theta_rad, light.astype(np.float32), None, valid, valid.astype(np.float32))
        )
        total[rows] += np.where(valid, light, 0)
        count[rows] += valid
    seen = count > 0
    panorama = Panorama(
        grid,
        np.where(seen, total / np.maximum(count, 1), 0),
        None,
        seen,
        seen.astype(np.float32),
        "endoscope",
        True,
        True,
    )
    return Views(Path("nowhere"), panorama, tuple(strips), middles, along_mm, slant, slant_known=True), Depths(
        relief, cell
    )


@pytest.fixture(scope="module")
def made() -> Case[Views, Depths]:
    views, truth = made_views()
    return Case("made", views, truth, {})


def test_scores_are_medians_over_wall_and_cells_and_unknown_counts_as_wall(made: Case[Views, Depths]) -> None:
    answer = np.where(made.truth.cell, DEEP_MM - 0.1, 0.02).astype(np.float32)
    scores = judge(made, answer)
    assert scores["cell_um"] == pytest.approx(100, abs=0.1)
    assert scores["cell_bias_um"] == pytest.approx(-100, abs=0.1)
    assert scores["wall_um"] == pytest.approx(20, abs=0.1)
    assert scores["error_um"] == pytest.approx(60, abs=0.1)
    assert scores["success"] == 1.0
    answer[made.truth.cell] = np.nan
    scores = judge(made, answer)
    assert scores["cell_um"] == pytest.approx(1e3 * DEEP_MM, abs=0.1)
    assert (scores["known"], scores["success"]) == (0.0, 0.0)


def test_deeper_than_asked_for_is_no_error(made: Case[Views, Depths]) -> None:
    deep = replace(made, truth=Depths(np.where(made.truth.cell, 2.5, 0).astype(np.float32), made.truth.cell))
    assert judge(deep, np.where(made.truth.cell, 9.0, 0.0))["cell_um"] == 0.0


def test_other_answers_and_a_bare_wall(made: Case[Views, Depths]) -> None:
    for answer in (np.zeros((3, 4)), np.zeros(made.truth.cell.shape, int), "deep"):
        with pytest.raises(EndoctError, match="no depth"):
            judge(made, answer)
    bare = replace(made, truth=Depths(0 * made.truth.relief_mm, np.zeros_like(made.truth.cell)))
    with pytest.raises(Declined, match="no cell"):
        judge(bare, np.zeros(made.truth.cell.shape))


def test_methods_by_motion_find_the_depth_across_the_seam(made: Case[Views, Depths]) -> None:
    flat_error = judge(made, flat(made.given))["cell_um"]
    for method in (plane_sweep, optical_flow):
        depth = method(made.given)
        scores = judge(made, depth)
        assert scores["cell_um"] < 0.5 * flat_error
        assert scores["wall_um"] < 60
        inner = depth[65:85]
        assert abs(np.nanmedian(inner[:, :8]) - np.nanmedian(inner[:, -8:])) < 0.1  # on either side of 0/2π


def test_methods_by_brightness_find_that_it_is_dark(made: Case[Views, Depths]) -> None:
    for method in (darkness, li_constant):
        depth = method(made.given)
        assert np.median(depth[made.truth.cell]) > 0.15
        assert abs(np.median(depth[~made.truth.cell])) < 0.02


def test_endoct_is_judged_on_a_simulated_recording(quick_specimen: Path) -> None:
    (case,) = own_cases(quick_specimen)
    assert case.given.panorama.parallax_depth_mm is None
    try:
        scores = judge(case, ours(case.given))
    except Declined:
        assert not case.given.slant_known
    else:
        assert scores["cell_um"] < judge(case, flat(case.given))["cell_um"] / 2
        assert scores["wall_um"] < 20
    with pytest.raises(EndoctError, match="no recording"):
        own_cases(quick_specimen / "oct")


def test_a_program_gets_the_strips_on_the_panoramas_rows(made: Case[Views, Depths], tmp_path: Path) -> None:
    exchange = TASK.exchange
    assert exchange is not None
    assert not isinstance(exchange, Program)
    exchange.write(made.given, tmp_path)
    strips, facts = np.load(tmp_path / "strips.npy"), json.loads((tmp_path / "views.json").read_text(encoding="utf-8"))
    assert strips.shape == (len(made.given.strips), N_Z, N_THETA)
    first = made.given.strips[0]
    row = int(np.argmin(np.abs(made.given.panorama.z_mm - first.z_mm[3])))
    assert np.array_equal(strips[0, row], np.where(first.valid[3], first.intensity[3], np.nan), equal_nan=True)
    assert len(facts["slant"]) == len(facts["from_middle_mm"])
    np.save(tmp_path / "depth_mm.npy", np.full(made.truth.cell.shape, 0.1))
    assert (exchange.read(made.given, tmp_path) == np.float32(0.1)).all()
