"""The layers of a comparison, or of a panorama: from planes to pictures of tiles, outlines and a relief.

Panes show layers of the wall; each is described to the page. Outlines of cells are lines on the wall. The relief is
one small array, from which the page builds the wall in three dimensions.
"""

import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray
from PIL import Image as Pillow

from endoct.base.arrays import Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.ranks import robust_limits
from endoct.base.zarr.window import ChunkCache, stored_image
from endoct.fusion.evidence import MASK_MODALITY
from endoct.fusion.files.masks import DRAWN_STORE, read_drawn
from endoct.fusion.files.store import COMPARISON_STORE, WALL_STORE, ComparisonOutline
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import rolled
from endoct.fusion.result import Contradiction
from endoct.fusion.scoring.overlap import BOTH, NEITHER, ONLY_A, ONLY_B, difference
from endoct.fusion.sides import COLOURS
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import PanoramaOutline
from endoct.workbench.page.description import ClassPart, LayerPart
from endoct.workbench.page.plane import Averaged, Plane
from endoct.workbench.page.wall import Pixels, Placing, TileWall, placing_of

CODES = 255
"""The code of the high end of a layer's numbers. No sample has it: what lies there is shown as one less."""
_NOT_OBSERVED = 255
"""Palette entry of what was not observed: transparent."""
_GREY = [(grey, grey, grey) for grey in range(256)]
IMAGE, DEPTH, CELLS, DIFFERENCE = "image", "relief", "cells", "difference"
PARALLAX_DEPTH, PROBABILITY = "parallax_depth_mm", "cell_probability"
TITLES = {
    "intensity": (IMAGE, "image", "intensity", "a.u."),
    "depth_mm": (DEPTH, "relief", "wall radius − bore radius", "mm"),
    PARALLAX_DEPTH: ("parallax", "relief by parallax", "wall radius − bore radius", "mm"),
    PROBABILITY: ("probability", "probability of a cell", "probability", "1"),
}
"""Images of a panorama by their names in its store: end of the key, title, quantity and unit."""
DRAWN = "drawn."
"""How keys of masks drawn by hand begin; those of sides have their name and a '-' before anything else."""
DRAWN_COLOURS = (0x00, 0x9E, 0x73), (0xCC, 0x79, 0xA7), (0xD5, 0x5E, 0x00), (0x56, 0xB4, 0xE9), (0xF0, 0xE4, 0x42)
CELL_COLOURS = COLOURS[ONLY_A], COLOURS[ONLY_B]
"""Colours of the cells of A and of B."""
WALL, CONTRADICTIONS = "wall", "wall-contradictions"
"""How keys of the one wall of both sides begin, and the key of the rings around its contradictions."""
WALL_COLOUR, RING_COLOUR = (0x5B, 0x3A, 0x9E), (0xC0, 0x10, 0x30)
RING_MM, RING_POINTS = 0.1, 33
"""How far a ring lies around what it marks, and its points, the first one twice."""
MOST_SAMPLES = 350_000
"""Samples of a relief: 0.7 MB, and few enough corners for any machine to draw smoothly."""
FINEST_LEVEL = 2
"""Finest level for the columns of a relief: 1024 around."""
LAST_CODE = 65_535
TOLERANCE_SAMPLES = 0.25
"""How far a line may depart from the outline, in samples of the image that it is drawn from."""
DECIMALS = 5
"""Decimals of rad and mm: a hundredth of a micrometre."""
MOST_OUTLINED = 2048
"""Samples of a mask along either axis that outlines are drawn from; larger masks are averaged first."""


@dataclass(frozen=True, eq=False)
class Scalar:
    """A layer of numbers: an intensity, a depth.

    Tiles hold code = 255 · (value − ``low``) / (``high`` − ``low``), for the page to colour.
    """

    plane: Plane
    low: float
    high: float

    def picture(self, wall: TileWall, level: int, pixels: Pixels) -> Pillow.Image:
        """Return ``pixels`` of the wall at ``level`` in grey, transparent where nothing was observed."""
        found = self.plane.means(wall, level, pixels)
        scale = CODES / (self.high - self.low)
        return _picture(_codes(found.values, found.known, np.float32(self.low), np.float32(scale)), _GREY)


