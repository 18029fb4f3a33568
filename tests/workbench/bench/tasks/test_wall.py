"""The task "wall": scored where both sides observed, against either side; what is not known counts as wrong."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from wall_sides import GRID, disc, sides

from endoct.base.errors import EndoctError
from endoct.fusion.sides import Placed
from endoct.workbench.bench.task import Case
from endoct.workbench.bench.tasks.depth import Depths
from endoct.workbench.bench.tasks.wall import TASK, JoinedWall, ShownPair, WallCase, believed_side, case_of, judge, ours

CELL, LEFT = disc(2.5, 0.05, 0.4), np.broadcast_to(GRID.theta_rad < np.pi, GRID.shape)
NONE = np.zeros(GRID.shape, np.bool_)
DEEP_MM = 0.3


def case(depth: np.ndarray = CELL, cell: np.ndarray = CELL, **changed: object) -> WallCase:
    """A cell over the seam that light shows on one side of it alone."""
    relief_mm = np.where(cell, DEEP_MM, 0).astype(np.float32)
    shown = ShownPair(sides(CELL & LEFT, depth, **changed), np.ones(GRID.shape, np.float32), 0)
    return Case("made", shown, Depths(relief_mm, cell), {})


def test_the_true_wall_is_ahead_of_the_better_side() -> None:
    part = disc(2.5, 0.05, 0.35)
    made = case(part)
    true = JoinedWall(made.truth.cell, made.truth.relief_mm)
    scores = judge(made, true)
    better = part.sum() / CELL.sum()  # 0.77; light shows 0.6 of the cell
    assert scores["ahead"] == pytest.approx(1 - better)
    assert {name: scores[name] for name in ("success", "jaccard", "depth_um", "volume_off")} == {
        "success": 1.0, "jaccard": 1.0, "depth_um": 0.0, "volume_off": 0.0,
    }  # fmt: skip
    assert judge(made, JoinedWall(CELL & LEFT))["ahead"] == pytest.approx((CELL & LEFT).sum() / CELL.sum() - better)


@pytest.mark.parametrize(("share", "success"), [(0.89, 1.0), (0.87, 0.0)])
def test_a_wall_succeeds_from_an_index_of_088(share: float, success: float) -> None:
    some = np.flatnonzero(CELL)[: round(share * CELL.sum())]
    cells = NONE.copy()
    cells.flat[some] = True
    scores = judge(case(), JoinedWall(cells))
    assert scores["jaccard"] == pytest.approx(share, abs=0.001)
    assert scores["success"] == success
    assert "depth_um" not in scores


def test_depth_that_is_not_known_counts_as_the_bores_wall() -> None:
    made = case()
    half = np.where(LEFT, np.float32(DEEP_MM + 0.1), np.float32(np.nan))
    scores = judge(made, JoinedWall(CELL, half))
    known = (CELL & LEFT).sum() / CELL.sum()
    assert scores["depth_um"] == pytest.approx(100 * known + 300 * (1 - known), rel=1e-4)
    assert scores["volume_off"] == pytest.approx(1 - known * 4 / 3, rel=1e-4)
    assert judge(made, JoinedWall(CELL & ~LEFT, half))["volume_off"] == 1.0  # of no cell is the depth known


def test_what_lies_deeper_than_asked_for_is_no_error() -> None:
    made = case()
    deep = replace(made, truth=Depths(np.where(CELL, np.float32(2.5), np.float32(0)), CELL))
    scores = judge(deep, JoinedWall(CELL, np.where(CELL, np.float32(9), np.float32(0))))
    assert (scores["depth_um"], scores["volume_off"]) == (0.0, 0.0)


def test_only_what_both_sides_observed_is_scored() -> None:
    made = case(observed=(LEFT, np.ones(GRID.shape, np.bool_)))
    assert judge(made, JoinedWall(CELL & LEFT))["jaccard"] == 1.0
    deep = np.full(GRID.shape, np.float32(DEEP_MM))
    beyond = judge(made, JoinedWall(CELL | ~LEFT, deep))
    assert (beyond["jaccard"], beyond["depth_um"]) == (1.0, 0.0)
    assert beyond["volume_off"] == pytest.approx(0, abs=1e-5)
    other = case(observed=(np.ones(GRID.shape, np.bool_), LEFT))
    assert judge(other, JoinedWall(CELL | ~LEFT))["jaccard"] == 1.0
    unknown = replace(made, truth=Depths(np.where(CELL, np.float32(np.nan), np.float32(0)), CELL))
    assert judge(unknown, JoinedWall(NONE))["jaccard"] == 1.0


def test_where_there_is_no_cell_none_must_be_answered() -> None:
    bare = case(NONE, NONE)
    assert judge(bare, JoinedWall(NONE, np.zeros(GRID.shape, np.float32))) == {
        "success": 1.0, "jaccard": 1.0, "ahead": 0.0,
    }  # fmt: skip
    assert judge(bare, JoinedWall(CELL)) == {"success": 0.0, "jaccard": 0.0, "ahead": -1.0}


def test_other_answers_are_useless() -> None:
    for cells in (CELL[:3], CELL.astype(float)):
        with pytest.raises(EndoctError, match="no mask"):
            judge(case(), JoinedWall(cells))
    for relief_mm in (np.zeros((3, 4)), CELL):
        with pytest.raises(EndoctError, match="no depth"):
            judge(case(), JoinedWall(CELL, relief_mm))


def test_endoct_has_what_one_side_lacks() -> None:
    made = case()
    scores = judge(made, ours(made.given))
    assert scores["jaccard"] > 0.9
    assert scores["depth_um"] < 30


def test_both_sides_of_a_specimen_lie_in_their_true_place(quick_specimen: Path) -> None:
    made = case_of(quick_specimen)
    alone = [judge(made, JoinedWall(cells))["jaccard"] for cells in made.given.sides.cells]
    assert alone[0] > 0.9
    assert alone[1] > 0.75
    assert made.given.believed == 0
    sides, scores = made.given.sides, judge(made, ours(made.given))
    assert scores["jaccard"] > max(alone) - 0.01
    assert scores["depth_um"] < 60
    assert np.array_equal(made.given.intensity > 0, sides.observed[0])
    relief_mm, both = made.truth.relief_mm, made.truth.cell & sides.observed[1]
    off = sides.relief_mm - relief_mm
    assert np.nanmedian(np.abs(off[both])) < 0.05


@pytest.mark.parametrize(("doubts", "believed"), [((1, 0), 1), ((1, 1), 0), ((0, 2), 0)])
def test_the_side_with_fewer_doubts_is_believed_the_endoscope_of_two_alike(
    doubts: tuple[int, int], believed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("endoct.workbench.bench.tasks.wall.doubts_of_side", lambda side, _: ["it is dim"] * side)
    placed = cast(Placed, SimpleNamespace(both=doubts, cells=(None, None)))
    assert believed_side(placed, sides(CELL, CELL)) == believed
    turned = replace(sides(CELL, CELL), light_side=1, depth_side=0)
    assert believed_side(placed, turned) == (1 if doubts[0] == doubts[1] else believed)


def test_a_program_gets_both_sides_and_answers_with_depth_or_without(tmp_path: Path) -> None:
    exchange, made = TASK.exchange, case(disc(2.5, 0.05, 0.3))
    assert exchange is not None
    for believed, name in ((0, "endoscope"), (1, "oct")):
        exchange.write(replace(made.given, believed=believed), tmp_path)
        assert json.loads((tmp_path / "given.json").read_text(encoding="utf-8"))["believed"] == name
    shown = {path.stem: np.load(path) for path in tmp_path.glob("*.npy")}
    assert np.array_equal(shown["endoscope_cells"], CELL & LEFT)
    assert np.array_equal(shown["oct_cells"], disc(2.5, 0.05, 0.3))
    assert shown["rows_relief_mm"].shape == (shown["rows_z_mm"].size, GRID.n_theta)
    assert np.array_equal(shown["relief_mm"], made.given.sides.relief_mm)
    plain = tmp_path / "answer"
    plain.mkdir()
    np.save(plain / "cells.npy", CELL.astype(np.uint8))
    read = exchange.read(made.given, plain)
    assert read.relief_mm is None
    assert np.array_equal(read.cells, CELL)
    answer = ours(made.given)
    exchange.answer(answer, plain)
    read = exchange.read(made.given, plain)
    assert np.array_equal(read.cells, answer.cells)
    assert np.array_equal(read.relief_mm, answer.relief_mm, equal_nan=True)
    np.save(plain / "cells.npy", CELL.astype(float))
    with pytest.raises(EndoctError, match="no mask"):
        exchange.read(made.given, plain)
