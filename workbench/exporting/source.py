"""What can be exported: a panorama, a comparison, or the truth of a simulated specimen, opened without its images."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError, visible
from endoct.base.files.files import path_text
from endoct.base.files.json_values import number
from endoct.base.numeric.regions import label_in_order
from endoct.base.zarr.window import ChunkCache, StoredImage, stored_image
from endoct.base.zarr.zarr_store import read_arrays, read_attributes
from endoct.fusion.files.store import COMPARISON_STORE
from endoct.fusion.files.store import read_outline as read_comparison
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import is_panorama
from endoct.stitching.store import read_outline as read_panorama
from endoct.workbench.exporting.image_layers import Ids, ImageLayer, LabelLayer, even_rows, lies_evenly
from endoct.workbench.kinds import check_has_wall, is_comparison

ExportableKind = Literal["panorama", "comparison", "truth"]
TRUTH = "truth"
MOST_IDS = np.iinfo(np.uint16).max


@dataclass(frozen=True, eq=False)
class Exportable:
    """What is exported.

    Attributes
    ----------
    path: The path as given; ``folder`` is what of it is read, which no output may lie in.
    grid: The grid of every image, with rows at even steps.
    sides: Names of the sides; of a panorama its modality, of truth "truth".
    alignment: That of a comparison; None where its sides are not aligned.
    panoramas: The stores of sides that have one, for what is known per frame.
    volume: The dense volume, where there is one.
    doubts, notes: What questions it, and what whoever opens the export elsewhere has to know.
    """

    path: Path
    folder: Path
    kind: ExportableKind
    grid: SurfaceGrid
    sides: tuple[str, ...]
    layers: tuple[ImageLayer, ...]
    labels: tuple[LabelLayer, ...] = ()
    alignment: Alignment | None = None
    panoramas: Mapping[str, Path] = field(default_factory=dict)
    volume: Path | None = None
    doubts: tuple[Doubt, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """A short name that every format can hold."""
        return visible(path_text(self.path.resolve().name)).removesuffix(".zarr")

    def layer(self, side: str, quantity: str) -> ImageLayer | None:
        """Return the layer of ``side``, None where it has none."""
        return next((layer for layer in self.layers if (layer.side, layer.quantity) == (side, quantity)), None)


def open_for_export(path: Path) -> Exportable:
    """Open what `endoct unroll`, `endoct compare` or `endoct simulate` wrote to ``path``.

    Raises :class:`EndoctError` where it is none of these, or damaged.
    """
    if is_panorama(path):
        return _panorama(path)
    if is_comparison(path):
        return _comparison(path, path)
    if path.name == COMPARISON_STORE and path.is_dir():
        return _comparison(path, path.parent)
    for folder in (path / "truth", path, path.parent):
        if (folder / "wall.zarr").is_dir() and (folder == path.parent) == (path.name == "wall.zarr"):
            return _truth(path, folder / "wall.zarr")
    check_has_wall(path)
    raise EndoctError(
        f"{path} cannot be exported",
        found="neither a panorama, a comparison nor a truth" if path.exists() else "no such file or folder",
        expected="what `endoct unroll`, `endoct compare` or `endoct simulate` wrote",
        remedy="unroll a recording first" if path.exists() else "check the path",
    )


def _panorama(path: Path) -> Exportable:
    outline, cache = read_panorama(path), ChunkCache()
    grid, rows = even_rows(outline.grid)
    attributes, side = read_attributes(path), outline.modality
    stored = partial(_image, path, outline.grid, cache)
    valid = stored("valid")
    layers = [ImageLayer(f"{side} intensity", side, "intensity", "", stored("intensity"), valid, rows)]
    if outline.has_depth:
        relief = stored("depth_mm")
        layers.append(ImageLayer(f"{side} relief", side, "relief", "mm", relief, valid, rows))
    notes = []
    if not attributes.get("handedness_known"):
        notes.append("Nothing says whether θ runs with or against the recording: what is exported may be mirrored.")
    if not attributes.get("travel_known"):
        notes.append("Nothing says which way the instrument travelled: z may run outward.")
    if not lies_evenly(outline.grid):
        notes.append(f"The rows lie unevenly; each exported one, every {grid.dz_mm:.4g} mm, is the nearest of them.")
    volume = path / "volume"
    return Exportable(
        path=path,
        folder=path,
        kind="panorama",
        grid=grid,
        sides=(side,),
        layers=tuple(layers),
        panoramas={side: path},
        volume=volume if (volume / "intensity").is_dir() else None,
        doubts=outline.doubts,
        notes=tuple(notes),
    )


def _comparison(path: Path, folder: Path) -> Exportable:
    store = folder / COMPARISON_STORE
    outline, cache = read_comparison(store), ChunkCache()
    grid, rows = even_rows(outline.grid)
    aligned = outline.alignment is not None
    notes = () if aligned else (f"The sides are not aligned: {outline.names[1]} lies in a frame of its own.",)
    layers, labels, stored = [], [], partial(_image, store, outline.grid, cache)
    for k, side in enumerate(outline.names):
        where = side if aligned or k == 0 else f"{side} (not aligned)"
        valid, mask, image = stored("valid", (k,)), stored("mask", (k,)), stored("intensity", (k,))
        layers.append(ImageLayer(f"{where} intensity", side, "intensity", "", image, valid, rows))
        relief = stored("depth_mm", (k,))
        if _is_somewhere_known(relief):
            layers.append(ImageLayer(f"{where} relief", side, "relief", "mm", relief, valid, rows))
        labels.append(LabelLayer(f"{where} cells", side, partial(_cells, mask)))
        labels.append(LabelLayer(f"{where} observed", side, partial(_whole, valid)))
    stores = {side: folder / "panoramas" / f"{side}.zarr" for side in outline.names}
    return Exportable(
        path=path,
        folder=folder,
        kind="comparison",
        grid=grid,
        sides=outline.names,
        layers=tuple(layers),
        labels=tuple(labels),
        alignment=outline.alignment,
        panoramas={side: store for side, store in stores.items() if is_panorama(store)},
        doubts=tuple(outline.result.doubts),
        notes=notes,
    )


def _truth(path: Path, wall: Path) -> Exportable:
    attributes, what, cache = read_attributes(wall), f"the truth {wall}", ChunkCache()
    z_mm = read_arrays(wall, ("z",)).get("z")
    relief, ids = stored_image(wall / "relief_mm", cache), stored_image(wall / "cell_id", cache)
    if z_mm is None or z_mm.shape != relief.shape[:1] or z_mm.size < 2 or ids.shape != relief.shape:
        raise EndoctError(f"{what} is not whole", remedy="simulate the specimen again")
    grid = SurfaceGrid.full_circle(
        *relief.shape,
        z0_mm=float(z_mm[0]),
        dz_mm=float(z_mm[-1] - z_mm[0]) / (z_mm.size - 1),
        radius_mm=number(attributes, "bore_radius_mm", 0.01, 1e3, what),
    )
    return Exportable(
        path=path,
        folder=wall.parent,
        kind="truth",
        grid=grid,
        sides=(TRUTH,),
        layers=(ImageLayer(f"{TRUTH} relief", TRUTH, "relief", "mm", relief, None, np.arange(grid.n_z)),),
        labels=(LabelLayer(f"{TRUTH} cells", TRUTH, partial(_whole, ids)),),
        notes=("It lies in the frame of the bore, z from its mouth: not in that of a panorama of it.",),
    )


def _image(store: Path, grid: SurfaceGrid, cache: ChunkCache, name: str, index: tuple[int, ...] = ()) -> StoredImage:
    """Return an image of a store. Raises :class:`EndoctError` where it has another shape than its ``grid``."""
    image = stored_image(store / name, cache, index)
    if image.shape != grid.shape:
        raise EndoctError(f"{store} is damaged", found=f"{name} of {image.shape}", expected=f"(z, theta) {grid.shape}")
    return image


def _is_somewhere_known(image: StoredImage) -> bool:
    rows, columns = image.shape
    high = image.chunk[0]
    return any(
        np.isfinite(image.read(slice(first, min(first + high, rows)), slice(0, columns))).any()
        for first in range(0, rows, high)
    )


def _whole(image: StoredImage) -> Ids:
    """Return a stored image of whole numbers. Raises :class:`EndoctError` where one does not fit into 16 bits."""
    rows, columns = image.shape
    stored = image.read(slice(0, rows), slice(0, columns))
    if stored.dtype.kind not in "biu" or stored.min() < 0 or stored.max() > MOST_IDS:
        found = f"{stored.dtype} from {stored.min()} to {stored.max()}"
        raise EndoctError(f"{image.declared.folder} does not hold ids", found=found, expected=f"0 to {MOST_IDS}")
    return stored.astype(np.uint16)


def _cells(mask: StoredImage) -> Ids:
    """Return the ids of the cells in a stored mask: those of ``cells.csv``, 0 where there is none."""
    labels = label_in_order(_whole(mask) > 0)
    if labels.max() > MOST_IDS:
        raise EndoctError(f"{mask.declared.folder} has too many cells", found=f"{labels.max()}", expected=f"{MOST_IDS}")
    return labels.astype(np.uint16)