@dataclass(frozen=True, eq=False)
class Classes:
    """A layer of classes: the cells of one side, or where the cells of two differ. ``colours`` by class."""

    planes: tuple[Plane, ...]
    colours: Sequence[tuple[int, int, int]]

    def picture(self, wall: TileWall, level: int, pixels: Pixels) -> Pillow.Image:
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
    overview = plane.overview().averaged
    low, high = robust_limits(overview.values, overview.known, 0.05, 99.95)
    spare = (high - low) / 20
    return Scalar(plane, low - spare, high + spare)


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


@dataclass(frozen=True, eq=False)
class Described:
    """A layer, and its description for the page."""

    layer: Layer
    part: LayerPart


def wall_of(grid: SurfaceGrid) -> TileWall:
    """Return the wall that the rows of ``grid`` cover."""
    first_mm, last_mm = (float(z_mm) for z_mm in grid.z_mm[[0, -1]])
    return TileWall(grid.radius_mm, first_mm - grid.dz_mm / 2, last_mm + grid.dz_mm / 2)


def panorama_layers(store: Path, outline: PanoramaOutline, wall: TileWall, cache: ChunkCache) -> Iterator[Described]:
    """Yield the layers of a panorama by itself."""
    placing = placing_of(outline.grid)
    for name in ("intensity", *_depths(outline)):
        plane = _plane(store, name, (), placing, wall, cache)
        if _shows(name, plane):
            yield _numbers(outline.modality, outline.modality, name, plane, wall)


def comparison_layers(
    folder: Path, outline: ComparisonOutline, sides: Sequence[PanoramaOutline], wall: TileWall, cache: ChunkCache
) -> Iterator[Described]:
    """Yield the layers of a comparison of ``sides``: images on their own samples, cells on the common grid."""
    common, placing = folder / COMPARISON_STORE, placing_of(outline.grid)
    masks = [_plane(common, "mask", (k,), placing, wall, cache) for k in (0, 1)]
    images = [list(_images(folder, outline, sides[k], k, wall, cache)) for k in (0, 1)]
    both = [plane for of_side in images for _, plane in of_side]
    list(thread_map(Plane.overview, both))  # every scale needs one: made side by side, they are there sooner
    for k, side in enumerate(outline.names):
        for name, plane in images[k]:
            if _shows(name, plane):
                yield _numbers(side, side, name, plane, wall)
        yield _cells(f"{side}-{CELLS}", f"{side}: cells", side, masks[k], CELL_COLOURS[k], wall)
    yield from _drawn_layers(folder, outline.names[0], wall, cache)
    if outline.alignment is not None and (folder / WALL_STORE).is_dir():
        store = folder / WALL_STORE
        yield _numbers(WALL, None, "depth_mm", _plane(store, "depth_mm", (), placing, wall, cache), wall)
        cells = Plane(stored_image(store / PROBABILITY, cache, ()), None, placing, wall.radius_mm)
        yield _numbers(WALL, None, PROBABILITY, cells, wall)
        yield _cells(f"{WALL}-{CELLS}", f"{WALL}: {CELLS}", None, cells, WALL_COLOUR, wall)
    if outline.alignment is not None:
        a, b = outline.names
        labels = {NEITHER: "neither", BOTH: "both", ONLY_A: f"only {a}", ONLY_B: f"only {b}"}
        classes = tuple(ClassPart(labels[code], hex_of(COLOURS[code])) for code in sorted(labels))
        part = _classes_part(DIFFERENCE, "cells: difference", None, classes, masks[0], wall)
        yield Described(Classes(tuple(masks), COLOURS), part)


def rings(contradictions: Iterable[Contradiction], radius_mm: float) -> tuple[tuple[float, ...], ...]:
    """Return a ring around each contradiction as flat (θ rad, z mm, θ, z, …); its θ runs on beyond a turn."""
    turn_rad = np.linspace(0, 2 * np.pi, RING_POINTS)
    lines = []
    for each in contradictions:
        around_mm = np.sqrt(each.area_mm2 / np.pi) + RING_MM
        theta_rad = each.theta_rad + around_mm / radius_mm * np.cos(turn_rad)
        flat = np.round(np.stack([theta_rad, each.z_mm + around_mm * np.sin(turn_rad)], axis=1), DECIMALS).ravel()
        lines.append(tuple(flat.tolist()))
    return tuple(lines)


def _drawn_layers(folder: Path, side: str, wall: TileWall, cache: ChunkCache) -> Iterator[Described]:
    """Yield the masks that were drawn by hand, on the wall of ``side``, in whose frame they lie."""
    drawn = read_drawn(folder)
    if drawn is None:
        return
    for k, title in enumerate(drawn.titles):
        plane = _plane(folder / DRAWN_STORE, "mask", (k,), placing_of(drawn.grid), wall, cache)
        yield drawn_layer(f"{DRAWN}{k + 1}", f"drawn: {title}", side, plane, k, wall)


