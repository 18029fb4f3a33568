"""A published set on disk: its digests notice every change, and nothing that is none."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from published_sets import entry

from endoct.base.errors import EndoctError
from endoct.base.zarr.zarr_store import read_arrays
from endoct.stitching.store import load_panorama
from endoct.workbench.bench.published.specimen_set import (
    ROUNDED_UNROLLED,
    SET_FILE,
    check_specimen,
    panorama_digest,
    panorama_means,
    read_set,
)


def test_a_whole_set_passes(made_set: Path) -> None:
    for each in read_set(made_set).specimens:
        check_specimen(made_set, each)
        assert set(each.unrolled) == {"oct", "endoscope"}
        assert set(each.means) == {"oct", "endoscope", "oct.zarr", "endoscope.zarr", "truth"}
        assert set(each.recorded) == {"oct", "endoscope", "truth"}


def test_walls_are_unrolled_as_for_the_published_set(made_set: Path) -> None:
    # Where this fails, nobody can make the published set any more: its panoramas have to be made anew, and published
    means = {each.name: each.means for each in read_set(made_set).specimens}
    for name, by_side in {
        "simulator-easy-000": {"oct": (138.18, 100.0, 45.45, 100.0), "endoscope": (0.973, 99.47, 4.24, 65.48)},
        "simulator-hard-000": {"oct": (139.99, 100.0, 3.12, 100.0), "endoscope": (0.983, 99.73, 1.73, 76.96)},
    }.items():
        for side, expected in by_side.items():
            assert means[name][f"{side}.zarr"] == pytest.approx(expected, abs=ROUNDED_UNROLLED)


def test_a_flipped_bit_of_the_truth_is_noticed(changed_set: Path) -> None:
    first = read_set(changed_set).specimens[0]
    path = changed_set / first.name / "truth" / "recording.json"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(EndoctError, match="another truth"):
        check_specimen(changed_set, first)


def test_a_file_more_is_noticed(changed_set: Path) -> None:
    first = read_set(changed_set).specimens[0]
    (changed_set / first.name / "more.txt").write_text("", encoding="utf-8")
    with pytest.raises(EndoctError, match=r"another more\.txt"):
        check_specimen(changed_set, first)


def test_another_rounding_is_alike_and_another_truth_is_not() -> None:
    first = entry("s0")
    means = {"oct": (50.004, 59.998), "oct.zarr": (100.2, 99.9), "truth": (29.2, 3.1)}
    rounded = {"recorded": {"oct": "d" * 64, "truth": "e" * 64}, "unrolled": {"oct": "f" * 64}, "means": means}
    assert first.is_alike(first.model_copy(update=rounded))
    assert first.digest != first.model_copy(update=rounded).digest
    for other in (
        {"means": {**means, "oct": (50.0, 60.1)}},
        {"means": {**means, "oct": (50.0,)}},
        {"means": {**means, "oct.zarr": (100.6, 99.9)}},
        {"means": {**means, "truth": (29.22, 3.1)}},
        {"means": {}},
        {"name": "s1"},
    ):
        assert not first.is_alike(first.model_copy(update=other))


def test_the_means_of_the_truth_are_those_of_its_files(made_set: Path) -> None:
    first = read_set(made_set).specimens[0]
    truth = made_set / first.name / "truth"
    wall = read_arrays(truth / "wall.zarr")
    recording = json.loads((truth / "recording.json").read_text(encoding="utf-8"))
    depth, share, radius, *others = first.means["truth"]
    assert depth == pytest.approx(100 * wall["relief_mm"].mean(dtype=np.float64), abs=1e-4)
    assert share == pytest.approx(100 * wall["cell"].mean(), abs=1e-4)
    assert radius == recording["bore_radius_mm"]
    assert round(float(np.mean(recording["oct"]["z_mm"])), 4) in others
    assert round(recording["oct"]["theta_origin_rad"], 4) in others


def test_the_digest_of_a_panorama_is_that_of_its_samples(made_set: Path) -> None:
    panorama = load_panorama(made_set / "simulator-easy-000" / "oct.zarr")
    assert panorama_digest(replace(panorama, provenance={}, notes=("another",))) == panorama_digest(panorama)
    turned = replace(panorama, valid=np.roll(panorama.valid, 1, axis=1), depth_mm=np.roll(panorama.depth_mm, 1, axis=1))
    assert panorama_digest(turned) != panorama_digest(panorama)
    off = panorama.depth_mm.copy()
    off[0, 0] = np.nextafter(off[0, 0], np.float32(9))
    assert panorama_digest(replace(panorama, depth_mm=off)) != panorama_digest(panorama)


def test_parallax_that_is_known_nowhere_is_as_none(made_set: Path) -> None:
    panorama = load_panorama(made_set / "simulator-easy-000" / "endoscope.zarr")
    nowhere = np.full(panorama.grid.shape, np.nan, np.float32)
    without = replace(panorama, parallax_depth_mm=None, parallax_error_mm=None)
    unknown = replace(panorama, parallax_depth_mm=nowhere, parallax_error_mm=nowhere)
    assert panorama_digest(unknown) == panorama_digest(without) != panorama_digest(panorama)
    assert panorama_means(unknown) == panorama_means(without) != panorama_means(panorama)


def test_the_store_names_no_place_of_the_machine(made_set: Path) -> None:
    for side in ("oct", "endoscope"):
        inputs = load_panorama(made_set / "simulator-easy-000" / f"{side}.zarr").provenance["inputs"]
        assert inputs
        assert all("/" not in path for path in inputs)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "another"}'])
def test_what_is_no_set_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(EndoctError, match="no set"):
        read_set(tmp_path)
    (tmp_path / SET_FILE).write_text(text, encoding="utf-8")
    with pytest.raises(EndoctError, match="damaged"):
        read_set(tmp_path)


def test_a_name_that_leads_out_of_the_set_is_refused(changed_set: Path) -> None:
    path = changed_set / SET_FILE
    path.write_text(path.read_text(encoding="utf-8").replace("simulator-easy-000", "../outside"), encoding="utf-8")
    with pytest.raises(EndoctError, match="cannot be used"):
        read_set(changed_set)
