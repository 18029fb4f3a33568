"""The dense volume as the page gets it: resampled, and every sample where it belongs."""

import math
from pathlib import Path

import numpy as np
import pytest
from volume_store import write_volume_store
from workbench_page import Served, application

from endoct.base.errors import EndoctError
from endoct.workbench.page.volume import MOST, nearest_rows, volume_bytes


def read(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return (z of the first and last slice mm, θ of the first column rad, first and last radius mm) and the codes."""
    shape = np.frombuffer(content, "<u4", 3)
    return np.frombuffer(content, "<f4", 5, 12), np.frombuffer(content, np.uint8, offset=32).reshape(shape)


def test_a_small_volume_is_sent_as_it_is(tmp_path: Path):
    store = write_volume_store(tmp_path / "small.zarr", (12, 64, 40), at=(7, 20, 30))
    places, codes = read(volume_bytes(store))
    assert codes.shape == (12, 64, 40)
    assert places == pytest.approx([0.0, 1.1, 0.0, 0.9, 0.9 + 39 * 0.02], abs=1e-5)
    assert np.unravel_index(codes.argmax(), codes.shape) == (7, 20, 30)


def test_a_large_one_is_resampled(tmp_path: Path):
    shape = (9, 3 * MOST[1], 2 * MOST[2])
    store = write_volume_store(tmp_path / "large.zarr", shape, at=(4, 300, 101))
    places, codes = read(volume_bytes(store))
    assert codes.shape == (9, *MOST[1:])
    assert np.unravel_index(codes.argmax(), codes.shape) == (4, 100, 50)
    assert places[2] == pytest.approx(2 * math.pi / shape[1])  # the middle of the first three columns
    assert places[3:] == pytest.approx([0.9 + 0.01, 0.9 + (shape[2] - 1) * 0.02 - 0.01], abs=1e-5)


def test_slices_are_the_nearest_at_even_distances():
    assert nearest_rows(np.array([0.0, 0.1, 0.2, 0.9, 1.0]), 3) == [0, 2, 4]


def test_a_panorama_without_a_volume_has_none(comparison: Path, served: Served):
    with pytest.raises(EndoctError, match="has no volume"):
        volume_bytes(comparison / "panoramas" / "oct.zarr")
    assert served.get("/volume/v.bin")[0] == 404


def test_a_damaged_one_is_one_line(tmp_path: Path):
    store = write_volume_store(tmp_path / "damaged.zarr", (4, 16, 8), at=(1, 2, 3))
    for chunk in (store / "volume" / "intensity" / "c").rglob("*"):
        if chunk.is_file():
            chunk.write_bytes(b"nonsense")
    with application(store) as served:
        status, body, _ = served.get("/volume/v.bin")
    assert status == 500
    assert b"\n" not in body
