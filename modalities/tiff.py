"""Frames of a TIFF or BigTIFF, read one at a time, and of any file in which they lie uncompressed."""

import logging
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.stitching.errors import EndoctError

TIFF_SUFFIXES = (".tif", ".tiff", ".btf", ".tf8")
TIFF_ERRORS = (OSError, ValueError, IndexError, RuntimeError, struct.error, tifffile.TiffFileError)

# What is wrong with a file is said once, by an EndoctError, not also by the library that reads it.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


def is_tiff(path: Path) -> bool:
    """Say whether the file starts as a TIFF or BigTIFF does."""
    try:
        with path.open("rb") as file:
            return file.read(4) in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
    except OSError:
        return False


def read_tiff(path: Path) -> tuple[int, Callable[[int], NDArray[Any]]]:
    """Return the number of frames of a TIFF, and what reads one. Raises :class:`EndoctError` where it is no stack."""
    try:
        with _damage_reported(path), tifffile.TiffFile(path) as tiff:
            series = tiff.series[0]
            shape, axes, offset, n_pages = series.shape, series.axes, series.dataoffset, len(tiff.pages)
            dtype = np.dtype(tiff.byteorder + series.dtype.char)
    except TIFF_ERRORS as error:
        raise EndoctError(f"{path} is no readable TIFF", found=str(error), remedy="copy or export it again") from error
    inner = 3 if axes.endswith("S") else 2
    if len(shape) not in (inner, inner + 1) or "S" in axes[:-1]:
        raise EndoctError(
            f"{path} has the wrong dimensions",
            found=f"{axes} {shape}",
            expected="a stack of images, one page a frame",
        )
    n_frames = shape[0] if len(shape) == inner + 1 else 1
    single_directory = n_pages == 1 and offset is not None  # as ImageJ writes large stacks
    if n_pages != n_frames and not single_directory:
        raise EndoctError(
            f"{path} mixes pages",
            found=f"{n_pages} pages",
            expected=f"{n_frames} of one kind",
            remedy="remove the others, or export the recording again",
        )
    if offset is None:
        return n_frames, _ReadTiffPages(path)
    _check_size(path, offset + int(np.prod(shape)) * dtype.itemsize)
    return n_frames, ReadBlocks(path, offset, dtype, tuple(shape[-inner:]))


class ReadBlocks:
    """Reads frames that lie one behind the other, uncompressed: called with an index, returns the frame."""

    def __init__(self, path: Path, offset: int, dtype: np.dtype[Any], frame_shape: tuple[int, ...]) -> None:
        self.path, self.offset, self.dtype, self.frame_shape = path, offset, dtype, frame_shape

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame. Raises :class:`EndoctError` where the file ends before it does."""
        count = int(np.prod(self.frame_shape))
        try:
            samples = np.fromfile(
                self.path, self.dtype, count, offset=self.offset + index * count * self.dtype.itemsize
            )
        except OSError as error:
            raise EndoctError(f"{self.path} cannot be read", found=error.strerror or str(error)) from error
        if samples.size != count:
            raise EndoctError(f"{self.path} is truncated", found=f"frame {index} incomplete", remedy="copy it again")
        return samples.reshape(self.frame_shape).astype(self.dtype.newbyteorder("="), copy=False)


class _ReadTiffPages:
    """Reads one (compressed) TIFF page a frame."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __call__(self, index: int) -> NDArray[Any]:
        try:
            with tifffile.TiffFile(self.path) as tiff:
                page = tiff.pages[index]
                segments = zip(page.dataoffsets, page.databytecounts, strict=True)
                _check_size(self.path, max(offset + count for offset, count in segments))
                return np.asarray(page.asarray())
        except TIFF_ERRORS as error:
            raise EndoctError(
                f"page {index} of {self.path} cannot be read",
                found=str(error),
                remedy="copy or export it again",
            ) from error


@contextmanager
def _damage_reported(path: Path) -> Iterator[None]:
    """Raise :class:`EndoctError` where tifffile leaves out pages that it cannot reach, and only logs so."""
    damage: list[str] = []
    signs = ("invalid page offset", "circular reference", "failed to reshape", "invalid value offset")

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            message = record.getMessage()
            if record.thread == threading.get_ident() and any(sign in message for sign in signs):
                damage.append(message)

    listener = Listener()
    logger = logging.getLogger("tifffile")
    logger.addHandler(listener)
    try:
        yield
    finally:
        logger.removeHandler(listener)
    if damage:
        raise EndoctError(f"{path} is damaged or truncated", found=damage[0], remedy="copy or export it again")


def _check_size(path: Path, needed: int) -> None:
    if (size := path.stat().st_size) < needed:
        raise EndoctError(
            f"{path} is truncated",
            found=f"{size} bytes",
            expected=f"{needed}",
            remedy="copy or export it again",
        )
