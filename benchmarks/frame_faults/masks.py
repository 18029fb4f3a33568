"""Masks as people draw and save them, each with what is true of it, or with what keeps anybody from knowing it."""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import roifile
import tifffile
import zarr
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

from benchmarks.frame_faults.pictures import STORED_AS
from endoct.modalities.reading.orientation import upright

Cells = NDArray[np.bool_]
Write = Callable[[Path, Cells, Random], Path]
"""Writes cells to a path without suffix, and returns the path that was written."""
SHAPE = (60, 160)


def cells(rng: Random) -> Cells:
    """Return a wall with a few round cells on it, which may touch and lie on the seam, bool."""
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    drawn = np.zeros(SHAPE, np.bool_)
    for _ in range(rng.randint(2, 7)):
        row, column, radius = rng.randrange(5, 55), rng.randrange(SHAPE[1]), rng.uniform(3, 9)
        around = np.abs(columns - column)
        drawn |= np.hypot(rows - row, np.minimum(around, SHAPE[1] - around)) <= radius
    return drawn


def _numbered(drawn: Cells) -> NDArray[np.int32]:
    from skimage.measure import label

    return np.asarray(label(drawn, connectivity=1), np.int32)


def _soft(drawn: Cells, rng: Random) -> NDArray[np.float64]:
    return np.asarray(gaussian_filter(drawn.astype(float), rng.uniform(0.5, 2.5)))


def _wall(rng: Random) -> NDArray[np.uint8]:
    noise = np.random.default_rng(rng.randrange(1 << 30))
    wall = gaussian_filter(noise.normal(size=SHAPE), rng.uniform(0, 2))
    grey = np.clip(128 + 40 * wall / wall.std(), 1, 255).astype(np.uint8)
    grey[rng.randrange(50) :][:2] = 0  # a seam, or a slice that is missing
    return grey


def _image(path: Path, samples: NDArray[Any], suffix: str, mode: str | None = None) -> Path:
    Image.fromarray(samples, mode).save(path.with_suffix(suffix))
    return path.with_suffix(suffix)


def _tiff(path: Path, samples: NDArray[Any], **options: Any) -> Path:
    tifffile.imwrite(path.with_suffix(".tif"), samples, **{"photometric": "minisblack", **options})
    return path.with_suffix(".tif")


def _grey(path: Path, drawn: Cells, rng: Random) -> Path:
    return _image(path, (drawn * rng.choice((1, 255))).astype(np.uint8), rng.choice((".png", ".tif", ".bmp")))


def _grey_16(path: Path, drawn: Cells, rng: Random) -> Path:
    return _tiff(path, drawn * np.uint16(rng.choice((1, 255, 4095, 65535))), compression=rng.choice((None, "zlib")))


def _two_floats(path: Path, drawn: Cells, rng: Random) -> Path:
    return _tiff(path, drawn * np.float32(rng.choice((1.0, 255.0))))


def _colour(path: Path, drawn: Cells, rng: Random) -> Path:
    colour = rng.choice(((255, 255, 255), (255, 0, 0), (0, 0, 90)))
    return _image(path, drawn[..., None] * np.array(colour, np.uint8), rng.choice((".png", ".tif", ".bmp")))


def _on_transparent(path: Path, drawn: Cells, rng: Random) -> Path:
    under, colour = rng.choice(((0, 0, 0), (255, 255, 255))), rng.choice(((255, 0, 0), (0, 0, 0), (255, 255, 255)))
    image = np.full((*drawn.shape, 4), (*under, 0), np.uint8)
    image[drawn] = (*colour, rng.choice((255, 120)))
    return _image(path, image, rng.choice((".png", ".tif")))


def _on_transparent_grey(path: Path, drawn: Cells, rng: Random) -> Path:
    image = np.full((*drawn.shape, 2), (rng.choice((0, 255)), 0), np.uint8)
    image[drawn] = (rng.choice((0, 200, 255)), 255)
    return _image(path, image, ".png", "LA")


def _white_is_zero(path: Path, drawn: Cells, rng: Random) -> Path:
    dtype = rng.choice((np.uint8, np.uint16))
    return _tiff(path, np.where(drawn, 0, np.iinfo(dtype).max).astype(dtype), photometric="miniswhite")


