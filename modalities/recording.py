"""Stacks of equal frames, read one at a time: TIFF and BigTIFF, ``.npy``, a video, or a folder of images."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.arrays_on_disk import read_npy
from endoct.modalities.folders import entries, exists, is_folder
from endoct.modalities.images import read_image
from endoct.modalities.tiff import TIFF_SUFFIXES, is_tiff, read_tiff
from endoct.modalities.video import VIDEO_SUFFIXES, ReadVideo, is_video
from endoct.stitching.errors import EndoctError
from endoct.stitching.files import open_regular

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", *TIFF_SUFFIXES)


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
    if is_folder(path):
        return _open_folder(path)
    if not exists(path):
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    with open_regular(path) as file:
        if not file.read(1):
            raise EndoctError(f"{path} is empty", found="0 bytes", remedy="copy or export the recording again")
    if path.suffix.lower() == ".npy":
        return ImageStack(path, *read_npy(path))
    if is_tiff(path):
        return ImageStack(path, *read_tiff(path))
    if is_video(path) or path.suffix.lower() in VIDEO_SUFFIXES:
        read = ReadVideo(path)
        return ImageStack(path, read.n_frames, read)
    return ImageStack(path, 1, _ReadImages((path,)))


def some_frames(stack: ImageStack) -> list[NDArray[Any]]:
    """Return the first, the middle and the last frame, of a short recording fewer. Raises what reading one does."""
    return [stack[index] for index in sorted({0, (len(stack) - 1) // 2, len(stack) - 1})]


def image_files(folder: Path) -> list[Path]:
    """Return the images in ``folder`` in the order of the numbers in their names."""
    files = [file for file in entries(folder) if file.suffix.lower() in IMAGE_SUFFIXES]
    return sorted(files, key=_by_number)


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
        return read_image(path)


def whole_recordings(folder: Path) -> list[Path]:
    """Return the files in ``folder`` of which each holds a recording by itself: ``.npy`` and videos."""
    kinds = (".npy", *VIDEO_SUFFIXES)
    return sorted(file for file in entries(folder) if file.suffix.lower() in kinds)


def _by_number(file: Path) -> list[int | str]:
    # other digits than these, as ² or those of other scripts, are letters here
    return [int(part) if part[:1] in tuple("0123456789") else part for part in re.split(r"([0-9]+)", file.name.lower())]


def _open_folder(folder: Path) -> ImageStack:
    whole, images = whole_recordings(folder), image_files(folder)
    if len(whole) == 1 and not images:
        return open_stack(whole[0])
    if len(images) == 1 and all(file.suffix.lower() == ".npy" for file in whole):
        return open_stack(images[0])  # arrays next to a TIFF describe it
    if whole or not images:
        raise EndoctError(
            f"{folder} holds no recording" if not whole else f"{folder} holds more than one recording",
            found=f"{len(images)} images, {len(whole)} .npy files or videos",
            expected="one TIFF, one .npy, one video or numbered images",
        )
    return ImageStack(folder, len(images), _ReadImages(tuple(images)), tuple(images))
