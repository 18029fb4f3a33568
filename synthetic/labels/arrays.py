"""Zarr stores that are written one frame at a time and read by xarray."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr
import zarr

from endoct.stitching.store import write_dataset

Described = Mapping[str, tuple[tuple[str, ...], str, str]]
"""Name → (dims, dtype, what it is)."""


def create(path: Path, sizes: Mapping[str, int], arrays: Described, attrs: Mapping[str, object]) -> dict[str, Any]:
    """Create a store; return its empty arrays by name, one frame a chunk. :func:`finish` it once they are filled."""
    write_dataset(xr.Dataset(attrs=dict(attrs)), path)
    group, made = zarr.open_group(str(path), mode="r+"), {}
    for name, (dims, dtype, about) in arrays.items():
        shape = tuple(sizes[dim] for dim in dims)
        array = group.create_array(
            name, shape=shape, chunks=(1, *shape[1:]), dtype=dtype, dimension_names=dims,
            fill_value=float("nan") if dtype.startswith("f") else 0,
        )  # fmt: skip
        array.attrs["long_name"] = about
        made[name] = array
    return made


def finish(path: Path) -> None:
    """Make the store readable in one go."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        zarr.consolidate_metadata(str(path))
