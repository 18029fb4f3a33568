"""Stacks of equal frames, read one at a time: TIFF and BigTIFF, ``.npy``, a video, or a folder of images."""

import logging
import os
import re
import struct
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.modalities.video import VIDEO_SUFFIXES, ReadVideo, is_video
from endoct.stitching.errors import EndoctError

TIFF_SUFFIXES = (".tif", ".tiff", ".btf", ".tf8")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", *TIFF_SUFFIXES)
TIFF_ERRORS = (OSError, ValueError, IndexError, RuntimeError, struct.error, tifffile.TiffFileError)

# What is wrong with a file is said once, by an EndoctError, not also by the library that reads it.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

In_co = TypeVar("In_co", covariant=True)
Out = TypeVar("Out")


class Stream(Protocol[In_co]):
    """Anything sized and indexable from 0."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> In_co: ...


class ImageStack:
    """A sized, indexable, picklable stack of frames; indexing reads one frame from disk.

    ``stack[i]`` is a read-only array in the file's dtype, (row, column) or (row, column, channel) with
    channels as RGB; transparency is dropped. Raises :class:`EndoctError` where a file is truncated or
    unreadable, or a frame differs in shape or dtype from the first, or is not finite. ``files`` names the files
    where each holds one frame.
    """

    def __init__(
        self, path: Path, n_frames: int, read: Callable[[int], NDArray[Any]], files: tuple[Path, ...] = ()
    ) -> None:
        self.path = path
        self.files = files
        self._n_frames = n_frames
        self._read = read
        first = self._frame(0)
        self.frame_shape: tuple[int, ...] = first.shape
        self.dtype: np.dtype[Any] = first.dtype
        if first.dtype.kind not in "uif" or 0 in first.shape:
            raise EndoctError(
                f"{path} holds no images",
                found=f"{first.dtype} {first.shape}",
                expected="u8, u16 or f32 samples",
            )

    def __len__(self) -> int:
        return self._n_frames

    def __getitem__(self, index: int) -> NDArray[Any]:
        if not 0 <= index < self._n_frames:
            raise IndexError(index)
        frame = self._frame(index)
        if frame.shape != self.frame_shape or frame.dtype != self.dtype:
            raise EndoctError(
                f"frame {index} of {self.path} differs from the first",
                found=f"{frame.dtype} {frame.shape}",
                expected=f"{self.dtype} {self.frame_shape}",
                remedy="remove it, or export the recording again",
            )
        if frame.dtype.kind == "f" and not np.isfinite(frame).all():
            raise EndoctError(
                f"frame {index} of {self.path} is not finite",
                found="NaN or infinity",
                expected="numbers",
                remedy="export the recording again, or replace the samples that are missing by 0",
            )
        frame.flags.writeable = False
        return frame

    def _frame(self, index: int) -> NDArray[Any]:
        frame = self._read(index)
        if frame.ndim == 3 and frame.shape[2] in (1, 2, 4):
            frame = frame[..., :3] if frame.shape[2] == 4 else frame[..., 0]
        return frame


def open_stack(path: Path) -> ImageStack:
    """Open a TIFF, a ``.npy`` (mapped), a video or a folder that holds one of these or numbered images.

    Only the first frame is read. Raises :class:`EndoctError` where there is nothing to read.
    """
    if path.is_dir():
        return _open_folder(path)
    if not path.is_file():
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    if path.stat().st_size == 0:
        raise EndoctError(f"{path} is empty", found="0 bytes", remedy="copy or export the recording again")
    if path.suffix.lower() == ".npy":
        return _open_npy(path)
    if is_tiff(path):
        return _open_tiff(path)
    if is_video(path) or path.suffix.lower() in VIDEO_SUFFIXES:
        read = ReadVideo(path)
        return ImageStack(path, read.n_frames, read)
    return ImageStack(path, 1, _ReadImages((path,)))


def is_tiff(path: Path) -> bool:
    """Say whether the file starts as a TIFF or BigTIFF does."""
    try:
        with path.open("rb") as file:
            return file.read(4) in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
    except OSError:
        return False


def image_files(folder: Path) -> list[Path]:
    """Return the images in ``folder`` in the order of the numbers in their names."""
    files = [f for f in folder.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES and not f.name.startswith(".")]
    return sorted(files, key=lambda f: [int(s) if s.isdigit() else s for s in re.split(r"(\d+)", f.name.lower())])


def map_frames(function: Callable[[In_co], Out], frames: Stream[In_co], workers: int | None = None) -> Iterator[Out]:
    """Yield ``function(frame)`` in order, computed by threads, with at most ``workers`` + 1 frames in memory.

    The result does not depend on ``workers`` (default: one for each processor).
    """
    workers = workers or os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        indices = iter(range(len(frames)))
        pending: list[Future[Out]] = [
            pool.submit(lambda i: function(frames[i]), i) for i in islice(indices, workers + 1)
        ]
        try:
            while pending:
                done = pending.pop(0).result()
                pending.extend(pool.submit(lambda i: function(frames[i]), i) for i in islice(indices, 1))
                yield done
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


class _ReadImages:
    """Reads one file a frame."""

    def __init__(self, files: tuple[Path, ...]) -> None:
        self.files = files

    def __call__(self, index: int) -> NDArray[Any]:
        path = self.files[index]
        if is_tiff(path):
            stack = _open_tiff(path)
            if len(stack) > 1:
                raise EndoctError(
                    f"{path} is one of several images of a recording",
                    found=f"{len(stack)} pages",
                    expected="1",
                    remedy="keep each recording in a folder of its own",
                )
            return stack[0].copy()
        try:
            data = np.fromfile(path, np.uint8)
        except OSError as error:
            raise EndoctError(f"{path} cannot be read", found=error.strerror or str(error)) from error
        image = _decoded(data)
        if image is None:
            raise EndoctError(
                f"{path} is no readable image",
                found=f"{data.size} bytes",
                expected="PNG, JPEG, BMP or TIFF",
                remedy="copy or export the file again",
            )
        return image


def _decoded(data: NDArray[np.uint8]) -> NDArray[Any] | None:
    """Return the image in a file's bytes, colours as RGB, or None where there is none."""
    import cv2  # here, so that a plug-in's manifest can name suffixes without loading OpenCV

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    # the PNG library prints a line of its own about a file without its last chunk
    cut = bytes(data[:4]) == b"\x89PNG" and b"IEND" not in bytes(data[-4096:])
    if cut or not data.size:
        return None
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error:  # a header that asks for an absurd size
        return None
    if image is not None and image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB)
    return image


