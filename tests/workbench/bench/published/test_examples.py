"""Examples of a published set: arrays of every task, learning from them, and layouts of other libraries."""

import io
import json
import shutil
import tarfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
import webdataset
import xarray
from bench_tasks import DOUBLING
from PIL import Image

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.examples import Examples, write_layout
from endoct.workbench.bench.published.specimen_set import SET_FILE
from endoct.workbench.running.progress import SilentStages

ROOT = Path(__file__).parents[4]


@pytest.fixture(scope="module")
def made_set(made_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The set with specimens to learn from."""
    folder = Path(shutil.copytree(made_set, tmp_path_factory.mktemp("learnt") / "set"))
    listed = (folder / SET_FILE).read_text(encoding="utf-8")
    (folder / SET_FILE).write_text(listed.replace('"split":"test"', '"split":"train"'), encoding="utf-8")
    return folder


def test_segmentation_has_the_truth_on_the_panoramas_samples(made_set: Path) -> None:
    examples = Examples(made_set, "segmentation", "train")
    assert len(examples) == 4  # two specimens with two sides
    sides = set()
    for k in range(len(examples)):
        example = examples[k]
        shapes = {example[name].shape for name in ("intensity", "depth_mm", "valid", "cell")}
        assert len(shapes) == 1
        assert example["cell"].dtype == bool
        assert example["z_mm"].shape == example["cell"].shape[:1]
        assert np.all(np.diff(example["z_mm"]) > 0)
        assert 1 < np.ptp(example["z_mm"]) < 20
        assert bool(example["has_depth"]) == bool(np.any(example["depth_mm"]))
        sides.add(str(example["name"]).split("/")[1])
    assert sides == {"oct", "endoscope"}


def test_the_depth_of_true_cells_lies_behind_the_wall(made_set: Path) -> None:
    examples = [Examples(made_set, "segmentation")[k] for k in range(4)]
    deep = [example for example in examples if example["has_depth"] and example["cell"].any()]
    assert deep
    for example in deep:
        cell, wall = (example["depth_mm"][example["valid"] & (example["cell"] == is_cell)] for is_cell in (True, False))
        assert np.median(cell) > np.median(wall) + 0.05


def test_stitching_oct_and_alignment_have_their_truth(made_set: Path) -> None:
    strips = Examples(made_set, "stitching")[0]
    assert strips["strips"].shape[0] == strips["z_mm"].size == strips["roll_rad"].size
    pullback = Examples(made_set, "oct")[0]
    assert pullback["recording"].dtype == np.uint8
    assert pullback["recording"].shape[0] == pullback["turn_length"].size
    assert pullback["cell"].shape == (pullback["wall_z_mm"].size, pullback["wall_theta_rad"].size)
    pair = Examples(made_set, "alignment")[0]
    assert pair["z_in_a_mm"].size == pair["b_intensity"].shape[0]
    steps = np.angle(np.exp(1j * np.diff(pair["theta_in_a_rad"])))
    assert np.ptp(steps) < 1e-9  # θ runs on across 0/2π


def test_depth_has_the_frames_that_depth_is_found_by(made_set: Path) -> None:
    depth = Examples(made_set, "depth")[0]
    assert depth["strips"].shape == (depth["frame_z_mm"].size, *depth["valid"].shape)
    assert depth["slant"].shape == depth["from_middle_mm"].shape
    shown = np.isfinite(depth["strips"]).sum(axis=0)
    assert shown[depth["valid"]].mean() > 1.5  # most places lie in two frames at least
    middles = [np.flatnonzero(np.isfinite(frame).any(axis=1)).mean() for frame in depth["strips"]]
    assert np.corrcoef(middles, depth["frame_z_mm"])[0, 1] > 0.99


def test_a_split_without_examples_and_another_task_are_refused(made_set: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(EndoctError, match="no example"):
        Examples(made_set, "segmentation", "test")
    monkeypatch.setattr("endoct.workbench.bench.published.examples.load_task", lambda name: DOUBLING)
    with pytest.raises(EndoctError, match="no examples"):
        Examples(made_set, "doubling")


def test_the_manuals_training_runs_and_learns(made_set: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # it reads each of four examples ten times, as sets larger than the memory have to be
    monkeypatch.setattr(Examples, "__getitem__", cache(Examples.__getitem__))
    page = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    code = page.partition("```python\n")[2].partition("```")[0]
    assert '"DATA"' in code
    assert "loss.backward()" in code
    torch.manual_seed(0)
    code = code.replace('"DATA"', repr(str(made_set))).replace(
        "        loss.backward()", "        losses.append(float(loss.detach()))\n        loss.backward()"
    )
    losses: list[float] = []
    exec(code, {"losses": losses})
    assert len(losses) == 40
    assert np.mean(losses[-8:]) < 0.8 * np.mean(losses[:4])


def test_shards_hold_the_arrays_to_the_bit(made_set: Path, tmp_path: Path) -> None:
    assert write_layout(made_set, tmp_path / "wds", "webdataset", stages=SilentStages()) == 4
    with (tmp_path / "wds" / "train-000000.tar").open("rb") as stream:  # webdataset leaves closing to others
        shard = webdataset.tariterators.tar_file_expander([{"url": "train", "stream": stream}])
        samples = list(map(webdataset.autodecode.Decoder([]), webdataset.tariterators.group_by_keys(shard)))
    examples = Examples(made_set, "segmentation")
    assert len(samples) == len(examples)
    for sample, k in zip(samples, range(len(examples)), strict=True):
        for name in ("intensity", "depth_mm", "valid", "cell", "z_mm"):
            assert np.array_equal(sample[f"{name}.npy"], examples[k][name])
        assert sample["json"]["generator"] == "simulator"
    assert {sample["json"]["side"] for sample in samples} == {"oct", "endoscope"}


def test_every_task_has_shards_and_segmentation_alone_pictures(made_set: Path, tmp_path: Path) -> None:
    assert write_layout(made_set, tmp_path / "pairs", "webdataset", "alignment", stages=SilentStages()) == 2
    pair = Examples(made_set, "alignment")[0]
    with tarfile.open(tmp_path / "pairs" / "train-000000.tar") as shard:
        names = shard.getnames()
        assert len({*names}) == len(names) == 2 * (len(pair) - 2 + 1)  # its arrays, and a file of facts
        stored = np.load(io.BytesIO(shard.extractfile(f"{pair['specimen']}.z_in_a_mm.npy").read()))  # type: ignore[union-attr]
    assert np.array_equal(stored, pair["z_in_a_mm"], equal_nan=True)
    with pytest.raises(EndoctError, match="no pictures of the task 'oct'"):
        write_layout(made_set, tmp_path / "new", "huggingface", "oct", stages=SilentStages())
    with pytest.raises(EndoctError, match="no example for 'pose'"):
        write_layout(made_set, tmp_path / "new", "webdataset", "pose", stages=SilentStages())
    assert not (tmp_path / "new").exists()


def test_pictures_are_masks_and_panoramas(made_set: Path, tmp_path: Path) -> None:
    write_layout(made_set, tmp_path / "hf", "huggingface", stages=SilentStages())
    lines = (tmp_path / "hf" / "train" / "metadata.jsonl").read_text(encoding="utf-8").splitlines()
    examples = Examples(made_set, "segmentation")
    for line, k in zip(map(json.loads, lines), range(len(examples)), strict=True):
        example = examples[k]
        mask = np.asarray(Image.open(tmp_path / "hf" / "train" / line["mask_file_name"]))
        assert np.array_equal(mask > 0, example["cell"])
        assert ("depth_file_name" in line) == bool(example["has_depth"])
        if "depth_file_name" in line:
            depth = np.asarray(Image.open(tmp_path / "hf" / "train" / line["depth_file_name"])) / 100
            assert np.abs(depth - np.clip(example["depth_mm"], 0, 2.55)).max() <= 0.0051


def test_hugging_faces_library_loads_the_pictures(
    made_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    datasets = pytest.importorskip("datasets", reason="datasets is not installed")
    write_layout(made_set, tmp_path / "hf", "huggingface", stages=SilentStages())
    loaded = datasets.load_dataset("imagefolder", data_dir=str(tmp_path / "hf"), cache_dir=str(tmp_path / "cache"))
    assert loaded["train"].num_rows == 4
    first = loaded["train"][0]
    assert first["image"].size == first["mask"].size
    assert first["difficulty"] in ("easy", "hard")


def test_xarray_opens_the_set_itself(made_set: Path) -> None:
    panorama = xarray.open_zarr(made_set / "simulator-easy-000" / "oct.zarr")
    assert panorama["depth_mm"].dims == ("z", "theta")
    truth = xarray.open_zarr(made_set / "simulator-easy-000" / "truth" / "wall.zarr")
    assert truth["cell"].dims == ("z", "theta")


def test_another_layout_and_an_output_that_exists_are_refused(made_set: Path, tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="no layout"):
        write_layout(made_set, tmp_path / "new", "tensorflow", stages=SilentStages())  # type: ignore[arg-type]
    (tmp_path / "mine").mkdir()
    with pytest.raises(EndoctError, match="exists"):
        write_layout(made_set, tmp_path / "mine", "webdataset", stages=SilentStages())


def test_the_wall_has_what_both_sides_show_and_the_truth(made_set: Path) -> None:
    wall = Examples(made_set, "wall")[0]
    shown = wall["endoscope_cells"] & wall["oct_observed"]
    true = wall["true_cell"] & wall["endoscope_observed"] & wall["oct_observed"]
    assert (shown & true).sum() > 0.5 * (shown | true).sum()
    assert wall["rows_relief_mm"].shape == (wall["rows_z_mm"].size, true.shape[1])
    assert np.nanmedian(wall["true_relief_mm"][true]) > 0.05
    assert abs(np.nanmedian(wall["true_relief_mm"][~wall["true_cell"]])) < 0.01
