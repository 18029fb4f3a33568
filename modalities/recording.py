"""Stacks of equal frames, read one at a time: TIFF and BigTIFF, ``.npy``, a video, or a folder of images."""

import os
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.tiff import TIFF_SUFFIXES, ReadBlocks, is_tiff, read_tiff
from endoct.modalities.video import VIDEO_SUFFIXES, ReadVideo, is_video
from endoct.stitching.errors import EndoctError

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", *TIFF_SUFFIXES)

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
        return ImageStack(path, *read_tiff(path))
    if is_video(path) or path.suffix.lower() in VIDEO_SUFFIXES:
        read = ReadVideo(path)
        return ImageStack(path, read.n_frames, read)
    return ImageStack(path, 1, _ReadImages((path,)))


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
            stack = ImageStack(path, *read_tiff(path))
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
    return ImageStack(path, shape[0], ReadBlocks(path, array.offset, array.dtype, shape[1:]))


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
