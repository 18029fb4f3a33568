"""The task "oct": truth that it needs, and where a helical pullback truly lies."""

from dataclasses import replace
from pathlib import Path

import pytest

from endoct.base.errors import EndoctError
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.side_cells import segment
from endoct.synthetic.sample.ranges import Range
from endoct.synthetic.specimen import simulate
from endoct.workbench import unroll
from endoct.workbench.bench.tasks import oct as oct_task
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose


def test_a_pullback_without_truth_is_told(tmp_path: Path) -> None:
    (tmp_path / "oct").mkdir()
    with pytest.raises(EndoctError, match="has no truth"):
        oct_task.own_cases(tmp_path)


def test_a_helical_pullback_is_judged_where_it_was_recorded(tmp_path: Path) -> None:
    ranges: dict[str, Range] = {"oct.scan": ("helical",), "bore.bone": ("phantom",), "oct.wall_db": (20.0, 20.0)}
    simulate(tmp_path / "bore", preset="learning", seed=13, ranges=ranges)
    truth, panorama = load_truth(tmp_path / "bore"), unroll(tmp_path / "bore" / "oct")
    pose, cells = true_pose(panorama, truth), segment(panorama)
    scored = {
        shift_mm: jaccard(
            cells, true_cells(truth, replace(pose, z_bore_mm=pose.z_bore_mm + shift_mm), panorama), panorama.valid
        )
        for shift_mm in (-0.1, 0.0, 0.1)  # half a pitch
    }
    assert scored[0.0] > max(scored[-0.1], scored[0.1]) + 0.05
