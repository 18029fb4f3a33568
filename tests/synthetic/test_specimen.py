"""What a simulated specimen leaves on disk, and that it can be had again."""

import hashlib
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
import xarray as xr
from tolerances import COUNTS_BY_ROUNDING

from endoct.base.errors import EndoctError
from endoct.synthetic.sample.presets import PRESETS, Preset
from endoct.synthetic.specimen import SPECIMEN_VERSION, simulate

OCT_KEYS = {
    "modality", "axial_pixel_mm", "pullback_pitch_mm", "bore_diameter_mm", "capillary_outer_diameter_mm", "travel",
    "handedness", "intensity", "db_per_count", "scan", "medium_index", "first_sample_mm",
}  # fmt: skip
ENDOSCOPE_KEYS = {
    "modality", "bore_diameter_mm", "feed_pitch_mm", "visible_length_mm", "outer_rim", "travel", "annulus",
    "cone_half_angle_deg", "focal_px", "mirror_distance_mm", "distortion",
}  # fmt: skip


TINY = Preset(n_slices=4, n_ascans=1000, ascans_per_column=2, n_frames=3, n_depth=512)
"""A few frames, with an oversampled turn as `paper` has."""


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """A preset of a few frames in the place of `quick`."""
    monkeypatch.setitem(PRESETS, "quick", TINY)  # type: ignore[index]


@dataclass(frozen=True)
class TinySpecimen:
    """A specimen of seed 3, made by one thread, and what was said of its progress."""

    folder: Path
    progress: list[tuple[str, float]]

    @property
    def sample(self) -> dict[str, Any]:
        """Return its sample.json."""
        sample: dict[str, Any] = json.loads((self.folder / "truth/sample.json").read_text(encoding="utf-8"))
        return sample


@pytest.fixture(scope="module")
def tiny_specimen(tmp_path_factory: pytest.TempPathFactory) -> TinySpecimen:
    made = TinySpecimen(tmp_path_factory.mktemp("tiny") / "one", [])
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "quick", TINY)  # type: ignore[index]
        simulate(made.folder, seed=3, workers=1, on_progress=lambda stage, done: made.progress.append((stage, done)))
    return made


def digests(folder: Path) -> dict[str, str]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_same_seed_gives_same_bytes_for_any_number_of_threads(
    tiny: None, tiny_specimen: TinySpecimen, tmp_path: Path
) -> None:
    simulate(tmp_path / "three", seed=3, workers=3)
    assert digests(tiny_specimen.folder) == digests(tmp_path / "three")
    simulate(tmp_path / "other", seed=4)
    assert digests(tiny_specimen.folder)["oct/pullback.tif"] != digests(tmp_path / "other")["oct/pullback.tif"]


def test_replaying_a_sample_gives_the_same_bytes(tiny: None, tiny_specimen: TinySpecimen, tmp_path: Path) -> None:
    simulate(tmp_path / "replayed", preset="paper", seed=99, sample=tiny_specimen.sample)
    assert digests(tiny_specimen.folder) == digests(tmp_path / "replayed")


def test_progress_of_every_stage_ends_at_one(tiny_specimen: TinySpecimen) -> None:
    assert [stage for stage, fraction in tiny_specimen.progress if fraction == 1.0] == ["wall", "oct", "endoscope"]
    assert all(0 <= fraction <= 1 for _, fraction in tiny_specimen.progress)


def test_a_sample_that_does_not_hold_together_is_refused_before_anything_is_written(
    tiny: None, tiny_specimen: TinySpecimen, tmp_path: Path
) -> None:
    good = tiny_specimen.sample
    for bad, named in (
        (good | {"oct": good["oct"] | {"offset_mm": [0.1]}}, "offset_mm"),
        (good | {"oct": good["oct"] | {"glass_mm": 3.0}}, "glass_mm"),
        (good | {"oct": good["oct"] | {"z_mm": [500.0] * 4}}, "z_mm"),
        (good | {"spare": 1}, "spare"),
        ({}, "preset"),
    ):
        with pytest.raises(EndoctError, match=named):
            simulate(tmp_path / "replayed", sample=bad)
        assert not (tmp_path / "replayed").exists()


