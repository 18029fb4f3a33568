"""One pullback in every container: the same frames to the bit, the keys its files state, the same panorama."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import zarr
from numpy.typing import NDArray

from benchmarks.fuzz.dicom_writer import ivoct, write
from endoct.modalities.reading.recording import open_stack
from endoct.modalities.recognition import open_recording
from endoct.workbench import unroll
from endoct.workbench.pipeline.information import describe

SIZES = ("bore_diameter_mm", "capillary_outer_diameter_mm")
DEPTH = ("axial_pixel_mm", "pullback_pitch_mm")


def _dicom(bscans: NDArray[np.uint8], keys: dict[str, Any], folder: Path) -> tuple[str, ...]:
    # turned and padded, as a console's frames may be
    polar = np.roll(bscans.transpose(0, 2, 1), 17, axis=1)
    padded = np.concatenate([polar, np.full_like(polar[:, :5], 200)], axis=1)
    step = -keys["pullback_pitch_mm"]
    per_frame = [{"distance": step if k else 0.0, "seam": 17, "padded": 5} for k in range(len(bscans))]
    header = {"ALinePixelSpacing": keys["axial_pixel_mm"], "CatheterDirectionOfRotation": "CC"}
    write(ivoct(padded, per_frame=per_frame, **header), folder / "pullback.dcm")
    return (*DEPTH, "modality", "travel", "handedness", "intensity")


def _ome_tiff(bscans: NDArray[np.uint8], keys: dict[str, Any], folder: Path) -> tuple[str, ...]:
    metadata = {
        "axes": "ZYX",
        "PhysicalSizeZ": keys["pullback_pitch_mm"] * 1000,
        "PhysicalSizeY": keys["axial_pixel_mm"],
    }
    metadata |= {"PhysicalSizeYUnit": "mm"}
    tifffile.imwrite(folder / "a.ome.tif", bscans, ome=True, photometric="minisblack", metadata=metadata)
    return DEPTH


def _ome_zarr(bscans: NDArray[np.uint8], keys: dict[str, Any], folder: Path) -> tuple[str, ...]:
    group = zarr.open_group(folder / "a.ome.zarr", mode="w", zarr_format=3)
    group.create_array("0", data=bscans, chunks=(1, 256, 512))
    axes = [{"name": name, "type": "space", "unit": "millimeter"} for name in "zyx"]
    scale = [{"type": "scale", "scale": [keys["pullback_pitch_mm"], keys["axial_pixel_mm"], 1.0]}]
    listed = [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": scale}]}]
    group.attrs.update({"ome": {"version": "0.5", "multiscales": listed}})
    return DEPTH


def _lightlab(bscans: NDArray[np.uint8], keys: dict[str, Any], folder: Path) -> tuple[str, ...]:
    pages = bscans.transpose(0, 2, 1).astype(np.uint16)
    tifffile.imwrite(folder / "pullback.oct", pages, photometric="minisblack", metadata=None)
    return ("modality", "intensity")


@pytest.fixture(scope="module")
def pullback(short: Path) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    keys = tomllib.loads((short / "oct" / "acquisition.toml").read_text())
    return tifffile.imread(short / "oct" / "pullback.tif"), keys


def _sidecar(folder: Path, keys: dict[str, Any], without: tuple[str, ...]) -> None:
    lines = [f"{key} = {keys[key]!r}\n".replace("'", '"') for key in keys if key not in without]
    (folder / "acquisition.toml").write_text("".join(lines))


@pytest.mark.parametrize("container", [_dicom, _ome_tiff, _ome_zarr, _lightlab])
def test_every_container_gives_the_same_frames_and_needs_fewer_keys(
    container: Callable[..., tuple[str, ...]], pullback: tuple[NDArray[np.uint8], dict[str, Any]], tmp_path: Path
) -> None:
    bscans, keys = pullback
    stated = container(bscans, keys, tmp_path)
    _sidecar(tmp_path, keys, stated)
    stack = open_stack(tmp_path)
    for k in range(len(bscans)):
        np.testing.assert_array_equal(stack[k], bscans[k])
    _, stream = open_recording(tmp_path)
    found = stream.acquisition.model_dump()
    for key in DEPTH:
        assert found[key] == pytest.approx(keys[key], rel=1e-6)
    facts = describe(tmp_path)
    assert (facts["kind"], facts["modality"], "missing" in facts) == ("recording", "oct", False)
    assert not facts["doubts"]


def test_a_console_needs_a_sidecar_for_bore_and_capillary_only(
    pullback: tuple[NDArray[np.uint8], dict[str, Any]], short: Path, tmp_path: Path
) -> None:
    bscans, keys = pullback
    for name in ("dicom", "tiff"):
        (tmp_path / name).mkdir()
    _dicom(bscans, keys, tmp_path / "dicom")
    missing = describe(tmp_path / "dicom")["missing"]
    assert isinstance(missing, dict)
    assert tuple(missing) == SIZES
    _sidecar(tmp_path / "dicom", keys, tuple(key for key in keys if key not in SIZES))
    tifffile.imwrite(tmp_path / "tiff" / "pullback.tif", bscans, photometric="minisblack")
    _sidecar(tmp_path / "tiff", keys | {"travel": "in", "handedness": "mirrored"}, ())
    by_console, by_hand = (
        unroll(tmp_path / name, settings={"n_theta": 512}, progress=False) for name in ("dicom", "tiff")
    )
    assert by_console.depth_mm is not None
    assert by_hand.depth_mm is not None
    assert by_console.depth_mm.tobytes() == by_hand.depth_mm.tobytes()
    assert by_console.intensity.tobytes() == by_hand.intensity.tobytes()
    assert by_console.valid.tobytes() == by_hand.valid.tobytes()
