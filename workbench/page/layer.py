"""What panes show: layers of the wall, from planes to pictures of tiles."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from endoct.fusion.scoring.overlap import difference
from endoct.stitching.arrays import Image, Mask
from endoct.stitching.compiled import compiled
from endoct.workbench.page.plane import Averaged, Plane
from endoct.workbench.page.wall import Pixels, Wall

CODES = 255
"""The code of the high end of a layer's numbers. No sample has it: what lies there is shown as one less."""
_NOT_OBSERVED = 255
"""The place in the palette of what was not observed: transparent."""
_GREY = [(grey, grey, grey) for grey in range(256)]


@dataclass(frozen=True, eq=False)
class Scalar:
    """A layer of numbers: an intensity, a depth.

    Tiles hold code = 255 · (value − ``low``) / (``high`` − ``low``), for the page to colour.
    """

    plane: Plane
    low: float
    high: float

    def picture(self, wall: Wall, level: int, pixels: Pixels) -> Pillow.Image:
        """Return ``pixels`` of the wall at ``level`` in grey, transparent where nothing was observed."""
        found = self.plane.means(wall, level, pixels)
        scale = CODES / (self.high - self.low)
        return _picture(_codes(found.values, found.known, np.float32(self.low), np.float32(scale)), _GREY)


@dataclass(frozen=True, eq=False)
class Classes:
    """A layer of classes: the cells of one side, or where the cells of two differ. ``colours`` by class."""

    planes: tuple[Plane, ...]
    colours: Sequence[tuple[int, int, int]]

    def picture(self, wall: Wall, level: int, pixels: Pixels) -> Pillow.Image:
        """Return ``pixels`` of the wall at ``level`` in colours, transparent where nothing was observed."""
        return _picture(self.classes([plane.means(wall, level, pixels) for plane in self.planes]), self.colours)

    def classes(self, found: Sequence[Averaged]) -> NDArray[np.uint8]:
        """Return the class of every pixel, and 255 where one of the sides observed nothing."""
        known = np.logical_and.reduce([one.known for one in found])
        masks = [one.values >= 0.5 for one in found]
        classes = masks[0] if len(masks) == 1 else difference(masks[0], masks[1], known)
        return np.where(known, classes.astype(np.uint8), np.uint8(_NOT_OBSERVED))


Layer = Scalar | Classes


def scalar(plane: Plane) -> Scalar:
    """Return the layer of the numbers of ``plane``, its codes spread over nearly all values that it has."""
    low, high = shown_range(plane.overview().averaged, 0.05, 99.95)
    spare = (high - low) / 20
    return Scalar(plane, low - spare, high + spare)


def shown_range(overview: Averaged, least: float = 0.5, most: float = 99.5) -> tuple[float, float]:
    """Return two percentiles of what was observed, (0, 1) where nothing was."""
    known = overview.values[overview.known]
    if not known.size:
        return 0.0, 1.0
    low, high = (float(value) for value in np.percentile(known[:: max(1, known.size // 400_000)], [least, most]))
    return (low, high) if high > low else (low - 0.5, low + 0.5)


@compiled
def _codes(values: Image, known: Mask, low: np.float32, scale: np.float32) -> NDArray[np.uint8]:
    codes = np.full(values.shape, _NOT_OBSERVED, np.uint8)
    for row in range(values.shape[0]):
        for column in range(values.shape[1]):
            if known[row, column]:
                code = np.rint((values[row, column] - low) * scale)
                codes[row, column] = min(max(code, 0), _NOT_OBSERVED - 1)
    return codes


def _picture(codes: NDArray[np.uint8], colours: Sequence[tuple[int, int, int]]) -> Pillow.Image:
    """Return a picture of one byte a pixel, which is compressed in half the time of grey with transparency."""
    picture = Pillow.fromarray(codes, "P")
    palette = [value for colour in colours for value in colour]
    picture.putpalette(palette + [0] * (768 - len(palette)))
    picture.info["transparency"] = _NOT_OBSERVED
    return picture


def is_blank(picture: Pillow.Image) -> bool:
    """Say whether a tile shows nothing: nothing was observed in it."""
    return picture.getextrema() == (_NOT_OBSERVED, _NOT_OBSERVED)


def png_of(picture: Pillow.Image) -> bytes:
    """Return a tile as PNG."""
    file = io.BytesIO()
    picture.save(file, "PNG", compress_level=1)
    return file.getvalue()