def _bilevel(path: Path, drawn: Cells, rng: Random) -> Path:
    return _image(path, drawn, rng.choice((".png", ".tif")))


def _labels(path: Path, drawn: Cells, rng: Random) -> Path:
    """Labels of cells as they follow each other, some deleted, or of any number, as a crop of a larger image has."""
    numbered = _numbered(drawn)
    beyond = rng.choice((0, 0, 700, 100_000))
    dtype = rng.choice((np.int32, np.float32) if beyond > 65535 else (np.uint16, np.int32, np.float32))
    return _tiff(path, np.where(drawn, numbered + beyond, 0).astype(dtype))


def _touching_labels(path: Path, drawn: Cells, rng: Random) -> Path:
    """Cells that are cut where they grew together, each part a label."""
    at = rng.randrange(20, 140)
    cut = 2 * _numbered(drawn) - (np.arange(drawn.shape[1]) < at)
    if rng.random() < 0.3:
        zarr.create_array(path.with_suffix(".zarr"), data=np.where(drawn, cut, 0).astype(np.uint16))
        return path.with_suffix(".zarr")
    return _tiff(path, np.where(drawn, cut, 0).astype(np.uint8))


def _label_palette(path: Path, drawn: Cells, rng: Random) -> Path:
    """Labels with a colour each, as annotation programs save them: 0 is black or transparent."""
    image = Image.fromarray(np.where(drawn, _numbered(drawn), 0).astype(np.uint8), "P")
    see_through = rng.random() < 0.3
    ground = [255, 255, 255] if see_through else [0, 0, 0]
    image.putpalette([*ground, *(rng.randrange(1, 256) for _ in range(3 * rng.choice((15, 255))))])
    image.save(path.with_suffix(".png"), **({"transparency": 0} if see_through else {}))
    return path.with_suffix(".png")


def _two_colour_palette(path: Path, drawn: Cells, rng: Random) -> Path:
    """Two colours by number, the cells white on black or any colour; as optimisers order them."""
    first = rng.random() < 0.5
    image = Image.fromarray((drawn != first).astype(np.uint8), "P")
    cell = rng.choice(((255, 255, 255), (200, 30, 30)))
    image.putpalette([*cell, 0, 0, 0] if first else [0, 0, 0, *cell])
    image.save(path.with_suffix(".png"))
    return path.with_suffix(".png")


