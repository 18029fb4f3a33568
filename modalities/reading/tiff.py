"""Frames of a TIFF or BigTIFF, read one at a time, and of any file in which they lie uncompressed."""

import math
import re
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import open_regular, read_start
from endoct.modalities.reading.arrays_on_disk import ReadBlocks
from endoct.modalities.reading.format import Format, Frames
from endoct.modalities.reading.orientation import UPRIGHT, on_orientation, upright
from endoct.modalities.reading.remarks import Remarks
from endoct.modalities.reading.repeated_frames import without_colour
from endoct.modalities.reading.tiff_directory import (
    FOREIGN,
    MOST_PAGES,
    PALETTE,
    STARTS,
    WHITE_IS_ZERO,
    Layout,
    Page,
    damaged,
    pages,
    size_of,
    truncated,
)
from endoct.modalities.reading.tiff_page import ReadPages

TIFF_SUFFIXES = (".tif", ".tiff", ".btf", ".tf8")
T = TypeVar("T")
MOST_DESCRIPTION = 100_000
_UNCALIBRATED = "20"
"""ImageJ's number of no function."""


def is_tiff(path: Path) -> bool:
    """Say whether the file starts as a TIFF or BigTIFF does."""
    return read_start(path, 4) in STARTS


def of_first_page(path: Path, of: Callable[[Page, BinaryIO], T]) -> T | None:
    """Return what ``of`` says of the first page of a TIFF; None for another file, and for a damaged one."""
    try:
        with open_regular(path) as file:
            return of(next(pages(path, file)), file) if is_tiff(path) else None
    except (EndoctError, OSError, ValueError):
        return None


def read_tiff(path: Path) -> "tuple[int, ReadTiff]":
    """Return the number of frames of a TIFF, and what reads one. Raises :class:`EndoctError` where it is no stack.

    A frame is a page; only what ImageJ and tifffile write as one page before all samples of a stack is more.
    """
    with refusing(f"{path} is no readable TIFF", remedy="copy or export it again"), open_regular(path) as file:
        places = array("q")
        for page in pages(path, file):
            places.append(page.place)
            if len(places) == 1:
                first, layout = page, page.layout(file)
                palette = _palette(page, file, layout) if layout.photometric == PALETTE else None
            elif (other := page.layout(file)) != layout:
                raise EndoctError(
                    f"{path} mixes pages",
                    found=f"{_described(other)} after {_described(layout)}",
                    expected="pages of one kind",
                    remedy="remove the others, or export the recording again",
                )
        stacked, calibrated = _frames_declared(first, file, layout), _calibrated(first, file)
        n_frames = len(places)
        read: Callable[[int], NDArray[Any]] = ReadPages(path, places, layout)
        if n_frames == 1 and stacked > 1:
            n_frames, read = stacked, _stack_in_one_page(first, file, layout, stacked)
        else:
            for end in (first, page):  # a copy that was cut off lacks the last
                end.segments(file, layout)
        return n_frames, ReadTiff(read, layout, palette, calibrated, layout.pixel_aspect)


@dataclass(frozen=True, eq=False)
class ReadTiff:
    """Reads one frame as it is to be seen: samples turned over where 0 is white, colours for their numbers, upright.

    ``calibrated``: what ImageJ adds to samples, and before that multiplies them by; empty where it does nothing.
    ``order``: which of the frames as they lie in the file is which; None where they lie in their order.
    """

    read: Callable[[int], NDArray[Any]]
    layout: Layout
    palette: NDArray[Any] | None
    calibrated: tuple[float, ...]
    pixel_aspect: float
    order: tuple[int, ...] | None = None

    @property
    def remarks(self) -> Remarks:
        """What was done to all frames."""
        notes = []
        if self.layout.photometric == WHITE_IS_ZERO:
            notes.append("The TIFF says that 0 is white (WhiteIsZero); its samples were turned over: 0 is black now.")
        if self.calibrated:
            c0, c1 = self.calibrated
            notes.append(f"ImageJ's calibration was applied, as Fiji shows values: {c0:g} + {c1:g} × what is stored.")
        return Remarks(notes=tuple(notes)) + on_orientation(self.layout.orientation)

    def stored(self, index: int) -> NDArray[Any]:
        """Return one frame, upright, black as 0; numbers of colours where there is a palette."""
        frame = self.read(index if self.order is None else self.order[index])
        if frame.dtype == np.bool_:
            frame = frame.astype(np.uint8) * np.uint8(1 if self.palette is not None else 255)
        if self.layout.photometric == WHITE_IS_ZERO:
            whole = frame.dtype.type(255 if self.layout.bits == 1 else (1 << self.layout.bits) - 1)
            grey = whole - frame
            if frame.ndim == 3:  # the others are transparency
                grey[..., 1:] = frame[..., 1:]
            frame = grey
        return upright(frame, self.layout.orientation)

    def __call__(self, index: int) -> NDArray[Any]:
        """Return one frame."""
        frame = self.stored(index)
        if self.palette is not None:
            return self.palette[frame.astype(np.intp, copy=False)]
        if not self.calibrated:
            return frame
        c0, c1 = self.calibrated
        return (c0 + c1 * frame.astype(np.float64)).astype(np.float32)


