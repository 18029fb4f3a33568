"""What stored numbers mean: frames coded in every way that shows the same picture."""

from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import tifffile
from PIL import Image

from benchmarks.frame_faults.drawn import Frames, Truth, drawn, with_sidecar
from endoct.modalities.reading.orientation import upright

Write = Callable[[Path, Random], Truth]
STORED_AS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 6: 8, 7: 7, 8: 6}
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
    stored = np.ascontiguousarray(upright(frame, STORED_AS[orientation]))
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
