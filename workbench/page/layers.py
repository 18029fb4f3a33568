"""The layers of a comparison, or of a panorama, with what the page is told of each."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from endoct.fusion.difference import COLOURS
from endoct.fusion.evidence.drawn_mask import MASK_MODALITY
from endoct.fusion.files.drawn_store import NAME as DRAWN_STORE
from endoct.fusion.files.drawn_store import read_drawn
from endoct.fusion.files.store import ComparisonOutline
from endoct.fusion.scoring.overlap import BOTH, NEITHER, ONLY_A, ONLY_B
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.parallel import thread_map
from endoct.stitching.store import PanoramaOutline
from endoct.stitching.window import ChunkCache, stored_image
from endoct.workbench.page.description import ClassPart, LayerPart
from endoct.workbench.page.layer import Classes, Layer, scalar, shown_range
from endoct.workbench.page.placing import Placing, placing_of
from endoct.workbench.page.plane import Plane
from endoct.workbench.page.wall import Wall

IMAGE, DEPTH, CELLS, DIFFERENCE = "image", "relief", "cells", "difference"
DRAWN = "drawn."
"""How keys of masks drawn by hand begin; those of sides have their name and a '-' before anything else."""
DRAWN_COLOURS = (0x00, 0x9E, 0x73), (0xCC, 0x79, 0xA7), (0xD5, 0x5E, 0x00), (0x56, 0xB4, 0xE9), (0xF0, 0xE4, 0x42)
CELL_COLOURS = COLOURS[ONLY_A], COLOURS[ONLY_B]
"""Of the cells of A and of B."""


class _Sampling(TypedDict):
    finest_level: int
    row_mm: float
    column_mm: float


@dataclass(frozen=True, eq=False)
class Described:
    """A layer, and what the page is told of it."""

    layer: Layer
    part: LayerPart


def wall_of(grid: SurfaceGrid) -> Wall:
    """Return the wall that the rows of ``grid`` cover."""
    first_mm, last_mm = (float(z_mm) for z_mm in grid.z_mm[[0, -1]])
    return Wall(grid.radius_mm, first_mm - grid.dz_mm / 2, last_mm + grid.dz_mm / 2)


def panorama_layers(store: Path, outline: PanoramaOutline, wall: Wall, cache: ChunkCache) -> Iterator[Described]:
    """Yield the layers of a panorama by itself."""
    placing = placing_of(outline.grid)
    for name in ("intensity", *(["depth_mm"] if outline.has_depth else [])):
        plane = _plane(store, name, (), placing, wall, cache)
        yield Described(
            layer := scalar(plane), _scalar_part(outline.modality, name, layer.low, layer.high, plane, wall)
        )


def comparison_layers(
    folder: Path, outline: ComparisonOutline, sides: Sequence[PanoramaOutline], wall: Wall, cache: ChunkCache
) -> Iterator[Described]:
    """Yield the layers of a comparison of ``sides``: images on their own samples, cells on the common grid."""
    common = folder / "comparison.zarr"
    masks = [_plane(common, "mask", (k,), placing_of(outline.grid), wall, cache) for k in (0, 1)]
    images = [list(_images(folder, outline, sides[k], k, wall, cache)) for k in (0, 1)]
    both = [plane for of_side in images for _, plane in of_side]
    list(thread_map(Plane.overview, both))  # every scale needs one: made side by side, they are there sooner
    for k, side in enumerate(outline.names):
        for name, plane in images[k]:
            yield Described(layer := scalar(plane), _scalar_part(side, name, layer.low, layer.high, plane, wall))
        shown = ClassPart("no cell", _hex(COLOURS[NEITHER])), ClassPart("cell", _hex(CELL_COLOURS[k]))
        part = _classes_part(f"{side}-{CELLS}", f"{side}: cells", side, shown, masks[k], wall)
        yield Described(Classes((masks[k],), (COLOURS[NEITHER], CELL_COLOURS[k])), part)
    yield from _drawn_layers(folder, outline.names[0], wall, cache)
    if outline.alignment is not None:
        a, b = outline.names
        labels = {NEITHER: "neither", BOTH: "both", ONLY_A: f"only {a}", ONLY_B: f"only {b}"}
        classes = tuple(ClassPart(labels[code], _hex(COLOURS[code])) for code in sorted(labels))
        part = _classes_part(DIFFERENCE, "difference of the cells", None, classes, masks[0], wall)
        yield Described(Classes(tuple(masks), COLOURS), part)


def _drawn_layers(folder: Path, side: str, wall: Wall, cache: ChunkCache) -> Iterator[Described]:
    """Yield the masks that were drawn by hand, on the wall of ``side``, in whose frame they lie."""
    drawn = read_drawn(folder)
    if drawn is None:
        return
    for k, title in enumerate(drawn.titles):
        plane = _plane(folder / DRAWN_STORE, "mask", (k,), placing_of(drawn.grid), wall, cache)
        colour = DRAWN_COLOURS[k % len(DRAWN_COLOURS)]
        shown = ClassPart("no cell", _hex(COLOURS[NEITHER])), ClassPart("cell", _hex(colour))
        part = _classes_part(f"{DRAWN}{k + 1}", f"drawn: {title}", side, shown, plane, wall)
        yield Described(Classes((plane,), (COLOURS[NEITHER], colour)), part)


def is_drawn_key(key: str) -> bool:
    """Say whether a layer is a mask drawn by hand."""
    return key.startswith(DRAWN)


def _images(
    folder: Path, outline: ComparisonOutline, panorama: PanoramaOutline, k: int, wall: Wall, cache: ChunkCache
) -> Iterator[tuple[str, Plane]]:
    """Yield the images of the side ``k`` by their names in its store."""
    own = folder / "panoramas" / f"{outline.names[k]}.zarr"
    # where every row of B was turned by itself, only the common grid shows where it was put
    is_rigid = k == 0 or outline.result.twist is None
    placing = placing_of(panorama.grid, outline.alignment if k else None) if is_rigid else placing_of(outline.grid)
    store, index = (own, ()) if is_rigid else (folder / "comparison.zarr", (k,))
    for name in ["intensity"] * (panorama.modality != MASK_MODALITY) + ["depth_mm"] * panorama.has_depth:
        yield name, _plane(store, name, index, placing, wall, cache)


def _plane(store: Path, name: str, index: tuple[int, ...], placing: Placing, wall: Wall, cache: ChunkCache) -> Plane:
    image, valid = (stored_image(store / part, cache, index) for part in (name, "valid"))
    return Plane(image, valid, placing, wall.radius_mm)


def _scalar_part(side: str, name: str, low: float, high: float, plane: Plane, wall: Wall) -> LayerPart:
    is_depth = name == "depth_mm"
    shown_low, shown_high = shown_range(plane.overview().averaged)
    return LayerPart(
        key=f"{side}-{DEPTH if is_depth else IMAGE}",
        title=f"{side}: {'relief' if is_depth else 'image'}",
        side=side,
        kind="scalar",
        quantity="wall radius − bore radius" if is_depth else "intensity",
        unit="mm" if is_depth else "a.u.",
        low=low,
        high=high,
        shown_low=shown_low,
        shown_high=shown_high,
        classes=(),
        **_sampling(plane, wall),
    )


def _classes_part(
    key: str, title: str, side: str | None, classes: tuple[ClassPart, ...], plane: Plane, wall: Wall
) -> LayerPart:
    last = float(len(classes) - 1)
    return LayerPart(
        key=key, title=title, side=side, kind="classes", quantity="cells", unit="", low=0.0, high=last,
        shown_low=0.0, shown_high=last, classes=classes, **_sampling(plane, wall),
    )  # fmt: skip


def _sampling(plane: Plane, wall: Wall) -> _Sampling:
    row_mm, column_mm = plane.placing.row_height_mm, plane.placing.dtheta_mm(wall.radius_mm)
    return {"finest_level": wall.level_for(min(row_mm, column_mm)), "row_mm": row_mm, "column_mm": column_mm}


def _hex(colour: tuple[int, int, int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
