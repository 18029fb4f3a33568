"""A published set in other layouts, each loaded by its own library."""

import json
from pathlib import Path

import numpy as np
import pytest
import webdataset
import xarray
from PIL import Image

from endoct.base.errors import EndoctError
from endoct.workbench.bench.published.examples import Examples
from endoct.workbench.bench.published.layouts import write_layout
from endoct.workbench.running.progress import SilentStages


def test_shards_hold_the_arrays_to_the_bit(made_set: Path, tmp_path: Path) -> None:
    assert write_layout(made_set, tmp_path / "wds", "webdataset", stages=SilentStages()) == 4
    with (tmp_path / "wds" / "train-000000.tar").open("rb") as stream:  # webdataset leaves closing to others
        shard = webdataset.tariterators.tar_file_expander([{"url": "train", "stream": stream}])
        samples = list(map(webdataset.autodecode.Decoder([]), webdataset.tariterators.group_by_keys(shard)))
    examples = Examples(made_set, "segmentation")
    assert len(samples) == len(examples)
    for sample, k in zip(samples, range(len(examples)), strict=True):
        for name in ("intensity", "depth_mm", "valid", "cell"):
            assert np.array_equal(sample[f"{name}.npy"], examples[k][name])
        assert sample["json"]["generator"] == "simulator"


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
