"""Memory for long recordings: items that go to disk once they are many, arrays used again, memory given back."""

import ctypes
import pickle
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from math import prod
from tempfile import TemporaryFile
from threading import Lock
from typing import IO, Any, Generic, NamedTuple, TypeVar, cast, overload

import numpy as np
from numpy.typing import DTypeLike, NDArray

from endoct.base.errors import EndoctError, system_cause

MOST_IN_MEMORY = 48 * 2**20
"""Bytes that stay in memory, enough for what a survey keeps of 150 slices."""

Item = TypeVar("Item")
ALIGNED = 64
"""The start of every array is a multiple of this many bytes, as vector instructions need it."""


class Computed(Sequence[Item]):
    """A sequence whose item ``i`` is ``make(i)``, made anew whenever it is asked for."""

    def __init__(self, n: int, make: Callable[[int], Item]) -> None:
        self._n, self._make = n, make

    def __len__(self) -> int:
        return self._n

    @overload
    def __getitem__(self, index: int) -> Item: ...
    @overload
    def __getitem__(self, index: slice) -> "Computed[Item]": ...
    def __getitem__(self, index: int | slice) -> "Item | Computed[Item]":
        chosen = range(self._n)[index]
        if isinstance(chosen, range):
            return Computed(len(chosen), lambda i: self._make(chosen[i]))
        return self._make(chosen)


class Kept(Generic[Item]):
    """Items appended one by one and read back by index, each time as a new object; a context that forgets them.

    The first ``MOST_IN_MEMORY`` bytes stay in memory; later items go to a temporary file, so that memory does not grow
    with the recording. The file has no name, and vanishes with the process however that ends. It is read, not mapped:
    pages of a map would count as memory in use. Arrays are stored as they are, each in one piece. Raises
    :class:`EndoctError` where the file cannot be written or read.
    """

    def __init__(self) -> None:
        self._places: list[_Place | tuple[bytes, ...]] = []
        self._left = MOST_IN_MEMORY
        self._file: IO[bytes] | None = None
        self._lock = Lock()

    def __enter__(self) -> "Kept[Item]":
        return self

    def __exit__(self, *_: object) -> None:
        self._places.clear()
        if self._file is not None:
            with suppress(OSError):  # what could not be written is not needed any more
                self._file.close()

    def __len__(self) -> int:
        return len(self._places)

    def append(self, item: Item) -> None:
        """Append ``item``, which must be picklable."""
        arrays: list[pickle.PickleBuffer] = []
        rest = pickle.dumps(item, protocol=5, buffer_callback=arrays.append)
        pieces = [memoryview(rest), *(array.raw() for array in arrays)]
        sizes = tuple(len(piece) for piece in pieces)
        with self._lock, _disk_reported("written"):
            self._left -= sum(sizes)
            if self._left >= 0:
                self._places.append(tuple(map(bytes, pieces)))
                return
            if self._file is None:
                self._file = TemporaryFile()  # noqa: SIM115 – __exit__ closes it
            start = self._file.seek(0, 2)
            for piece in pieces:
                self._file.write(piece)
            self._file.flush()  # a full disk shows here, not when the file is closed
            self._places.append(_Place(start, sizes))

    def __getitem__(self, index: int) -> Item:
        place = self._places[index]
        if isinstance(place, _Place):
            pieces = [bytearray(size) for size in place.sizes]
            with self._lock, _disk_reported("read"):
                file = cast(IO[bytes], self._file)
                file.seek(place.start)
                for piece in pieces:
                    file.readinto(piece)  # type: ignore[attr-defined] # as all binary files have it
        else:
            pieces = [bytearray(piece) for piece in place]
        item: Item = pickle.loads(pieces[0], buffers=pieces[1:])  # nobody else can have written there
        return item

    def __iter__(self) -> Iterator[Item]:
        return (self[index] for index in range(len(self)))


class _Place(NamedTuple):
    """Where an item begins in the file, and how many bytes its pieces have."""

    start: int
    sizes: tuple[int, ...]


@contextmanager
def _disk_reported(done: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise EndoctError(
            f"the temporary file that a long recording needs cannot be {done}",
            found=system_cause(error),
            remedy="free space in the folder for temporary files, or name another one in the variable TMPDIR",
        ) from error


class Room(threading.local):
    """Named arrays of one thread, reused from frame to frame and freed with the thread.

    New arrays of some megabytes would be taken from the system, cleared page by page and given back with every frame.
    That takes as long as the work on them.
    """

    def __init__(self) -> None:
        self._bytes: dict[str, NDArray[np.uint8]] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """Return this thread's array ``name``, with whatever it held before; it is valid until the next such call.

        It is aligned to ``ALIGNED`` bytes, so that vectorised sums always run in the same order.
        """
        n_bytes = prod(shape) * np.dtype(dtype).itemsize
        kept = self._bytes.get(name)
        if kept is None or kept.size < n_bytes:
            room = np.empty(n_bytes + ALIGNED, np.uint8)
            skipped = -room.ctypes.data % ALIGNED
            kept = self._bytes[name] = room[skipped : skipped + n_bytes]
        return kept[:n_bytes].view(dtype).reshape(shape)


def give_back() -> None:
    """Give free memory back to the system, where the C library can, as glibc on Linux does.

    The C library keeps what threads have freed, in a heap of each thread, for their later requests. Between the steps
    of a long recording that was up to 150 MB which nobody used any more.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