class _ReadBlocks:
    """Reads frames that lie one behind the other, uncompressed."""

    def __init__(self, path: Path, offset: int, dtype: np.dtype[Any], frame_shape: tuple[int, ...]) -> None:
        self.path, self.offset, self.dtype, self.frame_shape = path, offset, dtype, frame_shape

    def __call__(self, index: int) -> NDArray[Any]:
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


def _open_tiff(path: Path) -> ImageStack:
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
        return ImageStack(path, n_frames, _ReadTiffPages(path))
    _check_size(path, offset + int(np.prod(shape)) * dtype.itemsize)
    return ImageStack(path, n_frames, _ReadBlocks(path, offset, dtype, tuple(shape[-inner:])))


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


def _open_npy(path: Path) -> ImageStack:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise EndoctError(f"{path} is no readable .npy", found=str(error), remedy="save it again") from error
    if not isinstance(array, np.ndarray):
        raise EndoctError(f"{path} is no readable .npy", found="an archive of arrays", remedy="save one array")
    shape = array.shape if array.ndim > 2 else (1, *array.shape)
    if len(shape) not in (3, 4) or not array.flags.c_contiguous or not isinstance(array, np.memmap):
        raise EndoctError(
            f"{path} has the wrong dimensions",
            found=f"{array.shape}",
            expected="(frame, row, column), C order",
        )
    return ImageStack(path, shape[0], _ReadBlocks(path, array.offset, array.dtype, shape[1:]))


def whole_recordings(folder: Path) -> list[Path]:
    """Return the files in ``folder`` of which each holds a recording by itself: ``.npy`` and videos."""
    kinds = (".npy", *VIDEO_SUFFIXES)
    return sorted(f for f in folder.iterdir() if f.suffix.lower() in kinds and not f.name.startswith("."))


def _open_folder(folder: Path) -> ImageStack:
    whole, images = whole_recordings(folder), image_files(folder)
    if len(whole) == 1 and not images:
        return open_stack(whole[0])
    if len(images) == 1 and all(file.suffix.lower() == ".npy" for file in whole):
        return open_stack(images[0])  # arrays beside a TIFF are about it
    if whole or not images:
        raise EndoctError(
            f"{folder} holds no recording" if not whole else f"{folder} holds more than one recording",
            found=f"{len(images)} images, {len(whole)} .npy files or videos",
            expected="one TIFF, one .npy, one video or numbered images",
        )
    return ImageStack(folder, len(images), _ReadImages(tuple(images)), tuple(images))


def _check_size(path: Path, needed: int) -> None:
    if (size := path.stat().st_size) < needed:
        raise EndoctError(
            f"{path} is truncated",
            found=f"{size} bytes",
            expected=f"{needed}",
            remedy="copy or export it again",
        )
