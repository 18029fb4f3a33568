"""The labels and the raw spectra of one specimen agree with its recordings, with each other and with the truth."""

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
import xarray as xr
from tolerances import CHAIN_DB, SAME_ASCAN, SAME_PLACE_MM, SAME_SLICE, SURFACE_PX

from tests.synthetic.fingerprints import KINDS, changed

FACE, DETECTOR = 1, 4


@pytest.fixture(scope="module")
def oct_labels(small_specimen: Path) -> xr.Dataset:
    return xr.open_zarr(small_specimen / "truth/labels/oct.zarr").load()


@pytest.fixture(scope="module")
def frame_labels(small_specimen: Path) -> xr.Dataset:
    return xr.open_zarr(small_specimen / "truth/labels/endoscope.zarr").load()


def test_bone_begins_at_the_surface_row(small_specimen: Path, oct_labels: xr.Dataset) -> None:
    volume = tifffile.imread(small_specimen / "oct/pullback.tif").astype(float)
    flat = np.argwhere((oct_labels.cell_id.values == 0) & (oct_labels.shadow_db.values < 1))
    profiles = []
    for i, k in flat:
        row = round(float(oct_labels.surface_row[i, k]))
        if 30 < row < 480 and not oct_labels.artefact.values[i, row - 20 : row + 20, k].any():
            profiles.append(volume[i, row - 20 : row + 20, k])
    profile = np.mean(profiles, axis=0)
    half = (profile[:12].mean() + profile[26:36].mean()) / 2
    assert abs(int(np.argmax(profile > half)) - 20) <= SURFACE_PX


def test_faces_and_detector_lines_are_flagged_where_they_shine(small_specimen: Path, oct_labels: xr.Dataset) -> None:
    volume = tifffile.imread(small_specimen / "oct/pullback.tif").astype(float)
    floor = json.loads((small_specimen / "truth/sample.json").read_text())["oct"]["floor_count"]
    flags = oct_labels.artefact.values
    above = np.arange(flags.shape[1])[None, :, None] < oct_labels.surface_row.values[:, None, :] - 40
    unflagged = np.median(volume[above & (flags == 0)])
    assert abs(unflagged - floor) < 15
    assert np.median(volume[flags & FACE > 0]) > unflagged + 30
    assert np.median(volume[flags & DETECTOR > 0]) > unflagged + 10
    rows = np.rint(oct_labels.outer_face_row.values).astype(int)
    at_face = np.take_along_axis(flags, rows[:, None, :], axis=1)[:, 0]
    assert np.mean(at_face & FACE > 0) > 0.95


def test_noise_free_twins_keep_the_bone_and_lose_the_noise(small_specimen: Path, oct_labels: xr.Dataset) -> None:
    volume, clean = (
        tifffile.imread(small_specimen / name) for name in ("oct/pullback.tif", "truth/labels/oct_clean.tif")
    )
    assert volume.shape == clean.shape
    depth = np.arange(volume.shape[1])[None, :, None] - oct_labels.surface_row.values[:, None, :]
    bone, dark = (depth > 2) & (depth < 20), (depth < -50) & (oct_labels.artefact.values == 0)
    assert np.corrcoef(volume[bone], clean[bone])[0, 1] > 0.7
    assert np.median(clean[dark]) < np.median(volume[dark]) - 20
    frame, twin = (
        cv2.imread(str(small_specimen / name / "frame_0004.png")).astype(float)
        for name in ("endoscope", "truth/labels/endoscope_clean")
    )
    assert 0.2 < np.abs(frame - twin).mean() < 8


