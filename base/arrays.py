"""Array types used throughout: images are float32, coordinates float64, masks bool."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Coordinates = NDArray[np.float64]
T = TypeVar("T", bound=np.generic)


def readonly(values: ArrayLike, dtype: DTypeLike) -> NDArray[Any]:
    """Return ``values`` as a read-only array of ``dtype``; a writable array of the caller's is copied."""
    array = np.asarray(values, dtype=dtype)
    if array.flags.writeable:
        array = array.copy()
        array.flags.writeable = False
    return array


def read_view(array: NDArray[T]) -> NDArray[T]:
    """Return a view of ``array`` that cannot be written.

    Compiled loops differ for writable and read-only arrays; with read-only views alone, one of them is enough.
    """
    view = array.view()
    view.flags.writeable = False
    return view