def _turned(path: Path, drawn: Cells, rng: Random) -> Path:
    orientation = rng.randint(2, 8)
    stored = upright(drawn.astype(np.uint8) * 255, STORED_AS[orientation])
    if rng.random() < 0.5:
        image, exif = Image.fromarray(stored // 255, "P"), Image.Exif()
        image.putpalette([0, 0, 0, 255, 0, 0])
        exif[274] = orientation
        image.save(path.with_suffix(".png"), exif=exif)
        return path.with_suffix(".png")
    return _tiff(path, stored, extratags=[(274, "H", 1, orientation, True)])


def _composite(path: Path, drawn: Cells, _: Random) -> Path:
    """All cells, with their holes, as one composed region of Fiji: the edges of samples, from corner to corner."""
    segments: list[float] = []
    for row, column in np.argwhere(drawn):  # an area's outlines may be laid piece by piece
        corners = ((column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1))
        for kind, corner in zip((0, 1, 1, 1), corners, strict=True):
            segments += [kind, *map(float, corner)]
        segments.append(4)
    return _region(path, segments)


def _ring(path: Path, drawn: Cells, rng: Random) -> Path:
    """A square with a square hole, and an island in it; ``drawn`` becomes that."""
    row, column, size = rng.randrange(2, 30), rng.randrange(2, 120), rng.randrange(12, 28)
    drawn[...] = False
    segments: list[float] = []
    for k, inset in enumerate((0, rng.randint(2, 3), rng.randint(4, 5))):
        low_row, low_column, high = row + inset, column + inset, size - 2 * inset
        drawn[low_row : low_row + high, low_column : low_column + high] = k % 2 == 0
        corners = ((0, 0), (high, 0), (high, high), (0, high))
        for kind, (x, y) in zip((0, 1, 1, 1), corners, strict=True):
            segments += [kind, float(low_column + x), float(low_row + y)]
        segments.append(4)
    return _region(path, segments)


def _region(path: Path, segments: list[float]) -> Path:
    region = roifile.ImagejRoi(
        roitype=roifile.ROI_TYPE.RECT, shape_roi_size=len(segments), multi_coordinates=np.array(segments, np.float32)
    )
    region.tofile(path.with_suffix(".roi"))
    return path.with_suffix(".roi")


def _inverting(path: Path, drawn: Cells, rng: Random) -> Path:
    """255 in cells, shown black on white, as Fiji saves a binary image with its inverting table."""
    stored = drawn.astype(np.uint8) * 255
    way = rng.choice((".png", ".bmp", "palette", "white is 0"))
    if way in (".png", ".bmp"):
        image = Image.fromarray(stored, "P")
        image.putpalette([value for value in range(255, -1, -1) for _ in range(3)])
        image.save(path.with_suffix(way), **({"bits": 8} if way == ".png" else {}))
        return path.with_suffix(way)
    if way == "palette":
        return _tiff(
            path, stored, photometric="palette", colormap=np.tile(np.arange(255, -1, -1, np.uint16) * 257, (3, 1))
        )
    return _tiff(path, stored, photometric="miniswhite")


def _painted(path: Path, drawn: Cells, rng: Random) -> Path:
    """A picture of the wall with cells painted over it, in a colour or in white, and perhaps see-through."""
    wall = _wall(rng)
    if rng.random() < 0.2:
        wall = np.where(wall > 128, 255, 0).astype(np.uint8)  # black and white, and a colour
    picture = np.stack([wall] * 3, axis=-1)
    colour = np.array(rng.choice(((255, 0, 0), (0, 255, 0), (255, 255, 0))))
    share = rng.choice((1.0, 0.5))
    picture[drawn] = (share * colour + (1 - share) * picture[drawn]).astype(np.uint8)
    if rng.random() < 0.3:
        opaque = np.full((*SHAPE, 1), 255, np.uint8)
        opaque[:, :3] = rng.choice((0, 255))
        picture = np.concatenate([picture, opaque], axis=-1)
    return _image(path, picture, rng.choice((".png", ".tif")))


def _painted_grey(path: Path, drawn: Cells, rng: Random) -> Path:
    wall = _wall(rng)
    wall[drawn] = rng.choice((0, 255))
    return _image(path, wall, rng.choice((".png", ".tif", ".bmp")))


def _overlay(path: Path, _: Cells, rng: Random) -> Path:
    """Grey values with the outlines of cells in an overlay, as Fiji saves it."""
    box = roifile.ImagejRoi(roitype=roifile.ROI_TYPE.RECT, left=5, top=10, right=15, bottom=20)
    return _tiff(path, _wall(rng), imagej=True, metadata={"Overlays": [box.tobytes()]})


def _labels_from_1(path: Path, drawn: Cells, rng: Random) -> Path:
    labels = (1 + drawn.astype(np.uint8)) * np.uint8(rng.choice((1, 1, 100)))
    return _image(path, labels, ".png") if rng.random() < 0.5 else _tiff(path, labels)


def _probabilities(path: Path, drawn: Cells, rng: Random) -> Path:
    soft = np.clip(_soft(drawn, rng) + np.random.default_rng(rng.randrange(1 << 30)).normal(0, 0.02, SHAPE), 0, 1)
    if rng.random() < 0.4:
        return _tiff(path, soft.astype(np.float32))
    levels = rng.choice((100, 255, 65535))
    return _tiff(path, np.rint(soft * levels).astype(rng.choice((np.uint16, np.int32)) if levels > 255 else np.uint8))


def _soft_brush(path: Path, drawn: Cells, rng: Random) -> Path:
    """Edges that fade, of all strokes or of those on one side."""
    soft = _soft(drawn, rng)
    if rng.random() < 0.5:
        hard = np.arange(SHAPE[1]) > int(np.nonzero(drawn.any(axis=0))[0][0]) + 3
        soft = np.where(hard, drawn, soft)
    grey = np.rint(soft * rng.choice((255, 200))).astype(np.uint8)
    if rng.random() < 0.4:
        colour = np.full((*SHAPE, 3), 255, np.uint8)
        return _image(path, np.concatenate([colour, grey[..., None]], axis=-1), ".png")
    return _image(path, grey, rng.choice((".png", ".tif", ".bmp")))


def _antialiased(path: Path, drawn: Cells, rng: Random) -> Path:
    """Edges with a few levels between, as programs draw lines."""
    fine = np.kron(drawn, np.ones((2, 2)))
    fine = np.roll(fine, (1, 1), axis=(0, 1))
    share = fine.reshape(SHAPE[0], 2, SHAPE[1], 2).mean(axis=(1, 3))
    return _image(path, np.rint(share * 255).astype(np.uint8), rng.choice((".png", ".bmp")))


def _votes(path: Path, drawn: Cells, rng: Random) -> Path:
    """How many raters drew each sample, or that in parts of 255."""
    votes = sum(np.roll(drawn, (rng.randint(-3, 3), k), axis=(0, 1)).astype(int) for k in (-2, 0, 3))
    if rng.random() < 0.5:
        return _tiff(path, np.asarray(votes, rng.choice((np.uint8, np.int32))))
    return _tiff(path, (np.asarray(votes) * 85).astype(np.uint8))


def _jpeg(path: Path, drawn: Cells, rng: Random) -> Path:
    """With losses, in a JPEG, or saved without them afterwards."""
    buffer = io.BytesIO()
    Image.fromarray(drawn.astype(np.uint8) * 255).save(buffer, "JPEG", quality=rng.choice((60, 80, 95)))
    if rng.random() < 0.4:
        path.with_suffix(".jpg").write_bytes(buffer.getvalue())
        return path.with_suffix(".jpg")
    buffer.seek(0)
    return _image(path, np.asarray(Image.open(buffer)), rng.choice((".png", ".tif")))


def _coloured_ground(path: Path, drawn: Cells, rng: Random) -> Path:
    """Two colours, neither of them black."""
    image = np.where(drawn[..., None], (253, 231, 36), (68, 1, 84)).astype(np.uint8)
    return _image(path, image, rng.choice((".png", ".bmp")))


def _two_pages(path: Path, drawn: Cells, rng: Random) -> Path:
    return _tiff(path, np.stack([drawn * np.uint8(255)] * rng.randint(2, 3)), compression=rng.choice((None, "zlib")))


def _everywhere(path: Path, _: Cells, rng: Random) -> Path:
    return _tiff(path, np.full(SHAPE, rng.choice((0, 1, 255)), np.uint8))


SOUND_MASKS: Mapping[str, Write] = {
    "mask, 0 and another": _grey,
    "mask, 16 bits": _grey_16,
    "mask, floats": _two_floats,
    "mask, a colour on black": _colour,
    "mask, on transparent": _on_transparent,
    "mask, on transparent, grey": _on_transparent_grey,
    "mask, white is 0": _white_is_zero,
    "mask, one bit": _bilevel,
    "mask, labels": _labels,
    "mask, labels that touch": _touching_labels,
    "mask, labels in colours": _label_palette,
    "mask, two colours by number": _two_colour_palette,
    "mask, turned": _turned,
    "mask, composed region": _composite,
    "mask, region with a hole": _ring,
}
UNCLEAR_MASKS: Mapping[str, Write] = {
    "no mask, inverting table": _inverting,
    "no mask, painted over": _painted,
    "no mask, painted over in grey": _painted_grey,
    "no mask, overlay": _overlay,
    "no mask, labels from 1": _labels_from_1,
    "no mask, probabilities": _probabilities,
    "no mask, soft brush": _soft_brush,
    "no mask, antialiased": _antialiased,
    "no mask, votes": _votes,
    "no mask, JPEG": _jpeg,
    "no mask, no black": _coloured_ground,
    "no mask, pages": _two_pages,
    "no mask, one value": _everywhere,
}
