"""What stored numbers mean: frames coded in every way that shows the same picture, and masks as people draw them."""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from benchmarks.frame_faults.drawn import Frames, Truth, drawn, with_sidecar
from endoct.modalities.reading.orientation import upright

Write = Callable[[Path, Random], Truth]
_STORED_AS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 6: 8, 7: 7, 8: 6}
"""The orientation that undoes each."""


def _folder(code: Callable[[Path, Frames, Random, Any], None], draw: Callable[[Random], Any] = lambda _: None) -> Write:
    """Return what writes a folder of images, each coded by ``code``, with what was drawn once for all of them."""

    def write(folder: Path, rng: Random) -> Truth:
        truth, how = drawn(rng), draw(rng)
        for k, frame in enumerate(truth.frames):
            code(folder / f"f{k:03d}", frame, rng, how)
        with_sidecar(folder, "oct")
        return truth

    return write


def _tiff(code: Callable[[Path, Frames, Random], None]) -> Write:
    """Return what writes a stack in one TIFF."""

    def write(folder: Path, rng: Random) -> Truth:
        truth = drawn(rng)
        code(folder / "stack.tif", truth.frames, rng)
        with_sidecar(folder, "oct")
        return truth

    return write


def _grey_palette(path: Path, frame: Frames, rng: Random, suffix: str) -> None:
    order = list(range(256))
    rng.shuffle(order)
    number = np.argsort(order).astype(np.uint8)
    image = Image.fromarray(number[frame], "P")
    image.putpalette([value for value in order for _ in range(3)])
    image.save(path.with_suffix(suffix))


def _channels(path: Path, frame: Frames, _: Random, how: tuple[str, str]) -> None:
    mode, suffix = how
    layers = [frame] * (3 if "RGB" in mode else 1) + [np.full_like(frame, 255)] * mode.endswith("A")
    Image.fromarray(np.stack(layers, axis=-1), mode).save(path.with_suffix(suffix))


def _oriented(path: Path, frame: Frames, _: Random, how: tuple[int, str]) -> None:
    orientation, suffix = how
    stored = np.ascontiguousarray(upright(frame, _STORED_AS[orientation]))
    if suffix == ".tif":
        extra = [(274, "H", 1, orientation, True)]
        tifffile.imwrite(path.with_suffix(suffix), stored, photometric="minisblack", extratags=extra)
        return
    exif = Image.Exif()
    exif[274] = orientation
    Image.fromarray(stored).save(path.with_suffix(suffix), exif=exif)


