"""Stacks whose samples lie one behind the other in a file, as in a ``.npy``: its header is read with bounds."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import check_array_size, open_regular
from endoct.base.files.npy import read_header
from endoct.modalities.reading.format import Format, Frames


class ReadBlocks:
    """Reads frames that lie one behind the other, uncompressed: called with an index, returns the frame."""

    def __init__(self, path: Path, offset: int, dtype: np.dtype[Any], frame_shape: tuple[int, ...]) -> None:
        self.path, self.offset, self.dtype, self.frame_shape = path, offset, dtype, frame_shape

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame. Raises :class:`EndoctError` where the file ends before it does."""
        count = math.prod(self.frame_shape)
        check_array_size(self.frame_shape, self.dtype.itemsize, f"a frame of {self.path}")
        with refusing(f"{self.path} cannot be read"), open_regular(self.path) as file:
            file.seek(self.offset + index * count * self.dtype.itemsize)
            samples = np.fromfile(file, self.dtype, count)
        if samples.size != count:
            raise EndoctError(f"{self.path} is truncated", found=f"frame {index} incomplete", remedy="copy it again")
        return samples.reshape(self.frame_shape).astype(self.dtype.newbyteorder("="), copy=False)


def read_npy(path: Path) -> tuple[int, ReadBlocks]:
    """Return the number of frames of a ``.npy``, and what reads one.

    Raises :class:`EndoctError` where it is no stack.
    """
    with (
        refusing(f"{path} is no readable .npy", expected="an array as numpy.save writes it", remedy="save it again"),
        open_regular(path) as file,
    ):
        if file.peek(4)[:4] == b"PK\x03\x04":
            raise EndoctError(f"{path} is no readable .npy", found="an archive of arrays", remedy="save one array")
        shape, by_column, dtype = read_header(file, str(path))
        offset = file.tell()
        size = file.seek(0, 2)
    if dtype.hasobject or dtype.fields is not None or dtype.subdtype is not None or dtype.kind not in "uif":
        raise EndoctError(f"{path} holds no images", found=str(dtype)[:80], expected="numbers")
    frames = shape if len(shape) > 2 else (1, *shape)
    if len(frames) not in (3, 4) or (by_column and sum(n > 1 for n in shape) > 1):
        raise EndoctError(
            f"{path} has the wrong dimensions",
            found=f"{shape}{' in Fortran order' if by_column else ''}"[:80],
            expected="(frame, row, column), C order",
        )
    if min(frames) < 1 or any(isinstance(n, bool) for n in frames):
        raise EndoctError(f"{path} holds no images", found=f"{shape}"[:80], expected="(frame, row, column)")
    check_array_size(frames[1:], dtype.itemsize, f"a frame of {path}")
    needed = offset + math.prod(frames) * dtype.itemsize
    if size < needed:
        raise EndoctError(f"{path} is truncated", found=f"{size} bytes", expected=f"{needed}", remedy="copy it again")
    return frames[0], ReadBlocks(path, offset, dtype, frames[1:])


NPY = Format(".npy", lambda path: path.suffix.lower() == ".npy", lambda files: Frames(*read_npy(files[0])))
