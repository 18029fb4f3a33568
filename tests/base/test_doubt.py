"""Doubts: the same in memory, in a store and in JSON; plain sentences are doubts too, and notes repeat none."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from endoct.base.doubt import UNSPECIFIED, Doubt, as_doubt
from endoct.base.errors import EndoctError
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama, doubts_of_observed
from endoct.stitching.store import load_panorama, save_panorama

FAR = Doubt("wall-far-from-nominal", "The wall lies far.", value=3.1, unit="mm", expected=2.5)
NOISE = Doubt("cells-in-noise", "May be noise.", side="oct", value=0.06, unit="1", expected=(0.0, 0.04))
GRID = SurfaceGrid.full_circle(4, 8, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)


def panorama(valid_rows: int = 4, **changed: object) -> Panorama:
    valid = np.zeros(GRID.shape, np.bool_)
    valid[:valid_rows] = True
    image = np.ones(GRID.shape, np.float32)
    made = Panorama(GRID, image, None, valid, image, "oct", True, True, "slice", {"slice_z_mm": np.arange(4.0)})
    return replace(made, **changed)


@pytest.mark.parametrize("doubt", [FAR, NOISE, Doubt("odd", "Odd.")])
def test_json_there_and_back(doubt: Doubt) -> None:
    assert as_doubt(json.loads(json.dumps(doubt.to_json()))) == doubt
    assert list(doubt.to_json()) == ["code", "side", "what", "value", "unit", "expected"]


def test_a_plain_sentence_is_a_doubt() -> None:
    assert as_doubt("The wall\n lies far.") == Doubt(UNSPECIFIED, "The wall lies far.")


def test_what_is_not_finite_is_not_known() -> None:
    assert Doubt("odd", "Odd.", value=float("nan"), expected=(0.0, float("inf"))) == Doubt("odd", "Odd.")
    assert as_doubt({"code": "odd", "what": "Odd.", "value": 10**400}) == Doubt("odd", "Odd.")
    assert Doubt("odd", "Odd.", value=np.float32(0.5)).to_json()["value"] == 0.5


@pytest.mark.parametrize(
    "given",
    [
        1, None, ["odd"], {}, {"code": "odd"}, {"what": "Odd."}, {"code": "Odd one", "what": "Odd."},
        {"code": "odd", "what": " "}, {"code": "odd", "what": "Odd.", "value": "3"},
        {"code": "odd", "what": "Odd.", "value": True}, {"code": "odd", "what": "Odd.", "expected": [1, 2, 3]},
        {"code": "odd", "what": "Odd.", "expected": [1, None, 3]}, {"code": "odd", "what": "Odd.", "side": 3},
        {"code": "odd", "what": "Odd.", "value": [3]}, {"code": "x" * 61, "what": "Odd."},
        {"code": "odd", "what": "Odd.", "unit": "m" * 21},
    ],
)  # fmt: skip
def test_what_is_no_doubt(given: object) -> None:
    with pytest.raises(EndoctError, match="of a doubt cannot be used"):
        as_doubt(given)


def test_notes_of_a_panorama_repeat_neither_a_doubt_nor_each_other() -> None:
    made = panorama(notes=("One bridged.", FAR.what, "One bridged."), doubts=(FAR, FAR, "Plain."))
    assert made.notes == ("One bridged.",)
    assert made.doubts == (FAR, Doubt(UNSPECIFIED, "Plain."))


def test_stores_keep_doubts_and_those_of_older_versions_are_read(tmp_path: Path) -> None:
    made = panorama(notes=("One bridged.",), doubts=(FAR,))
    save_panorama(made, tmp_path / "x.zarr")
    assert load_panorama(tmp_path / "x.zarr").doubts == (FAR,)
    attributes = tmp_path / "x.zarr" / "zarr.json"
    stored = json.loads(attributes.read_text())
    older = {"notes": ["One bridged.", FAR.what], "doubts": [FAR.what]}
    stored["attributes"]["provenance"] = json.dumps(older)
    attributes.write_text(json.dumps(stored))
    loaded = load_panorama(tmp_path / "x.zarr")
    assert (loaded.notes, loaded.doubts) == (("One bridged.",), (Doubt(UNSPECIFIED, FAR.what),))


def test_little_observed_wall_is_doubted_once() -> None:
    assert doubts_of_observed(panorama()) == ()
    (doubt,) = doubts_of_observed(panorama(3))
    assert (doubt.code, doubt.value, doubt.expected) == ("little-observed", 0.75, (0.9, 1.0))
    assert doubts_of_observed(panorama(3, doubts=(doubt,))) == ()


def test_one_row_alone_is_doubted_once() -> None:
    grid = SurfaceGrid.full_circle(1, 4, z0_mm=0.0, dz_mm=0.2, radius_mm=1.0)
    ones = np.ones((1, 4))
    made = Panorama(grid, ones.astype(np.float32), None, ones > 0, ones, "oct", True, True)
    (doubt,) = doubts_of_observed(made)
    assert (doubt.code, doubt.value) == ("one-row", 1.0)
    assert doubts_of_observed(replace(made, doubts=(doubt,))) == ()


def test_a_key_and_a_place_along_the_bore_come_back_and_are_left_out_where_unknown() -> None:
    doubt = Doubt("odd", "Odd.", "oct", 2.0, "mm", 1.0, key="pitch_mm", z_mm=(1.0, 2.5))
    assert as_doubt(doubt.to_json()) == doubt
    assert {"key", "z_mm"} & Doubt("odd", "Odd.").to_json().keys() == set()
    with pytest.raises(EndoctError, match="place of a doubt"):
        as_doubt({"code": "odd", "what": "Odd.", "z_mm": 2.0})