def drawn_layer(key: str, title: str, side: str, plane: Plane, k: int, wall: TileWall) -> Described:
    """Return a mask drawn by hand on the wall of ``side`` as a layer, the ``k``-th of some."""
    return _cells(key, title, side, plane, DRAWN_COLOURS[k % len(DRAWN_COLOURS)], wall)


def _cells(
    key: str, title: str, side: str | None, plane: Plane, colour: tuple[int, int, int], wall: TileWall
) -> Described:
    colours = COLOURS[NEITHER], colour
    classes = tuple(ClassPart(label, hex_of(of)) for label, of in zip(("no cell", "cell"), colours, strict=True))
    return Described(Classes((plane,), colours), _classes_part(key, title, side, classes, plane, wall))


def _images(
    folder: Path, outline: ComparisonOutline, panorama: PanoramaOutline, k: int, wall: TileWall, cache: ChunkCache
) -> Iterator[tuple[str, Plane]]:
    """Yield the images of the side ``k`` by their names in its store."""
    own = folder / "panoramas" / f"{outline.names[k]}.zarr"
    # where B bends, only the common grid shows where it was put
    is_bent = outline.alignment is not None and outline.alignment.bend is not None
    is_rigid = k == 0 or not is_bent
    placing = placing_of(panorama.grid, outline.alignment if k else None) if is_rigid else placing_of(outline.grid)
    store, index = (own, ()) if is_rigid else (folder / COMPARISON_STORE, (k,))
    images = ["intensity"] * (panorama.modality != MASK_MODALITY) + _depths(panorama)
    for name in images:
        if name == PARALLAX_DEPTH and not is_rigid:
            continue  # which is on the side's own samples only
        yield name, _plane(store, name, index, placing, wall, cache)


def _depths(panorama: PanoramaOutline) -> list[str]:
    """Return the names of the depths that a panorama has in its store."""
    return ["depth_mm"] * panorama.has_depth + [PARALLAX_DEPTH] * panorama.has_parallax


def _shows(name: str, plane: Plane) -> bool:
    """Return whether there is anything to show: parallax may have been looked for and found nowhere."""
    return name != PARALLAX_DEPTH or bool(plane.overview().averaged.known.any())


def _plane(
    store: Path, name: str, index: tuple[int, ...], placing: Placing, wall: TileWall, cache: ChunkCache
) -> Plane:
    image = stored_image(store / name, cache, index)
    # depth by parallax is known where it is finite, which is not everywhere that something was observed
    observed = None if name == PARALLAX_DEPTH else stored_image(store / "valid", cache, index)
    return Plane(image, observed, placing, wall.radius_mm)


def _numbers(named: str, side: str | None, name: str, plane: Plane, wall: TileWall) -> Described:
    layer, (key, title, quantity, unit) = scalar(plane), TITLES[name]
    overview = plane.overview().averaged
    shown_low, shown_high = robust_limits(overview.values, overview.known)
    limits = layer.low, layer.high, shown_low, shown_high
    sampled, words = _sampling(plane, wall), (quantity, unit)
    part = LayerPart(f"{named}-{key}", f"{named}: {title}", side, "scalar", *words, *limits, classes=(), **sampled)
    return Described(layer, part)


def _classes_part(
    key: str, title: str, side: str | None, classes: tuple[ClassPart, ...], plane: Plane, wall: TileWall
) -> LayerPart:
    last = float(len(classes) - 1)
    sampled, limits = _sampling(plane, wall), (0.0, last, 0.0, last)
    return LayerPart(key, title, side, "classes", "cells", "", *limits, classes=classes, **sampled)


def _sampling(plane: Plane, wall: TileWall) -> dict[str, Any]:
    row_mm, column_mm = plane.placing.row_height_mm, plane.placing.dtheta_mm(wall.radius_mm)
    return {"finest_level": wall.level_for(min(row_mm, column_mm)), "row_mm": row_mm, "column_mm": column_mm}


