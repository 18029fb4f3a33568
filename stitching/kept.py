"""What is kept of every frame or strip, on disk once it is much: memory then does not grow with the recording."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from tempfile import SpooledTemporaryFile
from threading import Lock
from typing import Any, Generic, TypeVar, overload

from endoct.stitching.errors import EndoctError

MOST_IN_MEMORY = 32 * 2**20  # bytes

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

    Up to ``MOST_IN_MEMORY`` they stay in memory, beyond in a temporary file without a name, which vanishes with the
    process however that ends. It is read, not mapped: pages of a map would count as memory in use. Raises
    :class:`EndoctError` where the file cannot be written or read.
    """

    def __init__(self) -> None:
        self._file: Any = SpooledTemporaryFile(max_size=MOST_IN_MEMORY)  # noqa: SIM115 – __exit__ closes it
        self._starts: list[int] = []
        self._lock = Lock()

    def __enter__(self) -> "Kept[Item]":
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # what could not be written is not needed any more
            self._file.close()

    def __len__(self) -> int:
        return len(self._starts)

    def append(self, item: Item) -> None:
        """Put ``item``, which must be picklable, behind the others."""
        with self._lock, _disk_reported("written"):
            start = self._file.seek(0, 2)
            pickle.dump(item, self._file, protocol=5)
            self._file.flush()  # a full disk shows here, not when the file is closed
            self._starts.append(start)

    def __getitem__(self, index: int) -> Item:
        with self._lock, _disk_reported("read"):
            self._file.seek(self._starts[index])
            item: Item = pickle.load(self._file)  # nobody else can have written there
        return item

    def __iter__(self) -> Iterator[Item]:
        return (self[index] for index in range(len(self)))


@contextmanager
def _disk_reported(done: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise EndoctError(
            f"the temporary file that a long recording needs cannot be {done}",
            found=error.strerror or str(error),
            remedy="free space in the folder for temporary files, or name another one in the variable TMPDIR",
        ) from error
