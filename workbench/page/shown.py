"""What one page shows: its text, its description, and the layers that tiles are cut from.

The frames of a side come with where they lie on the wall, how good they are, and of which there are pictures.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Pillow

from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import IN_PLACE
from endoct.modalities.contract import Picture
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.page.description import BendPart, Description, FramesPart, PlacementPart, SeriesPart
from endoct.workbench.page.drawn_masks import DrawnMasks
from endoct.workbench.page.heading import Heading
from endoct.workbench.page.layers import MOST_SAMPLES, Classes, Layer, Scalar, outlines, relief_bytes
from endoct.workbench.page.presence import Origin
from endoct.workbench.page.recorded import Reader, picture_json, ring_of
from endoct.workbench.page.sessions import Sessions
from endoct.workbench.page.volume import volume_bytes
from endoct.workbench.page.wall import OVERLAP_PX, TILE_PX, NoSuchTile, Tile, TileWall, pixels_of, row_of_tiles
from endoct.workbench.report.per_frame import number_of
from endoct.workbench.report.pictures import load_pictures, pictured_places
from endoct.workbench.report.sections import Section

DIGITS = 5
"""Significant digits of numbers per frame."""


@dataclass(frozen=True, eq=False)
class ShownSide:
    """A side: all but the images of its panorama, where pictures of its frames lie, and its recording, if at hand."""

    outline: PanoramaOutline
    pictures: Path | None = None
    reader: Reader | None = None


@dataclass(frozen=True, eq=False)
class Shown:
    """A comparison, or a panorama, opened for the page: ``heading`` and ``sections`` are its text.

    The ``description`` is for its program, ``layers`` are by key and ``sides`` by name; ``origin`` is where it lies,
    ``session`` has the landmarks of a comparison, ``masks`` what was drawn on it, ``rings`` lines besides its cells'.
    """

    heading: Heading
    sections: tuple[Section, ...]
    description: Description
    wall: TileWall
    layers: Mapping[str, Layer]
    origin: Origin
    sides: Mapping[str, ShownSide] = field(default_factory=dict)
    session: Sessions | None = None
    masks: DrawnMasks | None = None
    panorama: Path | None = None
    rings: dict[str, tuple[tuple[float, ...], ...]] = field(default_factory=dict)

    def tile(self, key: str, tile: Tile) -> Pillow.Image:
        """Return a tile of the layer ``key``. Raises :class:`NoSuchTile` where there is no such tile."""
        finest = {layer.key: layer.finest_level for layer in self.description.layers}
        if key not in self.layers:
            raise NoSuchTile("there is no such layer", found=key, expected=", ".join(self.layers))
        if tile.level > finest[key]:
            raise NoSuchTile("there is no such tile", found=f"level {tile.level}", expected=f"{finest[key]} at most")
        return self.layers[key].picture(self.wall, tile.level, pixels_of(self.wall, tile))

    def row_of_tiles(self, key: str, level: int, row: int) -> list[Pillow.Image]:
        """Return the tiles of a row of the layer ``key``, which has them, faster than one by one."""
        pixels = row_of_tiles(self.wall, level, row)
        picture = self.layers[key].picture(self.wall, level, pixels)
        wide, high = TILE_PX + 2 * OVERLAP_PX, pixels.shape[0]
        return [picture.crop((left, 0, left + wide, high)) for left in range(0, self.wall.width_px(level), TILE_PX)]

    def outlines(self) -> dict[str, tuple[tuple[float, ...], ...]]:
        """Return the outlines of cells by layer, as :func:`~endoct.workbench.page.layers.outlines` has them."""
        parts = [
            (part.layer, self.layers[part.layer]) for part in self.description.outlines if part.layer in self.layers
        ]
        return self.rings | {key: outlines(layer.planes[0]) for key, layer in parts if isinstance(layer, Classes)}

    def relief(self, key: str, most_samples: int = MOST_SAMPLES) -> bytes:
        """Return the layer ``key`` as :func:`~endoct.workbench.page.layers.relief_bytes` has it.

        Raises :class:`NoSuchTile` where it is no relief.
        """
        layer = self.layers.get(key)
        if key not in self.reliefs or not isinstance(layer, Scalar):
            raise NoSuchTile("there is no such relief", found=key, expected=", ".join(self.reliefs))
        return relief_bytes(layer.plane, self.wall, most_samples)

    def volume(self) -> bytes:
        """Return the dense volume as :func:`~endoct.workbench.page.volume.volume_bytes` has it.

        Raises :class:`NoSuchTile` where there is none.
        """
        if self.panorama is None or not self.description.has_volume:
            raise NoSuchTile("there is no volume")
        return volume_bytes(self.panorama)

    @property
    def reliefs(self) -> tuple[str, ...]:
        """The layers that say how far the wall lies from the bore, in mm."""
        return tuple(part.key for part in self.description.layers if part.kind == "scalar" and part.unit == "mm")

    def pictures(self, name: str, place: int) -> list[dict[str, Any]]:
        """Return the pictures of the frame at ``place``, in the order of ascending z, of the side ``name``.

        Raises :class:`NoSuchTile` where there are none, and the recording has not been read again.
        """
        side = self.side(name)
        found: tuple[Picture, ...] = ()
        if side.pictures is not None:
            found = load_pictures(side.pictures, name, place).get(name, {}).get(place, ())
        if not found and side.reader is not None and side.reader.state == "read":
            found = side.reader.pictures(place)
        if not found:
            raise NoSuchTile(f"there is no picture of frame {place} of {name}")
        ring = ring_of(side.outline, place)
        return [picture_json(picture, ring) for picture in found]

    def side(self, name: str) -> ShownSide:
        """Return a side. Raises :class:`NoSuchTile` where there is none of that name."""
        if name not in self.sides:
            raise NoSuchTile("there is no such side", found=name, expected=", ".join(self.sides))
        return self.sides[name]

    def values_at(self, theta_rad: float, z_mm: float) -> dict[str, float | None]:
        """Return the value of every layer of numbers at a place, None where nothing was observed there."""
        return {key: layer.plane.at(theta_rad, z_mm) for key, layer in self.layers.items() if isinstance(layer, Scalar)}


def frames_part(
    side: str, outline: PanoramaOutline, where: Alignment | None, pictures: Path | None, reader: Reader | None = None
) -> FramesPart:
    """Return the frames of ``side``, moved by ``where`` onto the wall; ``pictures`` is the folder of theirs.

    ``reader`` reads the others, where the recording is at hand. Raises :class:`EndoctError` for places that are none.
    """
    stored = outline.per_frame.get(f"{outline.frame_dim}_z_mm")
    own_mm = np.empty(0) if stored is None else np.asarray(stored.values, np.float64)
    z_mm = own_mm if where is None else where.z_to_a(own_mm)
    if z_mm.ndim != 1 or not np.isfinite(z_mm).all():
        found = "numbers that are not finite" if z_mm.ndim == 1 else f"numbers of shape {z_mm.shape}"
        raise EndoctError(f"the frames of {side} have no places", found=found, remedy="unroll it again")
    at = where or IN_PLACE
    bend = None if at.bend is None else BendPart(at.bend.z_mm, at.bend.shift_mm, at.bend.roll_rad)
    return FramesPart(
        side=side,
        frame_dim=outline.frame_dim,
        z_mm=tuple(np.round(z_mm, 6).tolist()),
        pictured=() if pictures is None else tuple(k for k in pictured_places(pictures, side) if k < own_mm.size),
        recording="" if reader is None else str(reader.recording.path),
        placement=PlacementPart(at.theta_shift_rad, at.mirrored, at.z_shift_mm, at.z_scale, at.z_reversed, bend),
        quality=tuple(_quality(outline)),
    )


def _quality(outline: PanoramaOutline) -> Iterator[SeriesPart]:
    """Yield what says how good frames are: numbers with a usual range, then flags that speak against a frame."""
    series = sorted(outline.per_frame.items())
    for name, one in series:
        if one.usual is not None and one.values.ndim == 1:
            number = number_of(name, one.values.astype(np.float64), one.title, one.unit, one.usual)
            low, high = (float(v) if math.isfinite(v) else None for v in number.usual or (math.nan, math.nan))
            usual = None if number.usual is None else (low, high)
            values = tuple(float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in number.values.tolist())
            yield SeriesPart(name, one.title, number.unit, usual, is_flag=False, values=values)
    for name, one in series:
        if one.trusted_when is not None and one.doubted.any():
            values = tuple(float(value) for value in one.doubted)
            yield SeriesPart(name, one.doubt, "", None, is_flag=True, values=values)