def test_pixels_and_ascans_point_at_one_another(oct_labels: xr.Dataset, frame_labels: xr.Dataset) -> None:
    frame, row, column = (oct_labels[name].values for name in ("frame", "frame_row", "frame_column"))
    seen = frame >= 0
    assert seen.mean() > 0.3
    at = frame[seen], row[seen], column[seen]
    assert frame_labels.valid.values[at].all()
    z_apart = frame_labels.z_mm.values[at] - oct_labels.z_mm.values[seen]
    angle = frame_labels.theta_rad.values[at] - oct_labels.theta_rad.values[seen]
    assert np.abs(z_apart).max() < SAME_PLACE_MM
    assert np.percentile(np.abs(np.angle(np.exp(1j * angle))), 99) * 1.25 < SAME_PLACE_MM
    # and back again: the pixel's A-scan is the one that led to it
    i, k = np.nonzero(seen)
    n = oct_labels.sizes["ascan"]
    off = frame_labels.oct_ascan.values[at] - k
    flat = oct_labels.cell_id.values[seen] == 0
    assert np.percentile(np.abs((off + n / 2) % n - n / 2)[flat], 95) < SAME_ASCAN
    assert np.percentile(np.abs(frame_labels.oct_slice.values[at] - i)[flat], 95) < SAME_SLICE


def test_cells_have_the_ids_of_the_truth_everywhere(
    small_specimen: Path, oct_labels: xr.Dataset, frame_labels: xr.Dataset
) -> None:
    wall = xr.open_zarr(small_specimen / "truth/wall.zarr").load()
    for labels in (oct_labels, frame_labels):
        ids = labels.cell_id.values
        where = (ids > 0) & np.isfinite(labels.z_mm.values)
        z = np.rint(labels.z_mm.values[where] / float(wall.z[1])).astype(int)
        theta = np.rint(labels.theta_rad.values[where] / float(wall.theta[1])).astype(int) % wall.sizes["theta"]
        # beams that go in obliquely may end beside the opening
        assert np.mean(wall.cell_id.values[z, theta] == ids[where]) > 0.8


def test_the_table_of_cells_counts_what_is_seen(small_specimen: Path, oct_labels: xr.Dataset) -> None:
    with (small_specimen / "truth/labels/cells.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    wall = xr.open_zarr(small_specimen / "truth/wall.zarr").load()
    assert {int(row["cell_id"]) for row in rows} == set(np.unique(wall.cell_id.values)) - {0}
    for row in rows:
        assert 0 <= float(row["oct_covered"]) <= 1
        assert int(row["oct_ascans"]) <= int((oct_labels.cell_id == int(row["cell_id"])).sum())
        assert float(row["depth_mm"]) <= 1.7
        if float(row["oct_covered"]) == 0:
            assert int(row["oct_ascans"]) < 20
    assert sum(int(row["oct_ascans"]) for row in rows) > 100


def test_the_documented_chain_makes_the_b_scan_of_the_raw_spectra(small_specimen: Path) -> None:
    about = json.loads((small_specimen / "oct-spectra/spectra.json").read_text(encoding="utf-8"))
    shape = about["slices"], about["ascans"], about["samples"]
    raw = np.fromfile(small_specimen / "oct-spectra/spectra.bin", "<u2").reshape(shape)
    chirp, offset = (np.fromfile(small_specimen / f"oct-spectra/{name}.bin", "<f8") for name in ("Chirp", "Offset"))
    electrons = raw[3] * about["electrons_per_count"] - offset
    electrons -= electrons.mean(axis=0)
    even = np.stack([np.interp(np.arange(shape[2]), chirp, ascan) for ascan in electrons])
    power = np.abs(np.fft.fft(even * np.hanning(shape[2]))[:, : shape[2] // 2]) ** 2
    sample = json.loads((small_specimen / "truth/sample.json").read_text(encoding="utf-8"))["oct"]
    counts = 10 * np.log10(power.T) / sample["db_per_count"]
    written = tifffile.imread(small_specimen / "oct/pullback.tif")[3]
    # over the floor where its bands are highest
    strong = written > sample["floor_count"] + 40 + sample["floor_bands_db"] / sample["db_per_count"]
    strong[shape[2] // 4 :] = False  # deeper, linear interpolation loses some dB
    assert strong.sum() > 1000
    apart = (counts - written)[strong] * sample["db_per_count"]
    assert np.corrcoef(counts[strong], written[strong])[0, 1] > 0.9
    assert np.std(apart) < CHAIN_DB


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_has_the_truth_that_was_published(kind: str) -> None:
    assert changed("labels", kind) == []
