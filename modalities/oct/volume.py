"""The dense hollow cylinder, written into a panorama's store."""

from collections.abc import Iterable
from functools import partial
from pathlib import Path

import numpy as np

from endoct.base.arrays import Image
from endoct.base.compute.parallel import thread_map
from endoct.base.zarr.zarr_store import Named, consolidate, new_array, write_arrays
from endoct.modalities.contract import FrameStream
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.undistort import as_recorded, resample, volume_radii_mm


def write_volume(stream: FrameStream, calibration: OctCalibration, store: Path) -> None:
    """Write the group ``volume`` into the Zarr ``store``: ``intensity`` (z, theta, depth), one slice a chunk.

    ``radius`` (mm, from the capillary's axis) lies along depth. Samples keep the recording's type; outside what
    was recorded they are 0 (NaN in a float recording).
    """
    grid, radii = calibration.grid, volume_radii_mm(calibration)
    dtype = stream[0].samples.dtype
    arrays = {
        "z": Named(("z",), calibration.row_z_mm, {"units": "mm"}),
        "theta": Named(("theta",), grid.theta_rad, {"units": "rad"}),
        "radius": Named(("depth",), radii, {"units": "mm"}),
    }
    group = write_arrays(store / "volume", arrays, {"radius_mm": grid.radius_mm}, coordinates=["radius"])
    shape = grid.n_z, grid.n_theta, radii.size
    array = new_array(group, "intensity", shape, dtype, ("z", "theta", "depth"), chunks=(1, *shape[1:]))
    rows = np.searchsorted(calibration.row_z_mm, calibration.slice_z_mm)
    slices: Iterable[Image] = thread_map(partial(resample, calibration=calibration, radii_mm=radii), stream)
    for row, samples in zip(rows, slices, strict=True):
        array[int(row)] = as_recorded(samples, dtype)
    for place in (store / "volume", store):  # a reader may begin at either
        consolidate(place)
