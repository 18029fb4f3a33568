"""What `endoct export` reads and replaces, and what it says."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from marked_wall import PLACES, write_marked, write_marked_comparison

from endoct.base.errors import EndoctError
from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.workbench import cli, export, verify
from endoct.workbench.exporting.formats import FORMATS, format_for
from endoct.workbench.exporting.mark import is_marked
from endoct.workbench.exporting.napari_reader import reader_of


@pytest.fixture(scope="module")
def panorama(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_marked(tmp_path_factory.mktemp("panoramas") / "wall.zarr", PLACES[0], dtype="uint8")


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_marked_comparison(tmp_path_factory.mktemp("comparisons") / "result", PLACES[0])


def of_each_format(panorama: Path, comparison: Path) -> dict[str, tuple[Path, str]]:
    """Return for every format what to export, and the name of a file."""
    of_comparison = ("itk-transform", "labels")
    names = {name: f"x{one.suffixes[0]}" for name, one in FORMATS.items()}
    return {name: (comparison if name in of_comparison else panorama, names[name]) for name in FORMATS}


@pytest.mark.parametrize("name", list(FORMATS))
def test_only_what_endoct_wrote_is_replaced(name: str, panorama: Path, comparison: Path, tmp_path: Path) -> None:
    if name == "dicom":
        pytest.importorskip("highdicom", reason="highdicom is not installed: pip install 'endoct[dicom]'")
    source, file = of_each_format(panorama, comparison)[name]
    output, chosen = tmp_path / file, FORMATS[name]  # type: ignore[index]
    options = {"voxel_mm": 0.1} if "voxel_mm" in chosen.options else {}
    export(source, output, to=name, **options)  # type: ignore[arg-type]
    with pytest.raises(EndoctError, match="exists already"):
        export(source, output, to=name)  # type: ignore[arg-type]
    if not chosen.is_marked:
        with pytest.raises(EndoctError, match="cannot say that endoct wrote it"):
            export(source, output, to=name, overwrite=True)  # type: ignore[arg-type]
        return
    assert verify(output)[0].intact
    export(source, output, to=name, overwrite=True, **options)  # type: ignore[arg-type]
    changed = output if output.is_file() else min(output.glob("*.dcm"), default=output / "zarr.json")
    data = bytearray(changed.read_bytes())
    data[-1] ^= 1
    changed.write_bytes(data)
    assert not verify(output)[0].intact
    with pytest.raises(EndoctError, match=r"not written by endoct, or changed since|holds more than endoct wrote"):
        export(source, output, to=name, overwrite=True)  # type: ignore[arg-type]
    assert changed.read_bytes() == data
    assert sorted(path.name for path in tmp_path.iterdir()) == [output.name]


def test_nothing_is_written_into_or_over_what_is_read(panorama: Path, comparison: Path) -> None:
    for source, output in (
        (panorama, panorama / "x.ply"),
        (panorama, panorama),
        (comparison, comparison / "x.ply"),
        (comparison / "comparison.zarr", comparison / "x.ply"),
    ):
        with pytest.raises(EndoctError, match=r"(is|is or contains|lies inside) the input|is or contains"):
            export(source, output, to="ome-zarr" if output == panorama else "ply", overwrite=True)
    assert verify(panorama)[0].intact
    assert verify(comparison)[0].intact


def test_an_export_that_fails_leaves_nothing(panorama: Path, tmp_path: Path) -> None:
    damaged = Path(shutil.copytree(panorama, tmp_path / "wall.zarr"))
    chunk = sorted(path for path in (damaged / "volume" / "intensity" / "c").rglob("*") if path.is_file())[-1]
    chunk.unlink()
    with pytest.raises(EndoctError, match="is not whole"):
        export(damaged, tmp_path / "out" / "v.nrrd", voxel_mm=0.1)
    assert [path.name for path in tmp_path.iterdir()] == ["wall.zarr"]


def test_the_format_is_that_of_the_suffix_where_it_says_one() -> None:
    for name, expected in (
        ("x.ome.zarr", "ome-zarr"),
        ("x.OME.TIFF", "ome-tiff"),
        ("x.nii.gz", "nifti"),
        ("x.tfm", "itk-transform"),
    ):
        assert format_for(None, Path(name)).name == expected
    assert format_for("labels", Path("x.tif")).name == "labels"
    with pytest.raises(EndoctError, match="does not say which format it is"):
        format_for(None, Path("x.obj"))
    with pytest.raises(EndoctError, match=r"a file of ply cannot be called x\.stl; expected NAME\.ply"):
        format_for("ply", Path("x.stl"))
    with pytest.raises(EndoctError, match="there is no format 'obj'"):
        format_for("obj", Path("x.obj"))


def test_the_truth_of_a_specimen_is_exported_too(tmp_path: Path) -> None:
    wall = tmp_path / "specimen" / "truth" / "wall.zarr"
    wall.parent.mkdir(parents=True)
    ids = np.zeros((50, 90), np.int32)
    ids[10:20, 30:40] = 7
    arrays = {
        "relief_mm": Named(("z", "theta"), np.where(ids, 0.3, 0).astype(np.float32)),
        "cell_id": Named(("z", "theta"), ids),
        "z": Named(("z",), 0.1 * np.arange(50)),
    }
    write_arrays(wall, arrays, {"bore_radius_mm": 1.25})
    for path in (tmp_path / "specimen", tmp_path / "specimen" / "truth", wall):
        exported = export(path, tmp_path / "truth.tif", to="labels", overwrite=True)
    import tifffile

    np.testing.assert_array_equal(tifffile.imread(tmp_path / "truth.tif"), ids)
    assert "frame of the bore" in exported.notes[0]
    with pytest.raises(EndoctError, match="lies inside the input"):
        export(wall, tmp_path / "specimen" / "truth" / "x.ply")


def test_what_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    with pytest.raises(EndoctError, match="cannot be exported; found neither"):
        export(tmp_path / "thesis", tmp_path / "x.ply")
    with pytest.raises(EndoctError, match="cannot be exported; found no such"):
        export(tmp_path / "nowhere", tmp_path / "x.ply")
    store = write_marked(tmp_path / "wall.zarr", PLACES[0])
    with pytest.raises(EndoctError, match="has no cells; found a panorama"):
        export(store, tmp_path / "x.tif", to="labels")


def test_the_command_says_what_it_wrote(
    panorama: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*arguments: str) -> tuple[int | str | None, str, str]:
        monkeypatch.setattr(sys, "argv", ["endoct", "export", str(panorama), *arguments])
        with pytest.raises(SystemExit) as leave:
            cli.main()
        return leave.value.code, *capsys.readouterr()

    status, said, _ = run("-o", str(tmp_path / "w.ply"), "--vertex-mm", "0.1")
    assert not status
    assert said.startswith(f"ply: {tmp_path}/w.ply (")
    assert is_marked(tmp_path / "w.ply")
    status, said, _ = run("--to", "nrrd", "-o", str(tmp_path / "v.nrrd"), "--voxel-mm", "0.1", "--json")
    facts = json.loads(said)
    assert (facts["format"], facts["space"], facts["step_mm"][0]) == ("nrrd", "LPS: x, y and z of the bore frame", 0.1)
    status, _, error = run("-o", str(tmp_path / "w.ply"))
    assert status == 1
    assert error.count("\n") == 1
    assert "--overwrite" in error
    status, _, _ = run("--to", "obj", "-o", str(tmp_path / "w.obj"))
    assert status == 2


def test_napari_gets_layers_in_mm_and_only_of_what_is_endocts(panorama: Path, comparison: Path, tmp_path: Path) -> None:
    read = reader_of(str(panorama))
    assert read is not None
    (image, relief) = read(str(panorama))
    assert [one[2] for one in (image, relief)] == ["image", "image"]
    data, display, _ = image
    step_mm, at = np.array(display["scale"]), np.array(display["translate"])
    row, column = np.unravel_index(np.nanargmax(data[0]), data[0].shape)
    z_mm, arc_mm = at + step_mm * (row, column)
    assert abs(z_mm - PLACES[0].z_mm) <= step_mm[0]
    assert abs(arc_mm / 1.25 - PLACES[0].theta_rad) * 1.25 <= step_mm[1]
    of_comparison = reader_of(str(comparison / "comparison.zarr"))
    assert of_comparison is not None
    kinds = [(one[1]["name"], one[2]) for one in of_comparison(str(comparison / "comparison.zarr"))]
    assert kinds[-2:] == [("endoscope cells", "labels"), ("oct cells", "labels")]
    assert reader_of(str(tmp_path)) is None
    assert reader_of([str(panorama)]) is None


@pytest.mark.parametrize("name", ["ome-zarr", "ome-tiff", "ply"])
def test_a_full_disk_is_told_and_nothing_left(name: str, comparison: Path, small_disk: Path) -> None:
    (small_disk / "thesis.tex").write_bytes(bytes(shutil.disk_usage(small_disk).free - 24_000))
    for _ in range(5):
        with pytest.raises(EndoctError, match=r"failed; found (No space left on device|the disk took only)"):
            export(comparison, small_disk / f"x{FORMATS[name].suffixes[0]}", to=name)  # type: ignore[arg-type, index]
        assert [path.name for path in small_disk.iterdir()] == ["thesis.tex"]


def test_a_version_that_there_is_not_is_refused(panorama: Path, tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="no such version of OME-Zarr"):
        export(panorama, tmp_path / "x.ome.zarr", to="ome-zarr", version="0.3")  # type: ignore[arg-type]
    assert not (tmp_path / "x.ome.zarr").exists()
