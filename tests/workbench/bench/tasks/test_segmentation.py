"""The task "segmentation": its cases, its judge, every method, and that ours says when it does not know."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.workbench.bench.runner import run_method
from endoct.workbench.bench.task import Range, load_task, method_names
from endoct.workbench.bench.tasks import segmentation
from endoct.workbench.bench.tasks.segmentation import SegmentationCase

MIDDLE: dict[str, Range] = {
    "recipe": ("made",),
    "signal_db": (20.0, 20.0),
    "cell_mm": (0.8, 0.8),
    "fill": (0.2, 0.2),
    "missing": (0.1, 0.1),
    "unevenness": (0.5, 0.5),
}


def made(modality: str, seed: int = 5, **changes: float) -> SegmentationCase:
    ranges: dict[str, Range] = {**MIDDLE, "modality": (modality,)}
    return segmentation.cases(seed, 0, ranges | {key: (value, value) for key, value in changes.items()})


@pytest.fixture(scope="module", params=["depth", "intensity"])
def case(request: pytest.FixtureRequest) -> SegmentationCase:
    return made(request.param)


def test_every_method_answers_with_a_mask(case: SegmentationCase) -> None:
    task = load_task("segmentation")
    rows = [run_method(task, name, case) for name in method_names(task)]
    assert {row.method: row.reason for row in rows if row.status == "failed"} == {}
    scores = {row.method: row.scores["jaccard"] for row in rows if row.status == "ok"}
    assert scores.pop("nothing") == 0
    assert all(0 < score <= 1 for score in scores.values())
    assert len(rows) > 10


def test_ours_finds_the_cells_of_an_easy_wall(case: SegmentationCase) -> None:
    row = run_method(segmentation.TASK, "endoct", case)
    assert row.scores["jaccard"] > (0.85 if case.conditions["modality"] == "depth" else 0.6)


@pytest.mark.parametrize("modality", ["depth", "intensity"])
def test_ours_declines_where_noise_looks_like_cells(modality: str) -> None:
    row = run_method(segmentation.TASK, "endoct", made(modality, signal_db=2.0))
    assert row.status == "declined"
    assert "may" in row.reason


def test_the_judge_counts_valid_samples_alone(case: SegmentationCase) -> None:
    panorama = case.given
    perfect = segmentation.judge(case, case.truth)
    assert (perfect["jaccard"], perfect["precision"], perfect["recall"], perfect["cells_found"]) == (1, 1, 1, 1)
    assert segmentation.judge(case, case.truth ^ ~panorama.valid) == perfect
    nothing = segmentation.judge(case, np.zeros_like(case.truth))
    assert (nothing["jaccard"], nothing["recall"], nothing["success"]) == (0, 0, 0)
    everything = segmentation.judge(case, np.ones_like(case.truth))
    assert everything["jaccard"] == pytest.approx(case.truth[panorama.valid].mean())
    for junk in (case.truth.astype(float), case.truth[1:], None):
        with pytest.raises(EndoctError, match="no mask"):
            segmentation.judge(case, junk)


def test_own_data_with_masks_drawn_by_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    specimen = made("depth")
    monkeypatch.setattr(segmentation, "load_side", lambda folder, name: specimen.given)
    for name in ("oct", "truth"):
        (tmp_path / "bore" / name).mkdir(parents=True)
    (tmp_path / "bore" / "oct" / "acquisition.toml").write_text('modality = "oct"\n')
    for rater, drawn in (("oct-anna.png", specimen.truth), ("oct-ben.tif", np.roll(specimen.truth, 40, axis=1))):
        cv2.imwrite(str(tmp_path / "bore" / "truth" / rater), drawn.astype(np.uint8) * 255)
    anna, ben = segmentation.own_cases(tmp_path / "bore")
    assert (anna.name, ben.name) == ("bore/oct/oct-anna", "bore/oct/oct-ben")
    np.testing.assert_array_equal(anna.truth, specimen.truth)
    assert segmentation.judge(ben, specimen.truth)["jaccard"] < 1
    for path in (tmp_path / "bore" / "truth").iterdir():
        path.unlink()
    with pytest.raises(EndoctError, match=r"oct\.png"):
        segmentation.own_cases(tmp_path / "bore")
