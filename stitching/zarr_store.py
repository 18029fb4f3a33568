"""Named arrays on disk: Zarr 3 stores for ``xarray.open_zarr``, written and read without loading xarray."""

import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import DTypeLike, NDArray
from zarr.codecs import Crc32cCodec, ZstdCodec

from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.json_values import an_object, read_object
from endoct.stitching.limits import largest_array_bytes
from endoct.stitching.names import plain_name
from endoct.stitching.zarr_check import check_array, entries
from endoct.stitching.zarr_metadata import OWN, Declared, declared

MOST_METADATA_BYTES = 16_000_000
"""The root's hold those of all arrays, and the provenance."""
MOST_ARRAYS = 200
DAMAGED = "copy the store again, or make it again"


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
        made = new_array(
            group,
            name,
            array.values.shape,
            str if is_text else array.values.dtype,
            array.dims,
            chunks=array.chunks,
            attributes=array.attributes,
        )
        made[...] = array.values
    consolidate(path)
    return group


def new_array(
    group: zarr.Group,
    name: str,
    shape: tuple[int, ...],
    dtype: DTypeLike,
    dims: tuple[str, ...],
    *,
    chunks: tuple[int, ...] | None = None,
    attributes: Mapping[str, str] | None = None,
    fill_value: float | None = None,
) -> Any:  # zarr.Array, whose type does not say what can be assigned
    """Return a new array of ``group`` to be filled, every chunk of it: one that is missing is damage to a reader.

    A chunk that holds nothing but the fill value is written too, and every chunk has a sum that reveals a bit that
    fell over.
    """
    filled: dict[str, Any] = {} if fill_value is None else {"fill_value": fill_value}
    return group.create_array(
        name,
        shape=shape,
        dtype=dtype,
        chunks=chunks or "auto",
        compressors=(ZstdCodec(level=0), Crc32cCodec()),
        **filled,
        dimension_names=dims,
        attributes=dict(attributes or {}),
        config={"write_empty_chunks": True},
    )


def consolidate(path: Path) -> None:
    """Gather the metadata of all arrays below ``path`` in one place, for readers to open at once."""
    with _unspecified():
        zarr.consolidate_metadata(str(path))


def read_attributes(path: Path) -> dict[str, Any]:
    """Return the attributes of a store. Raises :class:`EndoctError` where ``path`` is no Zarr 3 group."""
    metadata = read_object(path / "zarr.json", MOST_METADATA_BYTES)
    if metadata.get("node_type") != "group" or metadata.get("zarr_format") != 3:
        raise EndoctError(f"{path} is no store of arrays", expected="a Zarr 3 group")
    return an_object(metadata.get("attributes", {}), f"the attributes of {path}")


def read_array_attributes(path: Path, name: str) -> dict[str, Any]:
    """Return the attributes of an array of a store. Raises :class:`EndoctError` where its metadata cannot be read."""
    metadata = read_object(path / plain_name(name, f"an array of {path}") / "zarr.json", MOST_METADATA_BYTES)
    return an_object(metadata.get("attributes", {}), f"the attributes of {path / name}")


def read_arrays(path: Path, names: Iterable[str] | None = None, *, together: int = 4) -> dict[str, NDArray[Any]]:
    """Return the arrays of a store that endoct wrote, all or those of ``names`` that are there.

    They are found in the folder itself: consolidated metadata may say something else than the arrays'. What is no
    array there, such as the list of what endoct wrote, is passed over. Raises :class:`EndoctError` for an array that
    is not as endoct writes it, is larger than the limit, or lacks a chunk, and where all are larger than ``together``
    times that limit, before memory is taken.
    """
    folders = {entry.name: Path(entry.path) for entry in entries(path) if entry.is_dir(follow_symlinks=False)}
    wanted = folders.keys() if names is None else [name for name in names if name in folders]
    arrays = [declared(folders[name], OWN) for name in wanted if _is_array(folders[name])]
    _check_all(path, arrays, together)
    return {array.folder.name: _read(array) for array in arrays}


def read_array(array: Declared) -> NDArray[Any]:
    """Return an array that :func:`~endoct.stitching.zarr_check.check_array` has found sound.

    Raises :class:`EndoctError` for what it could not see, as a sum that is not right.
    """
    with refusing(f"{array.folder} cannot be read", remedy=DAMAGED):
        stored: Any = zarr.open_array(array.folder, mode="r", zarr_format=3 if array.zarr_format == 3 else 2)
        return np.asarray(stored[...])


def _read(array: Declared) -> NDArray[Any]:
    plain_name(array.folder.name, f"an array of {array.folder.parent}")
    check_array(array, whole=True)
    return read_array(array)


def _is_array(folder: Path) -> bool:
    if not (folder / "zarr.json").exists():
        return False
    return read_object(folder / "zarr.json", MOST_METADATA_BYTES).get("node_type") != "group"


def _check_all(path: Path, arrays: list[Declared], together: int) -> None:
    """Raise :class:`EndoctError` where the arrays of one store are too many, or too much together."""
    n_bytes, limit = sum(array.n_bytes for array in arrays), together * largest_array_bytes()
    if len(arrays) > MOST_ARRAYS or n_bytes > limit:
        raise EndoctError(
            f"{path} asks for too much memory",
            found=f"{len(arrays)} arrays of {n_bytes / 1e9:.3g} GB",
            expected=f"{MOST_ARRAYS} and {limit / 1e9:g} GB at most",
            remedy="check the store; if it is right, set ENDOCT_LARGEST_ARRAY_GB to more",
        )


@contextmanager
def _unspecified() -> Iterator[None]:
    # consolidated metadata are not in the Zarr 3 specification yet; readers that do not know them ignore them
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part")
        yield
