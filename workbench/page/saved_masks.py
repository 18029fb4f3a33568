"""Masks that were drawn on the page and saved: as layers of it, scored, and corrected cell by cell."""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.base.errors import EndoctError
from endoct.base.files.files import plain_name
from endoct.fusion.evidence.side import DrawnMask
from endoct.fusion.files.drawings import read_drawing
from endoct.fusion.files.masks import on_comparison, score_surface
from endoct.fusion.files.session import MASKS
from endoct.fusion.files.store import ComparisonOutline, load_compared
from endoct.fusion.geometry.placement import IN_PLACE, Placement
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.page.layers import DRAWN, Described, drawn_layer
from endoct.workbench.page.plane import Plane
from endoct.workbench.page.wall import TileWall, placing_of

NAME = re.compile(r"([A-Za-z0-9][A-Za-z0-9.-]{0,40})_([A-Za-z0-9][A-Za-z0-9.-]{0,20})")
"""Rater and session, as the name of a mask has them."""
MOST_LAYERS = 12
"""Saved masks that are layers; a mask of the largest panoramas takes 5 MB."""


@dataclass(frozen=True, eq=False)
class HeldMask:
    """A mask in memory that is read as a stored image is; ``packed`` has eight samples of a row a byte."""

    packed: NDArray[np.uint8]
    shape: tuple[int, int]

    def read(self, rows: slice, columns: slice) -> NDArray[np.uint8]:
        """Return the samples of ``rows`` and ``columns``, both with a start and a stop inside the mask."""
        return np.unpackbits(self.packed[rows], axis=1, count=self.shape[1])[:, columns]


def saved_names(folder: Path, side: str) -> list[str]:
    """Return the names of the masks that were saved of a side of the comparison in ``folder``."""
    return sorted(path.stem for path in (folder / MASKS / side).glob("*.png") if NAME.fullmatch(path.stem))


def read_saved(folder: Path, side: str, name: object, grid: SurfaceGrid) -> Mask:
    """Return a saved mask. Raises :class:`EndoctError` where there is none, or it is not of the panorama's ``grid``."""
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise EndoctError("there is no such mask", found=repr(name)[:60])
    mask = read_drawing(folder / MASKS / plain_name(side, "a side") / f"{name}.png", grid.shape)
    if mask.shape != grid.shape:
        raise EndoctError(f"the mask {name} is not of this panorama", found=str(mask.shape), expected=str(grid.shape))
    return mask


def saved_layers(
    folder: Path, sides: Mapping[str, PanoramaOutline], outline: ComparisonOutline, wall: TileWall
) -> Iterator[Described]:
    """Yield the saved masks as layers: A's on its own samples, B's on the common grid where the sides are aligned.

    Those that cannot be read are left out: whoever names one is told why.
    """
    named = [(side, name) for side in sides for name in saved_names(folder, side)]
    for k, (side, name) in enumerate(named[-MOST_LAYERS:]):
        grid = sides[side].grid
        with suppress(EndoctError):
            mask = read_saved(folder, side, name, grid)
            if side == outline.names[1] and outline.alignment is not None:
                everywhere, placed = np.ones_like(mask), Placement.averaging(grid, outline.alignment, outline.grid)
                mask, grid = placed.mask(mask, everywhere)[0], outline.grid
            held: Any = HeldMask(np.packbits(mask, axis=1), mask.shape)
            plane = Plane(held, None, placing_of(grid), wall.radius_mm)
            yield drawn_layer(f"{DRAWN}{side}.{name}", f"saved: {name}", side, plane, k, wall)


def scores_against(folder: Path, side: str, name: object, grid: SurfaceGrid, tolerance_mm: float) -> dict[str, Any]:
    """Return by side its Jaccard index against a saved mask of ``side``, as ``endoct compare --truth`` gives it.

    Raises :class:`EndoctError` where there is no such mask, or B's lies nowhere as the sides are not aligned.
    """
    comparison, mask = load_compared(folder), read_saved(folder, side, name, grid)
    is_a = side == comparison.names[0]
    if not is_a and comparison.alignment is None:
        raise EndoctError("the sides are not aligned", found=f"a mask of {side}", remedy="compare with it by itself")
    drawn = DrawnMask(grid, mask, "", "", None, f"{name}.png")
    surface = on_comparison(comparison, drawn, IN_PLACE if is_a else comparison.alignment or IN_PLACE)
    scores = score_surface(comparison, surface, tolerance_mm)
    known = {name: of for name, of in scores.items() if is_a is (name == side) or comparison.alignment is not None}
    return {name: {"jaccard": of.jaccard, "interval": of.jaccard_interval} for name, of in known.items()}


def flooded(mask: Mask, row: int, column: int, *, adds: bool) -> Mask:
    """Return ``mask`` with the hole at a sample filled, or (not ``adds``) without the cell there; else as it is.

    Raises :class:`EndoctError` where what would be filled goes on to an end of the bore: no cell encloses it.
    """
    area = mask != adds
    if not area[row, column]:
        return mask
    connectivity = 4 if adds else 8  # a cell is connected over corners, so that a hole is not
    _, labels = cv2.connectedComponents(area.astype(np.uint8), connectivity=connectivity, ltype=cv2.CV_32S)
    seam = np.unique(np.stack([labels[:, 0], labels[:, -1]], axis=1), axis=0)
    pieces, before = {int(labels[row, column])}, 0
    while len(pieces) > before:  # over the seam of θ, and back
        before = len(pieces)
        pieces |= {int(each) for pair in seam if 0 not in pair and pieces & {*pair.tolist()} for each in pair}
    region = np.isin(labels, list(pieces))
    if adds and (region[0].any() or region[-1].any()):
        raise EndoctError("no cell encloses that place", remedy="take the click back, and close the outline first")
    return np.asarray(mask ^ region)
