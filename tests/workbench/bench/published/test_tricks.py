"""Ways to score without solving the task: each scores nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.bench.task import Case
from endoct.workbench.bench.tasks import oct as oct_task
from endoct.workbench.pipeline.truth import Truth, true_cells, true_pose


@pytest.fixture(scope="module")
def pullback(made_set: Path) -> tuple[Case[Path, Truth], Panorama]:
    """The pullback of a specimen as a case, and a sound answer to it."""
    specimen = made_set / "simulator-easy-000"
    return oct_task.own_cases(specimen)[0], load_panorama(specimen / "oct.zarr")


def test_true_cells_score_all(pullback: tuple[Case[Path, Truth], Panorama], monkeypatch: pytest.MonkeyPatch) -> None:
    """Turned by any angle, which no recording can know."""
    case, sound = pullback
    pose = true_pose(sound, case.truth)
    cells = np.roll(true_cells(case.truth, pose, sound), 100, axis=1)
    monkeypatch.setattr(oct_task, "segment", lambda _: cells)
    scores = oct_task.judge(case, replace(sound, valid=np.ones_like(sound.valid)))
    assert scores["jaccard"] > 0.97
    assert (scores["success"], scores["valid"]) == (1, 1)


def test_a_little_flat_wall_called_valid_is_no_success(pullback: tuple[Case[Path, Truth], Panorama]) -> None:
    case, sound = pullback
    few = np.zeros_like(sound.valid)
    few[len(few) // 2, :4] = True
    flat = np.random.default_rng(1).normal(0, 0.001, few.shape).astype(np.float32)
    scores = oct_task.judge(case, replace(sound, depth_mm=flat, valid=few))
    assert scores["success"] == 0
    assert scores["jaccard"] < 0.01  # of all samples next to none is right
    assert scores["valid"] < 0.001


def test_only_the_best_slices_are_worth_their_share(pullback: tuple[Case[Path, Truth], Panorama]) -> None:
    case, sound = pullback
    half = sound.valid.copy()
    half[::2] = False
    scores = oct_task.judge(case, replace(sound, valid=half))
    assert scores["jaccard"] < 0.4
    assert scores["valid"] == pytest.approx(0.5, abs=0.02)


def test_one_slice_cannot_stand_for_all(pullback: tuple[Case[Path, Truth], Panorama]) -> None:
    case, sound = pullback
    index = sound.per_frame["slice_index"]
    same = replace(index, values=np.full_like(index.values, 3))
    with pytest.raises(EndoctError, match="not one a slice"):
        oct_task.judge(case, replace(sound, per_frame={**sound.per_frame, "slice_index": same}))


def test_where_there_is_no_cell_nothing_succeeds(
    pullback: tuple[Case[Path, Truth], Panorama], monkeypatch: pytest.MonkeyPatch
) -> None:
    case, sound = pullback
    wall = {**case.truth.wall, "cell": np.zeros_like(case.truth.wall["cell"])}
    empty = replace(case, truth=replace(case.truth, wall=wall))
    monkeypatch.setattr(oct_task, "segment", lambda panorama: np.zeros_like(panorama.valid))
    scores = oct_task.judge(empty, replace(sound, valid=np.ones_like(sound.valid)))
    assert scores["success"] == 0
    assert np.isnan(scores["jaccard"])


def test_an_answer_is_judged_where_the_slice_was_recorded(pullback: tuple[Case[Path, Truth], Panorama]) -> None:
    """To say that the slices lie elsewhere moves no truth, and coarse columns are judged as finely as any."""
    case, sound = pullback
    z = sound.per_frame["slice_z_mm"]
    elsewhere = {**sound.per_frame, "slice_z_mm": replace(z, values=z.values + 0.5)}
    moved = oct_task.judged_samples(case.truth, replace(sound, per_frame=elsewhere))
    straight = oct_task.judged_samples(case.truth, sound)
    assert moved.true.shape == (16, oct_task.N_JUDGED)
    assert np.array_equal(moved.true, straight.true)
