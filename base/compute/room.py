"""Arrays that a thread uses again for one frame after the other, in place of new memory for each."""

import threading
from math import prod
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

ALIGNED = 64


class Room(threading.local):
    """Arrays of one thread by name; a thread that ends gives them back.

    New ones of some megabytes would be taken from the system, cleared page by page, and given back, frame by frame:
    that takes as long as what is done with them.
    """

    def __init__(self) -> None:
        self._bytes: dict[str, NDArray[np.uint8]] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """Return this thread's array ``name``, of whatever it held before: until it is asked for again.

        It begins where vectors of the processor do, so that whoever sums it up by these takes one order.
        """
        n_bytes = prod(shape) * np.dtype(dtype).itemsize
        kept = self._bytes.get(name)
        if kept is None or kept.size < n_bytes:
            room = np.empty(n_bytes + ALIGNED, np.uint8)
            skipped = -room.ctypes.data % ALIGNED
            kept = self._bytes[name] = room[skipped : skipped + n_bytes]
        return kept[:n_bytes].view(dtype).reshape(shape)
