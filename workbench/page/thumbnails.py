"""Small pictures for a table: the wall as strips, z to the right and θ down."""

import io
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from endoct.stitching.errors import EndoctError, refusing
from endoct.stitching.json_values import number
from endoct.stitching.zarr_store import read_arrays, read_attributes
from endoct.workbench.page.collection import SAMPLE, Entry, check_no_links
from endoct.workbench.page.description import LayerPart
from endoct.workbench.page.layer import CODES
from endoct.workbench.page.opening import open_shown
from endoct.workbench.page.shown import Shown
from endoct.workbench.page.wall import OVERLAP_PX, TILE_PX, Tile

STRIP_PX, WIDEST_PX, GAP_PX = 96, 480, 6
"""Height of strips, how wide all of them can be, and what lies between two."""
MOST_PX = 2000
"""Of the truth that are looked at, along either axis."""
NOT_OBSERVED = (201, 205, 210, 255)
DEEP_MM = 0.8
"""Black in a relief."""

Pixels = NDArray[np.uint8]


def thumbnail(entry: Entry) -> bytes:
    """Return a PNG of what the page of ``entry`` shows first; of a simulated specimen, its true relief.

    Raises :class:`EndoctError` where it cannot be read.
    """
    check_no_links(entry.path)
    strips = [_relief(entry.path)] if entry.kind == "specimen" else _panes(open_shown(entry.path))
    widest = max(strip.width for strip in strips) + GAP_PX
    # side by side, but those of a long bore under one another
    across, down = (widest, 0) if widest * len(strips) <= WIDEST_PX else (0, STRIP_PX + GAP_PX)
    last = len(strips) - 1
    picture = Pillow.new("RGBA", (last * across + widest - GAP_PX, last * down + STRIP_PX))
    for k, strip in enumerate(strips):
        picture.paste(strip, (k * across, k * down))
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()


def _panes(shown: Shown) -> list[Pillow.Image]:
    parts = {part.key: part for part in shown.description.layers}
    return [_pane(shown, parts[key]) for key in shown.description.panes]


def _pane(shown: Shown, part: LayerPart) -> Pillow.Image:
    """Return a layer from its coarsest tiles, without what they share with their neighbours."""
    pixels = []
    for row in range(shown.wall.rows_of_tiles(0)):
        tile = np.asarray(shown.tile(part.key, Tile(0, 0, row)).convert("RGBA"))
        first = OVERLAP_PX if row else 0
        pixels.append(tile[first : first + TILE_PX, OVERLAP_PX:-OVERLAP_PX])
    wall = np.concatenate(pixels)
    if part.kind == "scalar":
        value = part.low + wall[..., :3] * ((part.high - part.low) / CODES)
        share = (value - part.shown_low) / ((part.shown_high - part.shown_low) or 1.0)
        wall = np.dstack([_bytes(1 - share if part.unit == "mm" else share), wall[..., 3]])  # deep is dark
    return _strip(wall, wall.shape[0] / wall.shape[1])


def _relief(specimen: Path) -> Pillow.Image:
    store = specimen / SAMPLE.parent / "wall.zarr"
    with refusing(f"{store} is no true wall"):
        arrays = read_arrays(store, ("relief_mm", "z"))
        relief_mm, z_mm = arrays["relief_mm"], arrays["z"]
        if relief_mm.ndim != 2 or z_mm.shape != relief_mm.shape[:1]:
            raise EndoctError(f"{store} is no true wall", found=f"shape {relief_mm.shape}", expected="(z, θ)")
        around_mm = 2 * math.pi * number(read_attributes(store), "bore_radius_mm", 0.01, 1e3, str(store))
        down, across = (max(1, n // MOST_PX) for n in relief_mm.shape)
        grey = _bytes(1 - np.nan_to_num(relief_mm[::down, ::across], nan=DEEP_MM) / DEEP_MM)
        return _strip(np.dstack([grey] * 3 + [np.full_like(grey, CODES)]), float(np.ptp(z_mm)) / around_mm)


def _strip(wall: Pixels, turns: float) -> Pillow.Image:
    """Return a wall, RGBA (z, θ, 4), whose length is so many times its circle, as a strip."""
    width = min(max(round(STRIP_PX * turns), 1), WIDEST_PX)
    sideways = np.ascontiguousarray(wall.transpose(1, 0, 2))
    strip = Pillow.fromarray(sideways, "RGBA").resize((width, STRIP_PX), Pillow.Resampling.BOX)
    return Pillow.alpha_composite(Pillow.new("RGBA", strip.size, NOT_OBSERVED), strip)


def _bytes(share: NDArray[np.floating]) -> Pixels:
    codes: Pixels = np.clip(np.rint(CODES * share), 0, CODES).astype(np.uint8)
    return codes