def _coloured(path: Path, frame: Frames, rng: Random, _: Any) -> None:
    colours = np.stack([frame, 255 - frame, frame // 2], axis=-1)
    Image.fromarray(colours).save(path.with_suffix(rng.choice((".png", ".tif"))))


def _white_is_zero(path: Path, frames: Frames, rng: Random) -> None:
    packed = rng.choice((None, "zlib"))
    tifffile.imwrite(path, 255 - frames, photometric="miniswhite", compression=packed, metadata=None)


def _palette_stack(path: Path, frames: Frames, rng: Random) -> None:
    order = np.array(rng.sample(range(256), 256), np.uint16)
    colourmap = np.tile(order * 257, (3, 1))
    tifffile.imwrite(path, np.argsort(order).astype(np.uint8)[frames], photometric="palette", colormap=colourmap)


def _mixed(path: Path, frames: Frames, rng: Random) -> None:
    """Pages of which one alone has white as 0, or another orientation."""
    odd = rng.randrange(1, len(frames))
    turned = rng.random() < 0.5
    with tifffile.TiffWriter(path) as writer:
        for k, frame in enumerate(frames):
            extra = [(274, "H", 1, 3, True)] if turned and k == odd else []
            how = "miniswhite" if k == odd and not turned else "minisblack"
            stored = 255 - frame if how == "miniswhite" else frame
            writer.write(stored[::-1, ::-1] if extra else stored, photometric=how, extratags=extra, metadata=None)


def _repeated_pages(path: Path, frames: Frames, rng: Random) -> None:
    k = rng.randrange(1, len(frames))
    frames = frames.copy()
    frames[k] = frames[rng.randrange(k)]
    if rng.random() < 0.5:
        np.save(path.with_suffix(".npy"), frames)
    else:
        tifffile.imwrite(path, frames, photometric="minisblack", compression=rng.choice((None, "zlib")))


CODED: Mapping[str, Write] = {
    "white is 0": _tiff(_white_is_zero),
    "grey palette": _folder(_grey_palette, lambda rng: rng.choice((".png", ".bmp", ".tif"))),
    "grey palette, stack": _tiff(_palette_stack),
    "grey in channels": _folder(
        _channels, lambda rng: (rng.choice(("LA", "RGB", "RGBA")), rng.choice((".png", ".tif")))
    ),
    "orientation": _folder(_oriented, lambda rng: (rng.randint(1, 8), rng.choice((".tif", ".png")))),
    "colours": _folder(_coloured),
    "one page otherwise": _tiff(_mixed),
    "pages repeated": _tiff(_repeated_pages),
}


@dataclass(frozen=True, eq=False)
class DrawnCells:
    """A mask in a file, and which samples are cell."""

    path: Path
    cells: NDArray[np.bool_]


def mask(folder: Path, rng: Random) -> DrawnCells:
    """Write a mask as one of many programs would, with few cells on much wall."""
    cells = np.zeros((40, 120), np.bool_)
    for _ in range(rng.randint(1, 4)):
        row, column, size = rng.randrange(30), rng.randrange(100), rng.randint(3, 9)
        cells[row : row + size, column : column + size] = True
    ways: tuple[Callable[[Path, NDArray[np.bool_], Random], Path], ...] = (
        _grey, _on_transparent, _on_transparent_grey, _white_is_zero_mask, _bilevel, _labels, _palette_mask, _turned,
    )  # fmt: skip
    return DrawnCells(rng.choice(ways)(folder / "mask", cells, rng), cells)


def _grey(path: Path, cells: NDArray[np.bool_], rng: Random) -> Path:
    path = path.with_suffix(rng.choice((".png", ".tif", ".bmp")))
    Image.fromarray((cells * rng.choice((1, 255))).astype(np.uint8)).save(path)
    return path


def _on_transparent(path: Path, cells: NDArray[np.bool_], rng: Random) -> Path:
    under, colour = rng.choice(((0, 0, 0), (255, 255, 255))), rng.choice(((255, 0, 0), (0, 0, 0), (255, 255, 255)))
    image = np.full((*cells.shape, 4), (*under, 0), np.uint8)
    image[cells] = (*colour, rng.choice((255, 120)))
    path = path.with_suffix(rng.choice((".png", ".tif")))
    Image.fromarray(image).save(path)
    return path


def _on_transparent_grey(path: Path, cells: NDArray[np.bool_], rng: Random) -> Path:
    image = np.full((*cells.shape, 2), (rng.choice((0, 255)), 0), np.uint8)
    image[cells] = (rng.choice((0, 200, 255)), 255)
    Image.fromarray(image, "LA").save(path.with_suffix(".png"))
    return path.with_suffix(".png")


def _white_is_zero_mask(path: Path, cells: NDArray[np.bool_], rng: Random) -> Path:
    dtype = rng.choice((np.uint8, np.uint16))
    stored = np.where(cells, 0, np.iinfo(dtype).max).astype(dtype)
    tifffile.imwrite(path.with_suffix(".tif"), stored, photometric="miniswhite")
    return path.with_suffix(".tif")


def _bilevel(path: Path, cells: NDArray[np.bool_], rng: Random) -> Path:
    path = path.with_suffix(rng.choice((".png", ".tif")))
    Image.fromarray(cells).save(path)
    return path


def _labels(path: Path, cells: NDArray[np.bool_], rng: Random) -> Path:
    labels = np.where(cells, 1 + np.arange(cells.shape[1]) // 30, 0).astype(rng.choice((np.uint8, np.uint16, np.int32)))
    tifffile.imwrite(path.with_suffix(".tif"), labels, photometric="minisblack")
    return path.with_suffix(".tif")


def _palette_mask(path: Path, cells: NDArray[np.bool_], rng: Random) -> Path:
    """Two colours by number, the cells white on black or any colour; as optimisers order them."""
    first = rng.random() < 0.5
    image = Image.fromarray((cells != first).astype(np.uint8), "P")
    cell = rng.choice(((255, 255, 255), (200, 30, 30)))
    image.putpalette([*cell, 0, 0, 0] if first else [0, 0, 0, *cell])
    image.save(path.with_suffix(".png"))
    return path.with_suffix(".png")


def _turned(path: Path, cells: NDArray[np.bool_], rng: Random) -> Path:
    orientation = rng.randint(2, 8)
    stored = upright(cells.astype(np.uint8) * 255, _STORED_AS[orientation])
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, stored, photometric="minisblack", extratags=[(274, "H", 1, orientation, True)])
    path.with_suffix(".tif").write_bytes(buffer.getvalue())
    return path.with_suffix(".tif")