def test_unknown_preset_and_negative_seed_are_refused(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="quick, paper"):
        simulate(tmp_path / "specimen", preset="huge")  # type: ignore[arg-type]
    with pytest.raises(EndoctError, match="seed"):
        simulate(tmp_path / "specimen", seed=-1)
    assert not (tmp_path / "specimen").exists()


def test_files_are_those_that_were_agreed(quick_specimen: Path) -> None:
    preset = PRESETS["quick"]
    with tifffile.TiffFile(quick_specimen / "oct/pullback.tif") as tiff:
        series = tiff.series[0]
        assert series.shape == (preset.n_slices, preset.n_depth, preset.n_ascans)
        assert series.dtype == "uint8"
        assert series.dataoffset is not None, "frames lie one behind the other, so that one can be read alone"
    names = sorted(path.name for path in (quick_specimen / "endoscope").iterdir())
    assert names == ["acquisition.toml", *(f"frame_{i:04d}.png" for i in range(preset.n_frames))]
    shapes = {cv2.imread(str(path)).shape for path in (quick_specimen / "endoscope").glob("*.png")}
    assert len(shapes) == 1
    assert sorted(path.name for path in (quick_specimen / "truth").iterdir()) == [
        "recording.json", "sample.json", "wall.zarr",
    ]  # fmt: skip
    wall = xr.open_zarr(quick_specimen / "truth/wall.zarr", consolidated=False)
    assert wall.relief_mm.dims == wall.cell.dims == wall.cell_id.dims == ("z", "theta")
    assert wall.cell.dtype == bool


def test_sidecars_hold_known_keys_and_agree_with_the_truth(quick_specimen: Path) -> None:
    truth = json.loads((quick_specimen / "truth/recording.json").read_text(encoding="utf-8"))
    oct_ = tomllib.loads((quick_specimen / "oct/acquisition.toml").read_text(encoding="utf-8"))
    endoscope = tomllib.loads((quick_specimen / "endoscope/acquisition.toml").read_text(encoding="utf-8"))
    assert oct_.keys() <= OCT_KEYS
    assert endoscope.keys() <= ENDOSCOPE_KEYS
    assert oct_["bore_diameter_mm"] == endoscope["bore_diameter_mm"] == 2 * truth["bore_radius_mm"]
    assert oct_["handedness"] in (truth["oct"]["handedness"], "unknown")
    for name, keys in (("oct", oct_), ("endoscope", endoscope)):
        assert keys["travel"] in (truth[name]["travel"], "unknown")
        ascending = truth[name]["z_mm"][0] < truth[name]["z_mm"][-1]
        assert ascending == (truth[name]["travel"] == "in")


# Of preset quick, seed 1000: samples of the pullback and of green in the fourth frame, spread over either
PULLBACK = [66, 50, 63, 57, 71, 23, 72, 75, 88, 35, 64, 69, 65, 68, 109, 121, 107, 106, 109, 112, 110, 6, 39, 90]
FRAME = [26, 24, 25, 36, 241, 38, 24, 25, 26, 25, 24, 217, 218, 216, 154, 181, 23, 25, 26, 30, 185, 183, 108, 163]


def test_what_changes_a_specimen_raises_its_version(quick_specimen: Path) -> None:
    """Where this fails the simulator writes something else: raise its version, and put the new samples here."""
    slices = tifffile.imread(quick_specimen / "oct" / "pullback.tif")
    frame = cv2.imread(str(sorted((quick_specimen / "endoscope").glob("*.png"))[3]))
    assert frame is not None
    found = slices[::7, 40::97, ::331].ravel()[:24], frame[40::67, 30::71, 1].ravel()[:24]
    for samples, recorded in zip(found, (PULLBACK, FRAME), strict=True):
        np.testing.assert_allclose(samples.astype(int), recorded, atol=COUNTS_BY_ROUNDING)
    assert SPECIMEN_VERSION == "1"
