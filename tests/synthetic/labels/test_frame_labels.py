"""What one instrument sees where the other looks: by hand."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from endoct.synthetic.endoscope.camera import PixelMaps
from endoct.synthetic.labels import specimen_labels
from endoct.synthetic.labels.pullback_labels import Pullback
from endoct.synthetic.labels.specimen_labels import _squarest_frame, ascans_of_places, cartesian_mm, nearest_places

N_ASCANS = 8


def pullback(z_mm: list[float], start_rad: float, sense: int) -> Pullback:
    """Slices whose A-scans go around evenly from ``start_rad`` on."""
    shape = len(z_mm), N_ASCANS
    theta_rad = np.mod(start_rad + sense * 2 * np.pi / N_ASCANS * np.arange(N_ASCANS), 2 * np.pi)
    rest = [np.zeros(shape, np.float32) for _ in range(9)]
    places = np.broadcast_to(theta_rad, shape).astype(np.float32), np.repeat(z_mm, N_ASCANS).reshape(shape)
    return Pullback(*places, *rest, np.zeros(shape, np.bool_))  # type: ignore[arg-type]


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("z_mm", [[1.0, 1.2, 1.4], [1.4, 1.2, 1.0]])
def test_a_place_is_between_slices_and_between_ascans(z_mm: list[float], sense: int) -> None:
    of = pullback(z_mm, 0.5, sense)
    theta_rad = 0.5 + sense * 2 * np.pi / N_ASCANS * np.array([0.0, 2.25, 7.5, 3.0, 0.0, 0.0, 0.0])
    wanted_mm = np.array([1.2, 1.05, 1.4, 1.29, 0.91, 0.89, 1.51])
    slices, ascans = ascans_of_places(of, wanted_mm, np.mod(theta_rad, 2 * np.pi))
    expected = (wanted_mm - z_mm[0]) / (z_mm[1] - z_mm[0])
    expected[5:] = np.nan  # beyond half a pitch
    np.testing.assert_allclose(slices, expected, atol=1e-5)
    off = np.mod(ascans[:5] - [0, 2.25, 7.5, 3, 0] + N_ASCANS / 2, N_ASCANS) - N_ASCANS / 2
    assert np.abs(off).max() < 0.02
    assert np.isnan(ascans[5:]).all()


def test_the_same_place_is_the_nearest_within_a_twentieth_of_a_millimetre() -> None:
    places = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.03, 0.0, 0.0]])
    wanted = np.array([[0.0, 0.0, 0.96], [0.0, 0.0, 0.94], [0.01, 0.0, 0.0], [0.02, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    assert nearest_places(places, wanted).tolist() == [1, -1, 0, 2, -1]
    assert nearest_places(np.empty((0, 3)), wanted).tolist() == [-1] * 5
    place = cartesian_mm(np.array([3.0]), np.array([np.pi / 2]), np.array([2.0]))
    np.testing.assert_allclose(place, [[0, 2, 3]], atol=1e-12)


def test_the_squarest_frame_is_the_one_whose_middle_is_nearest() -> None:
    z_mm = np.array([0.0, 0.16, 0.29, 0.31, 0.7, 1.11])
    assert _squarest_frame(np.array([0.6, 0.2, 1.0]), 0.25, z_mm).tolist() == [-1, 1, 1, 1, 0, 2]


def test_frames_and_ascans_that_see_one_place_name_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two frames of 3 × 8 pixels, one for each A-scan of three slices; in frame 1 the last row is hidden."""
    of = pullback([1.0, 1.2, 1.4], 0.5, 1)
    of.radius_mm[:] = 2.0 + 0.1 * np.arange(N_ASCANS)
    frames_z_mm = 1.0, 1.35  # the squarest of slices 0, and 1 and 2
    cell = np.repeat(np.array([[1], [0], [2]], np.int32), N_ASCANS, axis=1)

    def maps(sample: object, wall: object, index: int) -> PixelMaps:
        del sample, wall
        valid = np.ones((3, N_ASCANS), np.bool_)
        valid[2] = index == 0
        z_mm, theta_rad = (np.where(valid, values, np.float32(np.nan)) for values in (of.z_mm, of.theta_rad))
        obscured = np.zeros_like(valid)
        obscured[0, 0] = True
        return PixelMaps(z_mm, theta_rad, of.radius_mm - 1.9, np.where(valid, cell, 0), obscured, valid)

    monkeypatch.setattr(specimen_labels, "pixel_maps", maps)
    monkeypatch.setattr(specimen_labels, "noise_free", lambda *_: np.zeros((3, N_ASCANS), np.uint8))
    contents = SimpleNamespace(lining=np.zeros(3))
    camera = SimpleNamespace(z_mm=frames_z_mm, visible_length_mm=0.5, height_px=3, width_px=N_ASCANS)
    wall = SimpleNamespace(radius_mm=1.9, scene=SimpleNamespace(contents=contents))
    model: Any = SimpleNamespace(sample=SimpleNamespace(endoscope=camera), wall=wall, lighting=None)
    shares: list[float] = []
    pixels, per_cell = specimen_labels.write_endoscope_labels(tmp_path, model, of, shares.append, 1)
    labels = xr.open_zarr(tmp_path / "endoscope.zarr").load()
    slices, ascans = np.indices((3, N_ASCANS))
    np.testing.assert_allclose(labels.oct_slice[0], slices, atol=1e-4)
    np.testing.assert_allclose(labels.oct_ascan[0], ascans, atol=0.01)
    assert np.isnan(labels.oct_slice[1, 2]).all()
    frame = np.repeat([[0], [1], [-1]], N_ASCANS, axis=1)  # slice 2 is nearest to frame 1, which does not show it
    np.testing.assert_array_equal(pixels, np.where(frame >= 0, np.stack([frame, slices, ascans]), -1))
    assert per_cell.tolist() == [2 * N_ASCANS, 2 * (N_ASCANS - 1), N_ASCANS]
    np.testing.assert_array_equal(labels.cell_id[0], cell)
    assert shares == [0.5, 1.0]
