"""A recording unrolled from its path, with the digests of its files."""

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from endoct.base.errors import EndoctError
from endoct.base.files.files import digests
from endoct.modalities.contract import FrameStream
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.recognition import Recognised
from endoct.workbench import unroll
from endoct.workbench.pipeline.information import describe
from endoct.workbench.running.progress import SilentStages
from endoct.workbench.sides.recordings import _travel_by_default, open_recording, unroll_recording


def test_a_path_unrolls_as_an_opened_recording(short: Path) -> None:
    path = short / "oct"
    by_path = unroll(path, progress=False)
    opened = unroll_recording(open_recording(path), SilentStages()).panorama
    assert by_path.depth_mm is not None
    assert opened.depth_mm is not None
    assert by_path.depth_mm.tobytes() == opened.depth_mm.tobytes()
    assert by_path.intensity.tobytes() == opened.intensity.tobytes()
    assert by_path.provenance == opened.provenance
    assert by_path.provenance["inputs"] == digests(path)


def test_a_path_that_cannot_be_opened_leaves_no_thread(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"1")
    before = threading.active_count()
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(EndoctError):
            unroll(path, progress=False)
        assert threading.active_count() == before


def test_what_changes_as_a_path_is_opened_is_noticed(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for file in (short / "oct").iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())

    def changed(recognised: Recognised, *how: Any) -> FrameStream:
        with (recognised.path / "acquisition.toml").open("a") as sidecar:
            sidecar.write("\n")
        return opened(recognised, *how)

    opened = Recognised.open
    monkeypatch.setattr(Recognised, "open", changed)
    with pytest.raises(EndoctError, match="was changed while it was read"):
        unroll(tmp_path, progress=False)


def test_what_files_leave_open_reaches_the_panorama(short: Path, tmp_path: Path) -> None:
    pages = tifffile.imread(next((short / "oct").glob("*.tif")))
    (tmp_path / "acquisition.toml").write_bytes((short / "oct" / "acquisition.toml").read_bytes())
    for k, page in enumerate(pages):
        written = pages[3] if k == 5 else page  # the grabber gave one slice twice
        tifffile.imwrite(tmp_path / f"slice_{k:03d}.tif", written, compression="zlib" if k == 5 else None)
    (tmp_path / "slice_002 (1).tif").write_bytes((tmp_path / "slice_002.tif").read_bytes())
    panorama = unroll(tmp_path, settings={"n_theta": 512}, progress=False)
    assert panorama.grid.n_z == len(pages)
    (doubt,) = [doubt for doubt in panorama.doubts if doubt.code == "frames-repeated"]
    assert "5 as 3" in doubt.what
    assert any("slice_002 (1).tif" in note for note in panorama.notes)
    assert any("slice_002 (1).tif" in note for note in describe(tmp_path)["notes"])


def test_a_recording_is_unrolled_by_the_method_that_is_chosen(short: Path) -> None:
    ours = unroll(short / "endoscope", progress=False)
    theirs = unroll(short / "endoscope", settings={"feed_method": "cross-correlation-prepared"}, progress=False)
    assert [doubt.code for doubt in theirs.doubts if doubt.code == "feed-by-method"] == ["feed-by-method"]
    assert theirs.provenance["parameters"]["feed_method"] == "cross-correlation-prepared"
    assert np.ptp(theirs.z_mm) == pytest.approx(np.ptp(ours.z_mm), rel=0.05)
    with pytest.raises(EndoctError, match="unknown stitching method: 'ashlr'"):
        unroll(short / "endoscope", settings={"feed_method": "ashlr"}, progress=False)


@pytest.mark.parametrize(
    ("stated", "by_default"), [({}, {"travel_by_default": "out"}), ({"travel": "out"}, {}), ({"travel": "unknown"}, {})]
)
def test_travel_that_nothing_states_is_a_default(stated: dict[str, str], by_default: dict[str, str]) -> None:
    keys = {"modality": "oct", "axial_pixel_mm": 0.005, "pullback_pitch_mm": 0.2, "bore_diameter_mm": 2.5}
    assert dict(_travel_by_default(OctAcquisition(**keys, capillary_outer_diameter_mm=1.7, **stated))) == by_default
