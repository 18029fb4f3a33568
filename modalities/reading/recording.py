"""Stacks of equal frames, read one at a time: a file of one of the formats, or a folder of them or of images."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import entries, exists, is_folder, open_regular, state_of
from endoct.modalities.reading.arrays_on_disk import NPY
from endoct.modalities.reading.dicom_recording import PICTURES
from endoct.modalities.reading.format import Files, Format, Stated
from endoct.modalities.reading.frame_files import choose_frames
from endoct.modalities.reading.images import ReadImages, read_single
from endoct.modalities.reading.ivoct import IVOCT
from endoct.modalities.reading.lightlab import LIGHTLAB
from endoct.modalities.reading.logs import LOGS
from endoct.modalities.reading.numbering import Along
from endoct.modalities.reading.ome_tiff import OME_TIFF
from endoct.modalities.reading.ome_zarr import OME_ZARR
from endoct.modalities.reading.other_formats import kind_not_read
from endoct.modalities.reading.remarks import NONE, Remarks, remarks_of
from endoct.modalities.reading.repeated_frames import fingerprint, on_repeated, same_picture, without_colour
from endoct.modalities.reading.thorlabs import THORLABS
from endoct.modalities.reading.tiff import TIFF, TIFF_SUFFIXES
from endoct.modalities.reading.video import VIDEO

FORMATS: tuple[Format, ...] = (NPY, LIGHTLAB, OME_TIFF, TIFF, THORLABS, VIDEO, IVOCT, PICTURES, OME_ZARR, LOGS)
"""They are asked in this order. What none of them claims is an image, or of no readable kind."""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", *TIFF_SUFFIXES)


SAMPLES = (np.uint8, np.uint16, np.float32)
"""All that reads frames takes these types of samples, and no others."""


class ImageStack:
    """A sized, indexable, picklable stack of frames; indexing reads one frame from disk.

    ``stack[i]`` is a read-only array of one of :data:`SAMPLES`, (row, column) or (row, column, channel) with channels
    as RGB; transparency is dropped, and what a file holds in another type is float32. Raises :class:`EndoctError` where
    a file is truncated or unreadable, or a frame differs in shape or dtype from the first, or is not finite. ``along``
    is what the files say of where frames lie; ``remarks`` what is to be said of the files, frames that repeat others
    among it, as far as they were read.
    """

    def __init__(
        self,
        path: Path,
        n_frames: int,
        read: Callable[[int], NDArray[Any]],
        *,
        along: Along | None = None,
        remarks: Remarks = NONE,
        grey: bool = False,
    ) -> None:
        self.path, self._grey = path, grey
        self.along = along
        self._n_frames = n_frames
        self.reader = read
        self._remarks = remarks
        self._prints: dict[int, bytes] = {}
        self._only: NDArray[Any] | None = None
        first = self._frame(0)
        self.frame_shape: tuple[int, ...] = first.shape
        self.dtype: np.dtype[Any] = first.dtype

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
        self._prints[index] = fingerprint(frame)
        return frame

    def with_remarks(self, remarks: Remarks) -> "ImageStack":
        """Return the stack with ``remarks`` before its own."""
        return self._copied(remarks + self._remarks, grey=self._grey)

    def grey(self) -> "ImageStack":
        """Return the stack with frames of three equal colours as (row, column); itself where some have others.

        Three frames are looked at. Reading another one that has colours raises :class:`EndoctError`.
        """
        if len(self.frame_shape) != 3 or self.frame_shape[2] != 3:
            return self
        greys = [without_colour(frame) for frame in some_frames(self)]
        if any(grey is None for grey in greys) or not any(np.ptp(grey) for grey in greys if grey is not None):
            return self
        return self._copied(self._remarks, grey=True)

    @property
    def remarks(self) -> Remarks:
        """What is to be said of the files, and of the frames that were read so far."""
        return self._remarks + remarks_of(self.reader) + on_repeated(self._prints, self._frame)

    @property
    def pixel_aspect(self) -> float:
        """How many times as wide as high the file says that a pixel is, 1 where it does not; as far as it was read."""
        aspect = float(getattr(self.reader, "pixel_aspect", 1.0))
        return aspect if np.isfinite(aspect) and aspect > 0 else 1.0

    @property
    def palette(self) -> NDArray[Any] | None:
        """The colours of a TIFF whose samples are their numbers, (n,) grey or (n, 3); None for any other file."""
        return getattr(self.reader, "palette", None)

    def stored(self, index: int) -> NDArray[Any]:
        """Return a frame as its file holds it: with transparency, and with numbers of colours for these."""
        return np.asarray(getattr(self.reader, "stored", self._decoded)(index))

    def _copied(self, remarks: Remarks, *, grey: bool) -> "ImageStack":
        return ImageStack(self.path, len(self), self.reader, along=self.along, remarks=remarks, grey=grey)

    def _decoded(self, index: int) -> NDArray[Any]:
        """Return a frame as its reader gives it; the only one of a stack is read once."""
        if len(self) > 1:
            return self.reader(index)
        if self._only is None:
            self._only = self.reader(index)
            self._only.flags.writeable = False
        return self._only

    def _frame(self, index: int) -> NDArray[Any]:
        frame = self._decoded(index)
        if frame.ndim == 3 and frame.shape[2] in (1, 2, 4):
            frame = frame[..., :3] if frame.shape[2] == 4 else frame[..., 0]
        if self._grey:
            grey = without_colour(frame)
            if grey is None:
                what, remedy = f"frame {index} of {self.path} has colours", "export the recording again as grey images"
                raise EndoctError(what, expected="grey, as the first", remedy=remedy)
            frame = grey
        if frame.dtype in SAMPLES or frame.dtype.kind not in "uif":
            return frame
        with np.errstate(over="ignore"):  # what is beyond float32 is not finite, and refused so
            return frame.astype(np.float32)


def open_stack(path: Path) -> ImageStack:
    """Open a file of one of the formats, or a folder that holds such files, or numbered images.

    Only the first frame is read. Raises :class:`EndoctError` where there is nothing to read.
    """
    if not exists(path):
        raise EndoctError(f"{path} does not exist", remedy="check the path")
    if not is_folder(path):
        with open_regular(path) as file:
            if not file.read(1):
                raise EndoctError(f"{path} is empty", found="0 bytes", remedy="copy or export the recording again")
    if (located := _located(path)) is not None:
        form, files = located
        if files[0] != path and len(files) == 1:
            return open_stack(files[0])
        opened = form.open(files)
        return ImageStack(path, opened.n_frames, opened.read, along=opened.along, remarks=opened.remarks)
    if is_folder(path):
        return _open_folder(path)
    if (kind := kind_not_read(path)) is not None:
        raise kind.refusal(path)
    return ImageStack(path, 1, ReadImages((path,)))


def stated_by(path: Path) -> Stated:
    """Return which keys of a sidecar the files of the recording at ``path`` state; none where nothing is read there.

    Raises :class:`EndoctError` where what they state cannot be read.
    """
    if is_folder(path) and len(images := _images(path)) == 1:
        path = images[0]
    if not exists(path) or (located := _located(path)) is None:
        return Stated()
    form, files = located
    if form.is_folder:
        return form.states(files)
    around = {file.parent.stat().st_mtime_ns for file in files}  # a chirp may lie next to a recording
    return _stated_by_files(form, files, (tuple(tuple(state_of(file).values()) for file in files), frozenset(around)))


@lru_cache(maxsize=8)  # what files state is asked for again and again, and may be in the headers of hundreds
def _stated_by_files(form: Format, files: Files, _states: object) -> Stated:
    return form.states(files)


def files_of(path: Path, form: Format) -> Files | None:
    """Return the files of the recording at ``path``, if ``form`` is their format."""
    located = _located(path) if exists(path) else None
    return located[1] if located is not None and located[0] is form else None


def format_of(path: Path) -> str | None:
    """Return what the recording at ``path`` is stored as, in words; None where that is none of the formats.

    Raises :class:`EndoctError` where a folder cannot be read.
    """
    if (located := _located(path)) is not None:
        form, files = located
        return form.name + (f", {len(files)} files" if len(files) > 1 else "")
    images = _images(path) if is_folder(path) else [path] if path.suffix.lower() in IMAGE_SUFFIXES else []
    if len(images) == 1 and (of_image := _format_of(images[0])) is not None:
        return of_image.name
    kinds = sorted({file.suffix.lower().removeprefix(".") for file in images})
    return f"{len(images)} image{'s' if len(images) > 1 else ''} ({', '.join(kinds)})" if images else None


def _located(path: Path) -> tuple[Format, Files] | None:
    """Return the format of the recording at ``path``, with its files; None for images, and for what is not clear."""
    if (form := _format_of(path)) is not None:
        return form, (path,)
    if not is_folder(path) or _images(path):
        return None
    whole = whole_recordings(path)
    forms = {_format_of(file) for file in whole}
    if len(forms) != 1 or (form := forms.pop()) is None or (len(whole) > 1 and not form.joins):
        return None
    return form, tuple(whole)


def _format_of(path: Path) -> Format | None:
    """Return the format that claims a file or a folder, None where none does."""
    folder = is_folder(path)
    return next((form for form in FORMATS if form.is_folder == folder and form.claims(path)), None)


def gives_frames(path: Path) -> bool:
    """Say whether there is something at ``path`` to look for frames in: a file of one of the formats, or images."""
    if _format_of(path) is not None:
        return True
    return bool(_images(path) or whole_recordings(path)) if is_folder(path) else path.suffix.lower() in IMAGE_SUFFIXES


def some_frames(stack: ImageStack) -> list[NDArray[Any]]:
    """Return the first, the middle and the last frame, of a short recording fewer. Raises what reading one does."""
    return [stack[index] for index in sorted({0, (len(stack) - 1) // 2, len(stack) - 1})]


def _images(folder: Path) -> list[Path]:
    return [file for file in entries(folder) if file.suffix.lower() in IMAGE_SUFFIXES]


def _alike(file: Path, other: Path) -> bool:
    """Say whether two files hold the same pixels, grey or in three equal colours, in 8 bits or in 16."""
    return same_picture(read_single(file)[0], read_single(other)[0])


def whole_recordings(folder: Path) -> list[Path]:
    """Return what in ``folder`` is of one of the formats: each may hold a recording by itself.

    A TIFF that is named as one is an image among others.
    """
    others = (file for file in entries(folder) if file.suffix.lower() not in IMAGE_SUFFIXES)
    return sorted(file for file in others if _format_of(file) is not None)


def _open_folder(folder: Path) -> ImageStack:
    whole, images = whole_recordings(folder), _images(folder)
    if images and all(file.suffix.lower() == ".npy" for file in whole):
        chosen = choose_frames(folder, images, _alike)
        if len(chosen.files) == 1:
            return open_stack(chosen.files[0]).with_remarks(chosen.remarks)  # arrays next to a TIFF describe it
        if not whole:
            files = chosen.files
            return ImageStack(folder, len(files), ReadImages(files), along=chosen.along, remarks=chosen.remarks)
    if not whole and not images and (refusal := refusal_of(folder)) is not None:
        raise refusal
    raise EndoctError(
        f"{folder} holds no recording" if not whole else f"{folder} holds more than one recording",
        found=f"{len(images)} images, {len(whole)} .npy files or videos",
        expected="one TIFF, one .npy, one video or numbered images",
    )


def refusal_of(path: Path) -> EndoctError | None:
    """Return what to say of a file of a known kind that is not read, or of a folder with one; None for others."""
    for file in sorted(entries(path)) if is_folder(path) else [path]:
        if (kind := kind_not_read(file)) is not None:
            return kind.refusal(file)
    return None
