"""What is kept of every frame or strip, on disk once it is much: memory then does not grow with the recording."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from tempfile import TemporaryFile
from threading import Lock
from typing import IO, Generic, NamedTuple, TypeVar, cast, overload

from endoct.base.errors import EndoctError, system_cause

MOST_IN_MEMORY = 48 * 2**20
"""Bytes that stay in memory, enough for what a survey keeps of 150 slices."""

Item = TypeVar("Item")


class Computed(Sequence[Item]):
    """A sequence whose items are made anew whenever one is asked for: item ``i`` is ``make(i)``."""

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
    """Items put away one by one and read back, each time as another object, by index; a context that forgets them.

    The first ``MOST_IN_MEMORY`` of them stay in memory, those after them go to a temporary file without a name, which
    vanishes with the process however that ends. It is read, not mapped: pages of a map would count as memory in use.
    What arrays hold is put away as it is, each in one piece. Raises :class:`EndoctError` where the file cannot be
    written or read.
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
        """Put ``item``, which must be picklable, behind the others."""
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
