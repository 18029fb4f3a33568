"""Strips and panoramas check their shapes and cannot be written to; blending is a weighted mean."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
from tolerances import IMAGE_ATOL

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.stitching.blend import blend
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import AxialScale, Panorama
from endoct.stitching.store import load_panorama, save_panorama
from endoct.stitching.strip import Strip

GRID = SurfaceGrid.full_circle(4, 6, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)


def strip(first_row: int, rows: int, value: float, weight: float = 1.0, depth_mm: float | None = None) -> Strip:
    shape = rows, GRID.n_theta
    return Strip(
        z_mm=GRID.z_mm[first_row : first_row + rows],
        theta_rad=GRID.theta_rad,
        intensity=np.full(shape, value),
        depth_mm=None if depth_mm is None else np.full(shape, depth_mm),
        valid=np.ones(shape, bool),
        weight=np.full(shape, weight),
    )


def panorama() -> Panorama:
    rng = np.random.default_rng(1)
    return Panorama(
        grid=GRID.with_rows([0.0, 0.1, 0.25, 0.3]),
        intensity=rng.normal(size=GRID.shape),
        depth_mm=rng.normal(size=GRID.shape),
        valid=rng.random(GRID.shape) > 0.3,
        weight=rng.random(GRID.shape),
        modality="oct",
        handedness_known=False,
        travel_known=True,
        frame_dim="slice",
        per_frame={
            "slice_z_mm": np.array([0.0, 0.1, 0.25, 0.3]),
            "bridged": np.array([False, True, False, False]),
            "sine_amplitude_mm": np.array([0.1, np.nan, 0.2, 0.3]),
        },
        provenance={"parameters": {"undistort": "eccentric"}},
        notes=("Slice 1 was bridged.",),
        doubts=(Doubt("wall-far-from-nominal", "The wall lies 0.3 mm behind the nominal bore.", value=2.8, unit="mm"),),
        axial_scale=AxialScale({"pullback_pitch_mm": 0.1}, checked=True),
    )


def test_to_xarray_is_what_the_store_opens_as(tmp_path: Path) -> None:
    save_panorama(panorama(), tmp_path / "p.zarr")
    with xarray.open_zarr(tmp_path / "p.zarr") as stored:
        xarray.testing.assert_identical(panorama().to_xarray(), stored.load())


def test_representations_are_one_line() -> None:
    assert repr(panorama()) == (
        f"<Panorama of oct: 4 × 6 (z, θ), z 0.00 to 0.30 mm, bore ⌀ 2.5 mm, {panorama().valid.mean():.1%} valid, "
        "with depth>"
    )
    assert repr(GRID) == "<SurfaceGrid 4 × 6 (z, θ): z 0.00 to 0.30 mm every 0.1 mm, bore ⌀ 2.5 mm>"
    assert repr(strip(0, 2, 1.0)) == "<Strip 2 × 6 (z, θ): z 0.00 to 0.10 mm, 100.0% valid>"


def test_arrays_are_read_only_and_not_the_callers() -> None:
    mine = np.zeros((1, 6), np.float32)
    made = replace(strip(0, 1, 0.0), intensity=mine)
    mine[:] = 9
    assert not made.intensity.any()
    one = panorama()
    for array in (made.intensity, made.valid, made.weight, made.z_mm, one.depth_mm, one.per_frame["bridged"].values):
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


@pytest.mark.parametrize("name", ["intensity", "depth_mm", "valid", "weight"])
def test_wrong_shapes_are_refused(name: str) -> None:
    wrong = np.zeros((2, 6))
    with pytest.raises(EndoctError, match=f"{name} of a strip has the wrong shape"):
        replace(strip(0, 1, 0.0), **{name: wrong})
    with pytest.raises(EndoctError, match=f"{name} of a panorama has the wrong shape"):
        replace(panorama(), **{name: wrong})


def test_blending_by_hand() -> None:
    intensity, depth_mm, valid, weight = blend([strip(0, 2, 1.0), strip(1, 2, 4.0, weight=2.0)], GRID, GRID.z_mm)
    np.testing.assert_allclose(intensity[:, 0], [1.0, 3.0, 4.0, 0.0])  # (1·1 + 2·4) / 3 = 3
    np.testing.assert_allclose(weight[:, 0], [1.0, 3.0, 2.0, 0.0])
    assert valid[:, 0].tolist() == [True, True, True, False]
    assert depth_mm is None


def test_what_is_not_valid_does_not_count_even_where_it_is_nan() -> None:
    unseen = replace(strip(0, 1, np.nan, depth_mm=np.nan), valid=np.zeros((1, 6), bool))
    intensity, depth_mm, valid, _ = blend([unseen, strip(0, 1, 2.0, depth_mm=0.5)], GRID, GRID.z_mm)
    assert depth_mm is not None
    np.testing.assert_allclose(intensity[0], 2.0)
    np.testing.assert_allclose(depth_mm[0], 0.5)
    assert np.isnan(depth_mm[1:]).all()
    assert valid.sum() == 6


def test_the_order_of_strips_does_not_matter() -> None:
    strips = [strip(k % 3, 2, float(k), weight=0.1 + k) for k in range(7)]
    one, other = blend(strips, GRID, GRID.z_mm), blend(strips[::-1], GRID, GRID.z_mm)
    np.testing.assert_allclose(one[0], other[0], atol=IMAGE_ATOL)


def test_a_strip_off_the_grid_is_refused() -> None:
    for off in (
        replace(strip(0, 1, 0.0), z_mm=np.array([0.05])),
        replace(strip(0, 1, 0.0), theta_rad=GRID.theta_rad + 0.01),
        replace(strip(0, 2, 0.0), z_mm=np.array([0.0, 0.2])),  # rows with a gap
        replace(strip(3, 1, 0.0), z_mm=np.array([0.4])),
    ):
        with pytest.raises(EndoctError, match="grid"):
            blend([off], GRID, GRID.z_mm)


def test_a_panorama_survives_the_disk(tmp_path) -> None:
    saved = panorama()
    save_panorama(saved, tmp_path / "x.zarr")
    loaded = load_panorama(tmp_path / "x.zarr")
    assert loaded.grid == saved.grid
    for name in ("z_mm", "intensity", "depth_mm", "valid", "weight"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(saved, name))
    assert loaded.per_frame.keys() == saved.per_frame.keys()
    for key, values in saved.per_frame.items():
        np.testing.assert_array_equal(loaded.per_frame[key].values, values.values)
    for name in ("modality", "handedness_known", "travel_known", "frame_dim", "provenance", "notes", "doubts"):
        assert getattr(loaded, name) == getattr(saved, name)


def test_what_is_no_panorama_is_refused(tmp_path) -> None:
    with pytest.raises(EndoctError, match="is no panorama"):
        load_panorama(tmp_path)
