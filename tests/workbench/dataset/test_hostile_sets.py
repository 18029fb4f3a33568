"""Data sets that were damaged or made up: their paths stay inside, their arrays within bounds, the rest is one line."""

import csv
import io
import json
import shutil
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.dataset import Specimens
from endoct.workbench.dataset.loader import read_from_shard, read_specimen
from endoct.workbench.pipeline.truth import Truth, load_truth, true_cells, true_pose

ROW = {"index": "0", "name": "s000000", "split": "train", "path": "s000000", "bore.length_mm": "5.0"}


def write_set(root: Path, **changed: str) -> Path:
    root.mkdir(exist_ok=True)
    with (root / "manifest.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [*ROW])
        writer.writeheader()
        writer.writerow({**ROW, **changed})
    (root / "dataset.json").write_text(json.dumps({"arguments": {"preset": "learning"}}))
    return root


@pytest.fixture(scope="module")
def specimen(small_specimen: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set") / "s000000"
    return Path(shutil.copytree(small_specimen, folder, ignore=shutil.ignore_patterns("labels")))


@pytest.mark.parametrize("path", ["../x", "/etc", "", ".", "a/../../x"])
def test_specimens_lie_inside_their_set(path: str, tmp_path: Path) -> None:
    with pytest.raises(EndoctError):
        Specimens(write_set(tmp_path / "set", path=path))[0]


@pytest.mark.parametrize(
    "changed", [{"bore.length_mm": "nan"}, {"bore.length_mm": "x"}, {"bore.length_mm": "-1"}, {"index": "x"},
                {"name": "../x"}, {"split": "none"}],
)  # fmt: skip
def test_manifests_that_cannot_be(changed: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="no finished data set"):
        Specimens(write_set(tmp_path / "set", **changed))


@pytest.mark.parametrize(
    "text", ["{}", "[]", '{"arguments": {"preset": "x"}}', '{"arguments": {"preset": []}}', "[" * 10**5]
)
def test_sets_of_an_unknown_kind(text: str, tmp_path: Path) -> None:
    root = write_set(tmp_path / "set")
    (root / "dataset.json").write_text(text)
    with pytest.raises(EndoctError, match="no finished data set"):
        Specimens(root)
    write_set(root)
    (root / "manifest.csv").write_text("index,name\n0\n0,a,b,c\n")
    with pytest.raises(EndoctError, match="no finished data set"):
        Specimens(root)


def test_a_specimen_is_no_link(specimen: Path, tmp_path: Path) -> None:
    root = write_set(tmp_path / "set")
    (root / "s000000").symlink_to(specimen)
    with pytest.raises(EndoctError, match="a link"):
        Specimens(root)[0]


def test_a_specimen_that_lost_a_part(specimen: Path, tmp_path: Path) -> None:
    assert read_specimen(specimen).keys() == {"oct", "endoscope", "relief_mm", "cell", "cell_id"}
    for part in ("truth/wall.zarr/cell/c", "truth/wall.zarr/cell", "oct", "endoscope", "truth"):
        shutil.copytree(specimen, tmp_path / "s")
        shutil.rmtree(tmp_path / "s" / part)
        with pytest.raises(EndoctError) as refused:
            read_specimen(tmp_path / "s")
        assert "\n" not in str(refused.value)
        shutil.rmtree(tmp_path / "s")


def shard(path: Path, **members: bytes) -> Path:
    with tarfile.open(path, "w") as tar:
        for name, data in members.items():
            info = tarfile.TarInfo(f"s.{name}.npy")
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))
    return path


def npy(values: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, values, allow_pickle=True)
    return file.getvalue()


def test_shards(tmp_path: Path) -> None:
    good = shard(tmp_path / "a.tar", oct=npy(np.arange(3)))
    assert read_from_shard(good, "s")["oct"].tolist() == [0, 1, 2]
    huge = npy(np.zeros(3, np.uint8)).replace(b"(3,), }" + b" " * 10, b"(99999999999,), }"[:17])
    for data in (npy(np.array([{}], object)), npy(np.zeros(9))[:-1], b"", huge):
        with pytest.raises(EndoctError):
            read_from_shard(shard(tmp_path / "b.tar", oct=data), "s")
    with pytest.raises(EndoctError, match="name of an array"):
        read_from_shard(shard(tmp_path / "c.tar", **{"../x": npy(np.zeros(3))}), "s")
    whole = good.read_bytes()
    for count in (1, 300, 520):
        (tmp_path / "d.tar").write_bytes(whole[:count])
        with pytest.raises(EndoctError):
            read_from_shard(tmp_path / "d.tar", "s")
    with tarfile.open(tmp_path / "e.tar.gz", "w:gz") as tar:
        tar.add(good, "s.oct.npy")
    with pytest.raises(EndoctError):
        read_from_shard(tmp_path / "e.tar.gz", "s")
    with tarfile.open(tmp_path / "f.tar", "w") as tar:
        link = tarfile.TarInfo("s.oct.npy")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        tar.addfile(link)
    assert read_from_shard(tmp_path / "f.tar", "s") == {}


GRID = SurfaceGrid.full_circle(16, 32, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)


def panorama(modality: str, **per_frame: Any) -> Panorama:
    frames = {"frame_index": np.arange(16), "frame_z_mm": 0.2 * np.arange(16), "roll_rad": np.zeros(16)}
    return Panorama(
        GRID, np.ones(GRID.shape), None, np.ones(GRID.shape, np.bool_), np.ones(GRID.shape), modality, True,
        True, "frame", {**frames, **per_frame}, {"acquisition": {"handedness": "same"}},
    )  # fmt: skip


@pytest.mark.parametrize("modality", ["oct", "endoscope"])
@pytest.mark.parametrize(
    "hostile", [None, 5, "x", [], {}, float("nan"), 1e308, [[1]], ["a"] * 16, [None] * 16, 10**400]
)
def test_any_damage_of_the_truth_is_one_line(modality: str, hostile: Any, specimen: Path) -> None:
    truth = load_truth(specimen)
    of = truth.recording[modality]
    side = panorama(modality)
    assert true_cells(truth, true_pose(side, truth), side).shape == GRID.shape
    broken = [{**truth.recording, modality: hostile}, *({**truth.recording, modality: {**of, k: hostile}} for k in of)]
    broken += [{**truth.recording, modality: {n: v for n, v in of.items() if n != k}} for k in of]
    for recording in broken:
        damaged = Truth(truth.wall, recording)
        try:
            true_cells(damaged, true_pose(side, damaged), side)
        except EndoctError as error:
            assert "\n" not in str(error)  # noqa: PT017


@pytest.mark.parametrize(
    "damage",
    [
        lambda t: (t / "recording.json").write_text("{"),
        lambda t: (t / "recording.json").write_text("[]"),
        lambda t: (t / "recording.json").write_bytes(b"\xff\xfe\x00"),
        lambda t: (t / "wall.zarr" / "zarr.json").unlink(),
        lambda t: shutil.rmtree(t / "wall.zarr" / "cell"),
        lambda t: shutil.rmtree(t / "wall.zarr" / "cell_id" / "c"),
        lambda t: shutil.copytree(t / "wall.zarr" / "theta", t / "wall.zarr" / "z", dirs_exist_ok=True),
    ],
)
def test_a_truth_that_cannot_be_read(damage: Callable[[Path], object], specimen: Path, tmp_path: Path) -> None:
    shutil.copytree(specimen, tmp_path / "s")
    damage(tmp_path / "s" / "truth")
    with pytest.raises(EndoctError) as refused:
        load_truth(tmp_path / "s")
    assert "\n" not in str(refused.value)
