"""Every type of samples, in every layout that a reader returns, is unrolled and pictured: from file to report."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from endoct.fusion.files.result_file import read_result
from endoct.modalities.contract import Frame, Picture
from endoct.modalities.oct.plugin import OCT
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench.pipeline.comparing import compare_sources, store_side
from endoct.workbench.pipeline.unrolling import save_sample_frames, unroll_source
from endoct.workbench.report.figures.frames import draw_frames
from endoct.workbench.report.pictures import PICTURES, load_pictures
from endoct.workbench.report.side_findings import recording_in
from endoct.workbench.requests import CompareRequest, UnrollRequest
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.running.scheduler import ALONE
from endoct.workbench.sides.recordings import open_recording, unroll_recording

TYPES = ("u1", "u2", "i1", "i2", "i4", "u4", "i8", "f2", "f8", ">u2", ">i2")
LAYOUTS = (("u1", 1), ("u2", 2), ("i2", 3), (">i2", 4), ("f4", 3), ("f8", 4))
"""A type each, and grey, grey with transparency, colours, colours with transparency."""
N_FRAMES = 6


@pytest.fixture(scope="module")
def levels(short: Path) -> NDArray[np.int64]:
    """B-scans as levels from −100 to 100, (slice, depth, A-scan): they fit into every type with a sign."""
    stored = tifffile.imread(short / "oct" / "pullback.tif")[:N_FRAMES, :, ::4].astype(np.float64)
    return np.rint(200 * (stored - stored.min()) / np.ptp(stored) - 100).astype(np.int64)


def recorded(folder: Path, specimen: Path, part: str) -> Path:
    folder.mkdir()
    shutil.copy(specimen / part / "acquisition.toml", folder)
    return folder


def through(folder: Path, store: Path) -> Panorama:
    """Unroll a recording, make its pictures, and draw them as the report does."""
    unrolled = unroll_recording(open_recording(folder), SilentStages())
    panorama = unrolled.panorama
    assert save_sample_frames(unrolled, store, panorama.modality) == ()
    side = recording_in(store, panorama)
    assert len(side.pictures) == 3
    assert draw_frames(side) is not None
    return panorama


@pytest.fixture(scope="module")
def as_float(short: Path, levels: NDArray[np.int64], tmp_path_factory: pytest.TempPathFactory) -> Panorama:
    folder = tmp_path_factory.mktemp("float")
    np.save(recorded(folder / "oct", short, "oct") / "p.npy", levels.astype(np.float32))
    return through(folder / "oct", folder / "x.zarr")


@pytest.mark.parametrize("dtype", TYPES)
def test_bscans_of_any_type_come_to_the_same(
    dtype: str, short: Path, levels: NDArray[np.int64], as_float: Panorama, tmp_path: Path
) -> None:
    folder = recorded(tmp_path / "oct", short, "oct")
    stored = (levels + (100 if "u" in dtype else 0)).astype(dtype)
    if dtype in ("i8", "f2"):
        np.save(folder / "p.npy", stored)
    else:
        order = ">" if dtype[0] == ">" else "<"
        tifffile.imwrite(folder / "p.tif", stored, photometric="minisblack", byteorder=order, metadata=None)
    panorama = through(folder, tmp_path / "x.zarr")
    assert panorama.depth_mm is not None
    assert as_float.depth_mm is not None
    if "u" not in dtype:  # the very numbers
        np.testing.assert_array_equal(panorama.depth_mm, as_float.depth_mm)
        np.testing.assert_array_equal(panorama.intensity, as_float.intensity)
    else:
        apart = np.abs(panorama.depth_mm - as_float.depth_mm)[panorama.valid & as_float.valid]
        assert np.quantile(apart, 0.95) < 0.005


@pytest.mark.parametrize(("dtype", "colours"), LAYOUTS)
def test_frames_of_any_type_in_any_layout(dtype: str, colours: int, short: Path, tmp_path: Path) -> None:
    folder = recorded(tmp_path / "endoscope", short, "endoscope")
    scale = {"u2": 257, "i2": 128, ">i2": 128, "f4": 1 / 255, "f8": 1 / 255}.get(dtype, 1)
    for k, path in enumerate(sorted((short / "endoscope").glob("frame_*"))[:N_FRAMES]):
        frame = np.asarray(cv2.imread(str(path)))[::2, ::2, ::-1].astype(np.float64)
        planes = [frame.mean(axis=2)] if colours < 3 else list(np.moveaxis(frame, -1, 0))
        planes += [np.full(frame.shape[:2], 255.0)] * (colours in (2, 4))
        stored = np.squeeze((np.stack(planes, axis=-1) * scale).astype(dtype))
        more: dict[str, Any] = {"extrasamples": ["unassalpha"], "planarconfig": "contig"} if colours in (2, 4) else {}
        grey, order = "minisblack" if colours < 3 else "rgb", ">" if ">" in dtype else "<"
        tifffile.imwrite(folder / f"{k:03d}.tif", stored, photometric=grey, byteorder=order, metadata=None, **more)
    assert through(folder, tmp_path / "x.zarr").valid.mean() > 0.9


@pytest.mark.usefixtures("without_report")
def test_a_picture_that_fails_costs_no_panorama(
    short: Path, levels: NDArray[np.int64], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = recorded(tmp_path / "oct", short, "oct")
    np.save(folder / "p.npy", levels.astype(np.float32))
    drawn = type(OCT).illustrate

    def illustrate(self: Any, frame: Frame, calibration: Any) -> tuple[Picture, ...]:
        if frame.index == 1:
            raise ValueError("no such colour")
        pictures = drawn(frame, calibration)
        return (replace(pictures[0], image=pictures[0].image.astype(np.int32)),) if frame.index == 2 else pictures

    monkeypatch.setattr(type(OCT), "illustrate", illustrate)
    panorama = unroll_source(UnrollRequest(folder), tmp_path / "x.zarr", SilentStages(), ALONE)
    assert (tmp_path / "x.zarr" / "report.html").is_file()
    stored = load_panorama(tmp_path / "x.zarr")
    assert stored.notes == panorama.notes
    assert [note for note in panorama.notes if "no picture of slice 1" in note and "no such colour" in note]
    assert [note for note in panorama.notes if "no picture of slice 2" in note and "int32" in note]
    assert set(load_pictures(tmp_path / "x.zarr" / PICTURES)["oct"]) == {4}
    (tmp_path / "of_both").mkdir()
    side = unroll_recording(open_recording(folder), SilentStages())
    assert len(store_side(tmp_path / "of_both", "oct", side.panorama, side)) == 2
    assert load_panorama(tmp_path / "of_both" / "panoramas" / "oct.zarr").notes == panorama.notes
    cells = np.zeros(side.panorama.grid.shape, np.uint8)
    cells[1:4, 100:300] = 255
    cv2.imwrite(str(tmp_path / "drawn.png"), cells)
    request = CompareRequest(folder, tmp_path / "drawn.png", settings={"n_theta": 512})
    compare_sources(request, tmp_path / "compared", SilentStages(), ALONE)
    assert read_result(tmp_path / "compared").notes["oct"] == panorama.notes
