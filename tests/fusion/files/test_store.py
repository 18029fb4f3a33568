"""Comparisons on disk that were damaged or made up are refused in one line."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from endoct.base.errors import EndoctError
from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.fusion.files.store import (
    PROPERTIES,
    WALL_STORE,
    as_numbers,
    from_numbers,
    load_compared,
    load_comparison,
    save_comparison,
)
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import CuttingPlane, Result
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.sides import Comparison, PlacedSide
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama

GRID = SurfaceGrid.full_circle(5, 8, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
SIDES = ("endoscope", "oct")
PLANE = CuttingPlane(
    z_mm=0.3, dip_rad=0.5, azimuth_rad=1.0, z_error_mm=0.01, dip_error_rad=0.02, azimuth_error_rad=0.03, support=0.9,
    radius_mm=1.25,
)  # fmt: skip
RESULT = Result(
    sides=SIDES, aligned=False, alignment=None, jaccard=None, dice=None, valid_fraction=1.0, planes={SIDES[1]: (PLANE,)}
)
CELL = Cell("oct", 1, 0.5, 0.1, 0.2, None, None, None, None, None, False, 1.0, 0.9, "both", 2, 0.7)
OTHER = replace(CELL, side="endoscope", id=2, partner=1, depth_of="oct", depth_median_mm=0.1)


def comparison() -> Comparison:
    images = {"intensity": np.zeros(GRID.shape), "depth_mm": np.full(GRID.shape, np.nan)}
    flags = {name: np.zeros(GRID.shape, np.bool_) for name in ("mask", "valid")}
    one, two = (PlacedSide(name=name, **images, **flags) for name in SIDES)
    return Comparison(GRID, (one, two), Alignment(0.1, 0.2), None, RESULT, (CELL, OTHER))


@pytest.fixture
def store(tmp_path: Path) -> Path:
    save_comparison(comparison(), tmp_path / "c.zarr")
    (tmp_path / "result.json").write_text(json.dumps(RESULT.to_json()))
    return tmp_path / "c.zarr"


def test_a_comparison_survives_the_disk(store: Path) -> None:
    found = load_comparison(store)
    assert (found.names, found.alignment, found.reason) == (SIDES, Alignment(0.1, 0.2), None)
    assert found.cells == (CELL, OTHER)
    assert found.grid == GRID
    assert [side.planes for side in found.sides] == [(), (PLANE,)]


def test_the_one_wall_is_that_of_the_folder_or_none(store: Path) -> None:
    folder = store.parent
    store.rename(folder / "comparison.zarr")
    assert load_compared(folder).wall is None
    plain, whole = np.ones(GRID.shape, np.float32), np.ones(GRID.shape, np.bool_)
    save_panorama(Panorama(GRID, plain, plain / 4, whole, plain, "wall", True, True), folder / WALL_STORE)
    wall = load_compared(folder).wall
    assert wall is not None
    assert (wall.modality, float(wall.depth_mm[3, 2])) == ("wall", 0.25)  # type: ignore[index]
    (folder / WALL_STORE / "depth_mm" / "zarr.json").write_text("{}")
    with pytest.raises(EndoctError):
        load_compared(folder)


def test_python_gives_what_xarray_reads(store: Path) -> None:
    of_python, of_disk = comparison().to_xarray(), xarray.open_zarr(store, consolidated=False)
    assert set(of_python) == {"intensity", "depth_mm", "mask", "valid"}
    for name in (*of_python, "side", "z", "theta"):
        assert of_python[name].dims == of_disk[name].dims
        assert of_python[name].equals(of_disk[name].astype(of_python[name].dtype)), name
    assert of_python.attrs["radius_mm"] == of_disk.attrs["radius_mm"]


@pytest.mark.parametrize("name", ["intensity", "depth_mm", "mask", "valid", "cells", "side"])
def test_every_chunk_is_needed(name: str, store: Path) -> None:
    shutil.rmtree(store / name / "c")
    with pytest.raises(EndoctError, match="is not whole"):
        load_comparison(store)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("alignment", "5"), ("alignment", '{"theta_shift_rad": "x", "z_shift_mm": 0}'), ("alignment", "{}"),
        ("alignment", '{"theta_shift_rad": NaN, "z_shift_mm": 0}'), ("alignment", "{"), ("alignment", None),
        ("alignment", '{"theta_shift_rad": 0, "z_shift_mm": 0, "other": 1}'), ("reason", "5"),
        ("alignment", '{"theta_shift_rad": 0, "z_shift_mm": 0, "mirrored": 1}'), ("dz_mm", "0.1"), ("dz_mm", 0),
        ("alignment", '{"theta_shift_rad": 0, "z_shift_mm": 0, "covariance": [[1]]}'), ("format", "x"),
        ("alignment", '{"theta_shift_rad": 0, "z_shift_mm": 0, "bend": {"z_mm": [1]}}'),
        ("alignment", '{"theta_shift_rad": 0, "z_shift_mm": 0, "bend": [1]}'),
        ("alignment", '{"theta_shift_rad": ' + "9" * 5000 + "}"),
    ],
)  # fmt: skip
def test_attributes_that_cannot_be(name: str, value: object, store: Path) -> None:
    told = json.loads((store / "zarr.json").read_text())
    told["attributes"][name] = value
    (store / "zarr.json").write_text(json.dumps(told))
    with pytest.raises(EndoctError) as refused:
        load_comparison(store)
    assert "\n" not in str(refused.value)


def test_a_result_that_does_not_hold_together_is_refused_as_a_whole(store: Path) -> None:
    path = store.parent / "result.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"aligned": True}))
    with pytest.raises(EndoctError, match="the whole: Value error, aligned, but not how"):
        load_comparison(store)


@pytest.mark.parametrize(
    "names", [["../x", "oct"], ["oct", "oct"], ["oct"], ["oct", "both"], ["a", "b", "c"], ["/etc/passwd", "b"]]
)
def test_sides_become_names_of_files(names: list[str], store: Path) -> None:
    told = json.loads((store / "zarr.json").read_text())["attributes"]
    shutil.rmtree(store)
    shape = (2, *GRID.shape)
    arrays = {
        name: Named(("side", "z", "theta"), np.zeros(shape)) for name in ("intensity", "depth_mm", "mask", "valid")
    }
    write_arrays(store, {**arrays, "side": Named(("side",), np.array(names, object))}, told)
    with pytest.raises(EndoctError):
        load_comparison(store)


def column(name: str) -> int:
    return PROPERTIES.index(name)


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.__setitem__((0, column("side")), -1),
        lambda t: t.__setitem__((0, column("side")), 2),
        lambda t: t.__setitem__((0, column("seen_by")), 3),
        lambda t: t.__setitem__((0, column("id")), 1.5),
        lambda t: t.__setitem__((0, column("id")), 1e308),
        lambda t: t.__setitem__((0, column("area_mm2")), np.nan),
        lambda t: t.__setitem__((0, column("overlap")), np.inf),
        lambda t: t.__setitem__((0, column("partner")), 9),
        lambda t: t.__setitem__((0, column("touches_edge")), 2),
        lambda t: t.__setitem__(slice(None), t[0].copy()),
    ],
)
def test_tables_of_cells_that_cannot_be(change: Callable[[Any], object]) -> None:
    table = as_numbers((CELL, OTHER), SIDES)
    assert from_numbers(table, SIDES) == (CELL, OTHER)
    change(table)
    with pytest.raises(EndoctError):
        from_numbers(table, SIDES)


@pytest.mark.parametrize("table", [np.zeros((2, 3)), np.zeros(16), np.zeros((1, 16), np.int64)])
def test_what_is_no_table_of_cells(table: np.ndarray) -> None:
    with pytest.raises(EndoctError):
        from_numbers(table, SIDES)
