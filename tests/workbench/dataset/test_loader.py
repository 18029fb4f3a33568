"""A data set as the command makes it, and as people who train networks read it."""

import csv
import hashlib
import json
import sys
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest
import torch
import webdataset
import xarray as xr
from cheap_specimens import Cheap
from matplotlib.figure import Figure
from torch.utils.data import DataLoader

from endoct.base.errors import EndoctError
from endoct.workbench import cli, simulate
from endoct.workbench.dataset import Specimens, overview
from endoct.workbench.dataset.creation import make_dataset
from endoct.workbench.dataset.plan import DatasetPlan, Split


def endoct(*arguments: object) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["endoct", *map(str, arguments)])
        with pytest.raises(SystemExit) as leave:
            cli.main()
    return int(leave.value.code or 0)


@pytest.fixture(scope="module")
def learning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of one bore."""
    root = tmp_path_factory.mktemp("learning") / "set"
    ranges = ("--vary", "oct.wall_db=18..19", "--vary", "oct.scan=helical")
    assert endoct("dataset", "-o", root, "--count", 2, "--recordings-per-bore", 2, "--workers", 1, *ranges) == 0
    return root


def test_the_contact_sheet_shows_the_middle_of_specimens_spread_over_the_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_dataset(tmp_path / "set", DatasetPlan(3, seed=2), workers=1, make=Cheap(tmp_path / "log"))
    drawn: list[Figure] = []
    monkeypatch.setattr(overview, "N_SPECIMENS", 2)
    monkeypatch.setattr(Figure, "savefig", lambda figure, file, **_: [drawn.append(figure), file.write(b"a sheet")])
    overview.write_contact_sheet(tmp_path / "set")
    axes = np.array(drawn[0].axes).reshape(-1, 4)
    specimens = Specimens(tmp_path / "set")
    assert [axis.get_title() for axis in axes[0]] == list(overview.TITLES)
    for row, index in zip(axes, (0, 2), strict=True):
        arrays, line = specimens[index], specimens.rows[index]
        oct_ = arrays["oct"]  # of two slices
        expected = oct_[1], oct_.mean(axis=1), arrays["endoscope"][1], np.clip(arrays["relief_mm"], 0, 1)
        for axis, image in zip(row, expected, strict=True):
            np.testing.assert_allclose(axis.images[0].get_array(), image, rtol=1e-6)
        assert row[0].get_ylabel() == f"{line['name']}\n{line['split']}\n{line['bore.bone']}"


def rows(root: Path) -> list[dict[str, str]]:
    with (root / "manifest.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_manifest_tells_what_was_drawn(learning: Path) -> None:
    first, second = rows(learning)
    for row in (first, second):
        folder = learning / row["path"]
        sample = json.loads((folder / "truth" / "sample.json").read_text())
        assert 18 <= float(row["oct.wall_db"]) == sample["oct"]["wall_db"] <= 19
        assert row["oct.scan"] == "helical"
        assert (int(row["seed"]), int(row["bore_seed"])) == (sample["seed"], sample["bore_seed"])
        lines = "".join(
            f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder).as_posix()}\n"
            for path in sorted(folder.rglob("*"), key=lambda path: path.relative_to(folder).as_posix())
            if path.is_file()
        )
        assert hashlib.sha256(lines.encode()).hexdigest() == row["digest"]
    assert first["bore_seed"] == second["bore_seed"]
    assert first["seed"] != second["seed"]
    assert first["bore.length_mm"] == second["bore.length_mm"]
    picture = cv2.imread(str(learning / "contact_sheet.png"))
    assert picture is not None
    assert picture.std() > 10


def test_a_data_loader_gives_stacks_of_what_is_in_the_files(learning: Path) -> None:
    specimens = Specimens(learning, split="train")
    (batch,) = DataLoader(specimens, batch_size=2, num_workers=2)
    assert batch["oct"].shape == (2, 16, 512, 512)
    assert batch["oct"].dtype == batch["endoscope"].dtype == torch.uint8
    assert batch["endoscope"].shape == (2, 16, 240, 320, 3)
    assert batch["relief_mm"].shape == batch["cell"].shape == batch["cell_id"].shape
    folder = learning / specimens.rows[1]["path"]
    frame = cv2.imread(str(folder / "endoscope" / "frame_0003.png"))
    assert frame is not None
    assert np.array_equal(batch["endoscope"][1, 3].numpy(), frame[..., ::-1])
    with xr.open_zarr(folder / "truth" / "wall.zarr") as wall:
        n_z = batch["cell"].shape[1]
        assert np.array_equal(batch["cell"][1].numpy(), wall["cell"].values[:n_z])
        recording = json.loads((folder / "truth" / "recording.json").read_text())
        assert wall["z"].values[n_z - 1] > max(*recording["oct"]["z_mm"], *recording["endoscope"]["z_mm"])
    assert batch["cell"].any()


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shards")
    make_dataset(
        folder / "set",
        DatasetPlan(11, format="webdataset", specimens_per_shard=4),
        workers=1,
        make=Cheap(folder / "log"),
    )
    return folder / "set"


def test_shards_load_with_webdataset(shards: Path) -> None:
    assert sorted(path.name for path in (shards / "shards").iterdir()) == [
        "test-000000.tar",
        "train-000000.tar",
        "train-000001.tar",
        "train-000002.tar",
        "validation-000000.tar",
    ]
    urls = str(shards / "shards" / "train-{000000..000002}.tar")
    stream = (
        webdataset.WebDataset(urls, shardshuffle=False)
        .decode()
        .to_tuple("__key__", "oct.npy", "cell.npy", "sample.json")
    )
    found = list(DataLoader(stream, batch_size=None, num_workers=1))
    train = [row["name"] for row in rows(shards) if row["split"] == "train"]
    assert [name for name, *_ in found] == train
    by_index = Specimens(shards, split="train")
    for (_, oct_, cell, sample), specimen, row in zip(found, by_index, by_index.rows, strict=True):
        assert np.array_equal(oct_, specimen["oct"])
        assert np.array_equal(np.asarray(cell)[: len(specimen["cell"])], specimen["cell"])
        assert repr(sample["oct"]["wall_db"]) == row["oct.wall_db"]


def test_a_specimen_of_a_shard_is_the_one_of_a_folder(learning: Path, tmp_path: Path) -> None:
    options = ("--recordings-per-bore", 2, "--vary", "oct.wall_db=18..19", "--vary", "oct.scan=helical")
    root = tmp_path / "set"
    assert endoct("dataset", "-o", root, "--count", 1, "--workers", 1, "--format", "webdataset", *options) == 0
    ((row,), (wanted, _)) = rows(root), rows(learning)
    assert row["digest"] == wanted["digest"]
    read, from_folder = Specimens(root)[0], Specimens(learning)[0]
    assert read.keys() == from_folder.keys()
    assert np.array_equal(read["oct"], from_folder["oct"])
    assert np.array_equal(read["endoscope"], from_folder["endoscope"])


def test_what_is_no_finished_set_is_refused(tmp_path: Path, learning: Path) -> None:
    with pytest.raises(EndoctError, match="no finished data set"):
        Specimens(tmp_path)
    with pytest.raises(EndoctError, match="no split 'val'"):
        Specimens(learning, split=cast(Split, "val"))


@pytest.mark.slow
def test_a_specimen_can_be_replayed(learning: Path, tmp_path: Path) -> None:
    (row, _) = rows(learning)
    folder = learning / row["path"]
    simulate(tmp_path / "again", replay=folder / "truth" / "sample.json")
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert len(files) > 10
    assert all((tmp_path / "again" / path.relative_to(folder)).read_bytes() == path.read_bytes() for path in files)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--count", 0),
        ("--count", 1, "--vary", "oct.wall_db"),
        ("--count", 1, "--workers", 0),
        ("--count", 1, "--workers", 2, "--scheduler", "tcp://127.0.0.1:1"),
    ],
)
def test_wrong_arguments_leave_nothing(arguments: tuple[object, ...], tmp_path: Path) -> None:
    assert endoct("dataset", "-o", tmp_path / "set", *arguments) == 1
    assert not (tmp_path / "set").exists()