def _of_imagej(description: str) -> dict[str, str]:
    """Return what ImageJ writes into a description, "ImageJ" among it; nothing for anybody else's."""
    lines = re.findall(r"^(\w+)=(\S{1,40})\s*$", description, re.MULTILINE)
    return dict(lines) if description.startswith("ImageJ=") else {}


def _calibrated(page: Page, file: BinaryIO) -> tuple[float, ...]:
    """Return the line, (c0, c1), by which ImageJ shows the samples of a file; none where it shows them as they are.

    Raises :class:`EndoctError` where it shows them by a curve.
    """
    stated = _of_imagej(page.text(file, 270, MOST_DESCRIPTION))
    if stated.get("cf", _UNCALIBRATED) == _UNCALIBRATED:
        return ()
    try:
        line = float(stated["c0"]), float(stated["c1"])
    except (KeyError, ValueError):
        line = (math.nan, math.nan)
    if stated["cf"] != "0" or not all(map(math.isfinite, line)) or not line[1]:
        raise EndoctError(
            f"{page.path} is calibrated in a way that is not read",
            found=f"ImageJ's function {stated['cf']}",
            expected="a straight line, cf=0",
            remedy="set the function to None under Analyze > Calibrate, and save it again",
        )
    return () if line == (0.0, 1.0) else line


def _frames_declared(page: Page, file: BinaryIO, layout: Layout) -> int:
    """Return how many frames the description of the first page declares, 1 where it declares none.

    Raises :class:`EndoctError` where it declares several axes of frames, such as colours and slices: they would be
    taken for each other.
    """
    if foreign := [name for tag, name in FOREIGN.items() if tag in page.tags]:
        raise EndoctError(f"{page.path} is a {foreign[0]} file", remedy="export it as a plain TIFF, one page a frame")
    text = page.text(file, 270, MOST_DESCRIPTION)
    samples = layout.shape[2] if len(layout.shape) > 2 else 1
    axes: list[int] = []
    images = 1
    if stated := _of_imagej(text):
        declared = {key: int(value) for key, value in stated.items() if re.fullmatch(r"\d{1,9}", value)}
        channels = declared.get("channels", 1)
        axes = [1 if channels == samples else channels, declared.get("slices", 1), declared.get("frames", 1)]
        images = declared.get("images", 1)
    elif shaped := re.match(r'\{"shape": \[([\d, ]{1,200})\]', text):
        shape = tuple(int(size) for size in shaped[1].split(",") if size.strip().isdecimal())
        axes = list(shape[: len(shape) - len(layout.shape)])
        if '"truncated": true' not in text:
            images = 0  # every frame has its page
    several = [size for size in axes if size > 1]
    if len(several) > 1:
        raise EndoctError(
            f"{page.path} has the wrong dimensions",
            found=f"{' × '.join(map(str, several))} pages of {_described(layout)}",
            expected="a stack of images, one page a frame",
        )
    return max([images, *several]) if images else 1


def _palette(page: Page, file: BinaryIO, layout: Layout) -> NDArray[Any]:
    """Return the colours that samples number: (n,) grey, or (n, 3); u8, or u16 where they need more bits."""
    n = 1 << layout.bits
    colours = np.array(page.numbers(file, 320, most=3 << 16), np.uint16)
    if colours.size != 3 * n:
        damaged(page.path, f"{colours.size} values in a palette of {n} colours")
    colours = colours.reshape(3, n).T
    if colours.max() < 256:  # some writers count colours from 0 to 255
        colours = colours.astype(np.uint8)
    elif (colours % 257 == 0).all() or (colours % 256 == 0).all():
        colours = (colours >> 8).astype(np.uint8)
    grey = without_colour(colours[None])
    return colours if grey is None else grey[0]


def _stack_in_one_page(page: Page, file: BinaryIO, layout: Layout, n_frames: int) -> ReadBlocks:
    offset = page.plain_offset(file, layout)
    if offset is None or n_frames > 16 * MOST_PAGES:
        damaged(page.path, f"{n_frames} frames" + " in one page that is compressed" * (offset is None))
    needed = offset + n_frames * math.prod(layout.shape) * layout.dtype.itemsize
    if (size := size_of(file)) < needed:
        truncated(page.path, size, needed)
    return ReadBlocks(page.path, offset, layout.dtype.newbyteorder(page.order), layout.shape)


def _described(layout: Layout) -> str:
    how = f"{layout.dtype} {' × '.join(map(str, layout.shape))}"
    how += {WHITE_IS_ZERO: ", 0 is white", PALETTE: ", colours by number"}.get(layout.photometric, "")
    return how + (f", orientation {layout.orientation}" if layout.orientation != UPRIGHT else "")


TIFF = Format("TIFF", is_tiff, lambda files: Frames(*read_tiff(files[0])))
