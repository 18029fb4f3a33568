"""The dense volume of `endoct unroll --volume`, small enough for graphics memory."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.zarr.window import ChunkCache, stored_image
from endoct.base.zarr.zarr_store import read_arrays

MOST = (256, 512, 256)
"""Slices, columns and samples along the radius: 34 MB."""
LOW_PERCENT, HIGH_PERCENT = 1.0, 99.9
SLICES_FOR_CONTRAST = 6


def has_volume(store: Path) -> bool:
    """Say whether the panorama in ``store`` was written with its volume."""
    return (store / "volume" / "intensity").is_dir()


def volume_bytes(store: Path) -> bytes:
    """Return the volume of the panorama in ``store`` as codes, resampled to at most ``MOST``.

    All is little-endian. First come the numbers of slices, columns and samples along the radius as uint32. Places
    follow as float32: z of the first and the last slice, mm; θ of the first column, rad; radius of the first and the
    last sample, mm. Last come the codes as uint8, slice by slice, column by column.

    Raises :class:`EndoctError` where there is no volume, or it is damaged.
    """
    folder, cache = store / "volume", ChunkCache(most_bytes=1)
    axes = read_arrays(folder, ["z", "theta", "radius"]) if has_volume(store) else {}
    if set(axes) != {"z", "theta", "radius"} or any(axis.ndim != 1 or axis.size < 2 for axis in axes.values()):
        raise EndoctError(f"{store} has no volume", remedy="unroll the recording with --volume")
    z_mm, theta_rad, radius_mm = (axes[name] for name in ("z", "theta", "radius"))
    n_z, n_theta, n_radius = (
        min(axis.size, most) for axis, most in zip((z_mm, theta_rad, radius_mm), MOST, strict=True)
    )

    def small(row: int) -> NDArray[np.float32]:
        image = stored_image(folder / "intensity", cache, (row,))
        if image.shape != (theta_rad.size, radius_mm.size):
            raise EndoctError(f"the volume of {store} is damaged", remedy="unroll the recording again with --volume")
        read = image.read(slice(0, theta_rad.size), slice(0, radius_mm.size)).astype(np.float32)
        return np.asarray(cv2.resize(np.nan_to_num(read), (n_radius, n_theta), interpolation=cv2.INTER_AREA))

    rows = nearest_rows(z_mm, n_z)
    some = np.stack([small(row) for row in rows[:: max(1, n_z // SLICES_FOR_CONTRAST)]])
    low, high = (float(one) for one in np.percentile(some[:, ::4], [LOW_PERCENT, HIGH_PERCENT]))
    scale = 255 / max(high - low, 1e-9)
    codes = np.stack([np.clip(np.rint((small(row) - low) * scale), 0, 255).astype(np.uint8) for row in rows])
    places = (
        z_mm[0],
        z_mm[-1],
        _first(theta_rad, n_theta),
        _first(radius_mm, n_radius),
        -_first(-radius_mm[::-1], n_radius),
    )
    return np.array(codes.shape, "<u4").tobytes() + np.array(places, "<f4").tobytes() + codes.tobytes()


def nearest_rows(z_mm: Coordinates, count: int) -> list[int]:
    """Return the row nearest to each of ``count`` places at even distances from the first to the last of ``z_mm``."""
    places = np.linspace(z_mm[0], z_mm[-1], count)
    return [int(np.argmin(np.abs(z_mm - place))) for place in places]


def _first(axis: Coordinates, count: int) -> float:
    """Return the centre of the first of ``count`` samples, each the mean of equally many of ``axis``."""
    return float(axis[0] + (axis.size / count - 1) / 2 * (axis[1] - axis[0]))
