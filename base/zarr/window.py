"""Windows of an image in a Zarr store, read as they are asked for: an image need not fit into memory."""

import math
import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.zarr.zarr_metadata import OWN, Declared, declared
from endoct.base.zarr.zarr_store import DAMAGED, check_chunk, check_sizes

Pixels = NDArray[Any]


@dataclass
class ChunkCache:
    """Chunks that were read last, at most ``most_bytes`` of them. Threads may share it."""

    most_bytes: int = 32_000_000
    _kept: "OrderedDict[tuple[Path, str], Pixels]" = field(default_factory=OrderedDict)
    _bytes: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def get(self, key: tuple[Path, str]) -> Pixels | None:
        """Return the chunk that was kept under ``key``, None where there is none."""
        with self._lock:
            chunk = self._kept.get(key)
            if chunk is not None:
                self._kept.move_to_end(key)
            return chunk

    def put(self, key: tuple[Path, str], chunk: Pixels) -> None:
        """Keep ``chunk`` under ``key``, and let go of those that were not used for longest."""
        with self._lock:
            if key in self._kept:
                return
            self._kept[key] = chunk
            self._bytes += chunk.nbytes
            while self._bytes > self.most_bytes and len(self._kept) > 1:
                _, gone = self._kept.popitem(last=False)
                self._bytes -= gone.nbytes


@dataclass(frozen=True, eq=False)
class StoredImage:
    """An image on disk: the last two axes of the array ``declared``, at ``index`` of those before.

    Every chunk is checked before it is decoded, and decoded once at a time.
    """

    declared: Declared
    index: tuple[int, ...]
    cache: ChunkCache
    _array: Any = field(repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        rows, columns = self.declared.shape[-2:]
        return rows, columns

    @property
    def chunk(self) -> tuple[int, int]:
        """Rows and columns of a chunk."""
        rows, columns = self.declared.chunk[-2:]
        return rows, columns

    def read(self, rows: slice, columns: slice) -> Pixels:
        """Return a copy of the samples of ``rows`` and ``columns``, both with a start and a stop inside the image.

        Raises :class:`EndoctError` where a chunk is missing or damaged.
        """
        window = np.empty((rows.stop - rows.start, columns.stop - columns.start), self.declared.dtype)
        high, wide = self.chunk
        for row in range(rows.start // high, math.ceil(rows.stop / high)):
            for column in range(columns.start // wide, math.ceil(columns.stop / wide)):
                chunk = self._chunk(row, column)
                top, left = row * high, column * wide
                of_rows = slice(max(rows.start, top), min(rows.stop, top + chunk.shape[0]))
                of_columns = slice(max(columns.start, left), min(columns.stop, left + chunk.shape[1]))
                window[_shifted(of_rows, rows.start), _shifted(of_columns, columns.start)] = chunk[
                    _shifted(of_rows, top), _shifted(of_columns, left)
                ]
        return window

    def _chunk(self, row: int, column: int) -> Pixels:
        prefix, separator = self.declared.key
        place = [n // c for n, c in zip(self.index, self.declared.chunk, strict=False)]
        name = separator.join([prefix, *map(str, (*place, row, column))])
        # one chunk holds several indices where chunks are deeper than 1: only this index is kept
        key = self.declared.folder, f"{name} {self.index}"
        with self._lock:
            kept = self.cache.get(key)
            if kept is not None:
                return kept
            folder = self.declared.folder.resolve()
            if not (folder / name).is_file() or (folder / name).resolve() != folder / name:  # missing, or a link
                raise EndoctError(f"{self.declared.folder} is not whole", found=f"no chunk {name}", remedy=DAMAGED)
            check_chunk(self.declared, name)
            high, wide = self.chunk
            with refusing(f"{self.declared.folder} cannot be read", remedy=DAMAGED):
                chunk = np.asarray(
                    self._array[
                        (*self.index, slice(row * high, (row + 1) * high), slice(column * wide, (column + 1) * wide))
                    ]
                )
            self.cache.put(key, chunk)
            return chunk


def stored_image(folder: Path, cache: ChunkCache, index: tuple[int, ...] = ()) -> StoredImage:
    """Return the image at ``index`` of the array in ``folder``, of which endoct wrote the store.

    Raises :class:`EndoctError` where there is no such array, or its metadata ask for what endoct does not write.
    """
    array = declared(folder, OWN)
    check_sizes(array)
    if array.dtype is None or len(array.shape) != len(index) + 2:
        raise EndoctError(f"{folder} holds no image", found=f"shape {array.shape}", expected="(z, θ)")
    if any(not 0 <= k < n for k, n in zip(index, array.shape, strict=False)) or 0 in array.shape:
        raise EndoctError(f"{folder} is too small", found=f"shape {array.shape}")
    with refusing(f"{folder} cannot be read", remedy=DAMAGED):
        opened = zarr.open_array(folder, mode="r", zarr_format=3)
    return StoredImage(array, index, cache, opened)


def _shifted(span: slice, by: int) -> slice:
    return slice(span.start - by, span.stop - by)
