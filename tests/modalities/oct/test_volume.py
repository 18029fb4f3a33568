"""The dense hollow cylinder."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from endoct.base.numeric.circle import wrap_rad
from endoct.modalities.oct.plugin import OCT
from tests.modalities.oct.phantom import Phantom
from tests.modalities.oct.unrolling import UnrollPhantom


def test_volume(unrolled: UnrollPhantom, tmp_path: Path) -> None:
    stream, calibration, _ = unrolled(Phantom(n_slices=3))
    store = tmp_path / "volume.zarr"
    xr.Dataset().to_zarr(store, zarr_format=3, consolidated=False)
    OCT.write_volume(stream, calibration, store)
    with xr.open_zarr(store, group="volume") as volume:
        samples = volume["intensity"]
        assert samples.dims == ("z", "theta", "depth")
        assert samples.dtype == np.uint8
        assert samples.encoding["chunks"] == (1, *samples.shape[1:])
        profile = samples.values[:, pit_free(volume["theta"].values)].mean(axis=(0, 1))
        radius = volume["radius"].values
    # the wall stands where the bore is, the capillary where its radius is
    air = radius > 1.0
    rise = radius[air][1:][np.argmax(np.diff(profile[air]))]
    assert rise == pytest.approx(1.2, abs=0.02)
    assert radius[np.argmax(profile[radius < 1.0])] == pytest.approx(0.8, abs=0.01)


def pit_free(theta: NDArray[np.float64]) -> NDArray[np.bool_]:
    return (np.abs(wrap_rad(theta - 2.0)) > 0.4) & (np.abs(wrap_rad(theta - 6.2)) > 0.4)
