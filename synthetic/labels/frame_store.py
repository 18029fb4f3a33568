"""Zarr stores that are written one frame at a time and read by xarray."""

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from endoct.base.zarr.zarr_store import new_array, write_arrays

Described = Mapping[str, tuple[tuple[str, ...], str, str]]
"""Name → (dims, dtype, what it is)."""


class Writable(Protocol):
    """An array on disk."""

    def __setitem__(self, index: int | slice, values: NDArray[np.generic], /) -> None: ...


def create(path: Path, sizes: Mapping[str, int], arrays: Described, attrs: Mapping[str, object]) -> dict[str, Writable]:
    """Create a store and return its empty arrays by name, one frame a chunk; consolidate it once they are filled."""
    group = write_arrays(path, {}, attrs)
    made: dict[str, Writable] = {}
    for name, (dims, dtype, about) in arrays.items():
        of_array = {dim: sizes[dim] for dim in dims}
        made[name] = new_array(
            group, name, of_array, dtype, chunks=(1, *tuple(of_array.values())[1:]), attributes={"long_name": about},
            fill_value=float("nan") if dtype.startswith("f") else 0,
        )  # fmt: skip
    return made