def hex_of(colour: tuple[int, int, int]) -> str:
    """Return a colour as "#e69f00"."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def relief_bytes(plane: Plane, wall: TileWall, most_samples: int = MOST_SAMPLES) -> bytes:
    """Return what ``plane`` shows, in mm, at its own rows and in columns around the circle.

    All is little-endian. First come the numbers of rows and of columns as uint32. The values of the codes 1 and 65 535
    follow as float32, then z of every row in mm as float32, ascending. Last come the codes as uint16, row by row, 0
    where nothing was observed. Column j of n has its centre at θ = (j + ½) · 2π/n. Where there are more rows than fit,
    each is the mean of some.
    """
    level = min(wall.level_for(plane.placing.dtheta_mm(wall.radius_mm)), FINEST_LEVEL)
    row_mm, found = plane.own_rows(wall, level, max(2, most_samples // wall.width_px(level)))
    known = found.values[found.known]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    share = (found.values - low) / max(high - low, 1e-9)
    codes = np.where(found.known, 1 + np.rint(share * (LAST_CODE - 1)), 0).astype("<u2")
    sizes, limits = np.array(codes.shape, "<u4"), np.array([low, high], "<f4")
    return b"".join(part.tobytes() for part in (sizes, limits, row_mm.astype("<f4"), codes))


def outlines(mask: Plane) -> tuple[tuple[float, ...], ...]:
    """Return the outlines of what ``mask`` shows, each as flat (θ rad, z mm, θ, z, …).

    Drawn from the overview of the mask. An outline over θ = 0 ends a sample beyond it, on either side.
    """
    overview = mask.overview()
    averaged = overview.averaged
    share = np.where(averaged.known, averaged.values, np.float32(0))
    return _lines_around(share, mask.placing, overview.down, overview.across)


def mask_outlines(mask: Mask, grid: SurfaceGrid, where: Alignment | None) -> tuple[tuple[float, ...], ...]:
    """Return the outlines of ``mask``, bool (n_z, n_theta) on ``grid``, moved by ``where``, as :func:`outlines`."""
    down, across = (-(-n // MOST_OUTLINED) for n in mask.shape)
    placing = placing_of(grid, where)
    if where is not None and where.bend is not None:
        roll_rad = where.roll_rad(grid.z_mm) * (-1 if where.mirrored else 1)
        everywhere = np.ones(grid.shape, np.bool_)
        mask = rolled(mask.astype(np.float32), everywhere, roll_rad / grid.dtheta_rad)[0] >= np.float32(0.5)
    rows = mask[::-1] if placing.z_reversed else mask
    rows = np.roll(rows[:, ::-1], 1, axis=1) if placing.mirrored else rows  # column j is stored as column −j
    row_starts, column_starts = np.arange(0, mask.shape[0], down), np.arange(0, mask.shape[1], across)
    sums = np.add.reduceat(np.add.reduceat(rows, row_starts, axis=0, dtype=np.int32), column_starts, axis=1)
    counts = np.diff(np.append(row_starts, mask.shape[0]))[:, None] * np.diff(np.append(column_starts, mask.shape[1]))
    return _lines_around((sums / counts).astype(np.float32), placing, down, across)


def _lines_around(share: Image, placing: Placing, down: int, across: int) -> tuple[tuple[float, ...], ...]:
    """Return the lines around what is at least half a cell; ``share`` is averaged over so many rows and columns."""
    padded = np.pad(np.pad(share, ((0, 0), (1, 1)), mode="wrap"), ((1, 1), (0, 0)))
    starts = np.arange(0, placing.row_mm.size, down)
    middle = (starts + np.minimum(starts + down, placing.row_mm.size) - 1) / 2
    row_mm = np.interp(middle, np.arange(placing.row_mm.size), placing.row_mm)
    # the mask ends half a sample beyond its first and last row
    step_mm = placing.row_height_mm * down
    ends_mm = np.concatenate([[row_mm[0] - step_mm], row_mm, [row_mm[-1] + step_mm]])
    lines = []
    for contour in contour_generator(z=padded).lines(0.5):
        points = cv2.approxPolyDP(np.asarray(contour, np.float32), TOLERANCE_SAMPLES, closed=False)[:, 0]
        if len(points) < 2:
            continue
        z_mm = np.interp(points[:, 1], np.arange(ends_mm.size), ends_mm)
        column = (points[:, 0] - 1) * across + (across - 1) / 2
        theta_rad = placing.theta0_rad + column * placing.dtheta_rad
        flat = np.round(np.stack([theta_rad, z_mm], axis=1), DECIMALS).ravel()
        lines.append(tuple(flat.tolist()))
    return tuple(lines)
