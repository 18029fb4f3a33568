"""Named arrays on disk: Zarr 3 stores for ``xarray.open_zarr``, written and read without loading xarray."""

import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray


@dataclass(frozen=True)
class Named:
    """An array with its dims, attributes such as ``units``, and the shape of its chunks (None: as Zarr sees fit)."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attributes: Mapping[str, str] = field(default_factory=dict)
    chunks: tuple[int, ...] | None = None


def write_arrays(
    path: Path, arrays: Mapping[str, Named], attributes: Mapping[str, Any], *, coordinates: Iterable[str] = ()
) -> zarr.Group:
    """Write ``arrays`` as a Zarr group to ``path``, which must not exist, and return it.

    An array named like its only dim is a coordinate; ``coordinates`` names others. Texts are arrays of objects.
    Metadata are consolidated, so that a plain ``xarray.open_zarr(path)`` is fast and warns of nothing.
    """
    others = {"coordinates": " ".join(coordinates)} if coordinates else {}
    group = zarr.create_group(path, zarr_format=3, attributes={**attributes, **others})
    for name, array in arrays.items():
        is_text = array.values.dtype.kind == "O"
        made = group.create_array(
            name,
            shape=array.values.shape,
            dtype=str if is_text else array.values.dtype,
            chunks=array.chunks or "auto",
            dimension_names=array.dims,
            attributes=dict(array.attributes),
        )
        made[...] = array.values
    consolidate(path)
    return group


def consolidate(path: Path) -> None:
    """Gather the metadata of all arrays below ``path`` in one place, for readers to open at once."""
    with _unspecified():
        zarr.consolidate_metadata(str(path))


def read_arrays(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return all arrays of a store and its attributes. Raises what Zarr raises where there is no store."""
    group = zarr.open_group(path, mode="r")
    return {name: np.asarray(array[...]) for name, array in group.arrays()}, dict(group.attrs)


@contextmanager
def _unspecified() -> Iterator[None]:
    # consolidated metadata are not in the Zarr 3 specification yet; readers that do not know them ignore them
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        yield
