"""A panorama with a dense volume, made up: dark, but for one bright sample."""

from pathlib import Path

import numpy as np

from endoct.base.zarr.zarr_store import Named, write_arrays
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import save_panorama

FIRST_RADIUS_MM, RADIUS_STEP_MM, PITCH_MM = 0.9, 0.02, 0.1


def write_volume_store(
    store: Path, shape: tuple[int, int, int], at: tuple[int, int, int], spread: tuple[int, int, int] = (0, 0, 0)
) -> Path:
    """Write a panorama with a volume of ``shape`` (z, θ, radius) bright ``at`` a sample and ``spread`` beyond."""
    n_z, n_theta, n_radius = shape
    grid = SurfaceGrid.full_circle(n_z, n_theta, z0_mm=0.0, dz_mm=PITCH_MM, radius_mm=1.25)
    known = np.ones(grid.shape, np.bool_)
    image = np.random.default_rng(0).uniform(90, 110, grid.shape).astype(np.float32)
    panorama = Panorama(
        grid=grid, intensity=image, depth_mm=np.zeros(grid.shape, np.float32), valid=known,
        weight=known.astype(np.float32), modality="oct", handedness_known=True, travel_known=True, frame_dim="slice",
        per_frame={}, provenance={},
    )  # fmt: skip
    save_panorama(panorama, store)
    samples = np.full(shape, 10, np.uint16)
    samples[tuple(slice(one - by, one + by + 1) for one, by in zip(at, spread, strict=True))] = 4000
    arrays = {
        "z": Named(("z",), grid.z_mm, {"units": "mm"}),
        "theta": Named(("theta",), grid.theta_rad, {"units": "rad"}),
        "radius": Named(("depth",), FIRST_RADIUS_MM + RADIUS_STEP_MM * np.arange(n_radius), {"units": "mm"}),
        "intensity": Named(("z", "theta", "depth"), samples, {}, (1, n_theta, n_radius)),
    }
    write_arrays(store / "volume", arrays, {"radius_mm": grid.radius_mm}, coordinates=["radius"])
    return store
