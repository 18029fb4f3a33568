"""OME-Zarr and OME-TIFF: pyramids of images in mm, a channel for each image of each side, masks and cells as labels.

OME-Zarr, 0.5 and 0.4, is a page of JSON over Zarr, which endoct has anyway; a library for it would bring Dask along.
In an OME-TIFF large images lie in tiles, with coarser levels. Others lie in strips: ITK, and so SimpleITK and 3D
Slicer, reads no tiles.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numcodecs
import numpy as np
import tifffile
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec

from endoct.base.files.contents import output_digest
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.exporting.image_layers import (
    ImageLayer,
    LabelLayer,
    PyramidLevel,
    blocks,
    contrast_of,
    levels_of,
    read_level,
    thinned,
)
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.source import TRUTH, Exportable
from endoct.workbench.requests import ExportRequest, OmeVersion
from endoct.workbench.running.progress import Advance, Stages

CHUNK_PX = 512
UNIT = "millimeter"
COLOURS = "FF00FF", "00FF00"
"""Of the two sides. Where both are bright the sum is white, and no kind of colour blindness mixes the two up."""
TILE_PX = 512
LARGE_PX = 2048
"""An image of a TIFF with a longer side has tiles and coarser levels."""
STRIP_ROWS = 64
_BIG_BYTES = 2_000_000_000
"""Larger TIFF files get offsets of 64 bits, as compression may save nothing."""

Window = Callable[[int, int], NDArray[Any]]
"""From one row to before another, these rows of a layer at a level."""


def write_ome_zarr(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the images of ``source`` to the folder ``path``: axes (c, y, x), y along z and x along θ, in mm.

    x is the arc on the nominal wall, from θ = 0; its last sample and its first are neighbours. NaN where nothing was
    observed. Returns what was written.
    """
    version: OmeVersion = request.version or "0.5"
    levels = levels_of(source.grid)
    group = zarr.create_group(path, zarr_format=3 if version == "0.5" else 2)
    with stages.stage("OME-Zarr") as advance:
        arrays = [
            _array(group, str(k), (len(source.layers), *level.shape), np.dtype(np.float32), version)
            for k, level in enumerate(levels)
        ]
        for channel, layer in enumerate(source.layers):
            for k, (level, array) in enumerate(zip(levels, arrays, strict=True)):
                for first, last in blocks(0, level.shape[0], CHUNK_PX):
                    array[channel, first:last] = read_level(layer, level, first, last)
                    done = k + last / level.shape[0]
                    advance((channel + done / len(levels)) / len(source.layers))
        attributes = _multiscales(source.title, source.grid, levels, "c", version)
        colours = dict(zip(source.sides, COLOURS if len(source.sides) > 1 else ("FFFFFF",), strict=True))
        attributes["omero"] = {"channels": [_channel(layer, colours[layer.side]) for layer in source.layers]}
        _describe(group, attributes, version)
        if source.labels:
            _write_labels(group, source.labels, source.grid, levels, version)
    return {
        "version": version,
        "channels": [layer.name for layer in source.layers],
        "labels": [layer.name for layer in source.labels],
        "shape": [len(source.layers), *source.grid.shape],
        "step_mm": list(levels[0].step_mm(source.grid)),
        "levels": len(levels),
    }


def _write_labels(
    group: zarr.Group,
    labels: Sequence[LabelLayer],
    grid: SurfaceGrid,
    levels: Sequence[PyramidLevel],
    version: OmeVersion,
) -> None:
    names = [layer.name.replace(" ", "-") for layer in labels]
    below = group.create_group("labels")
    _describe(below, {"labels": names}, version)
    for name, layer in zip(names, labels, strict=True):
        one, ids = below.create_group(name), layer.read()
        for k, level in enumerate(levels):
            _array(one, str(k), level.shape, ids.dtype, version)[...] = thinned(ids, level)
        attributes = _multiscales(layer.name, grid, levels, "", version)
        source: dict[str, Any] = {"source": {"image": "../../"}}
        attributes["image-label"] = source if version == "0.5" else {"version": version, **source}
        _describe(one, attributes, version)


def _multiscales(
    name: str, grid: SurfaceGrid, levels: Sequence[PyramidLevel], first_axes: str, version: OmeVersion
) -> dict[str, Any]:
    channel = [{"name": axis, "type": "channel"} for axis in first_axes]
    before, at = [1.0] * len(channel), [0.0] * len(channel)
    multiscale: dict[str, Any] = {
        "name": name,
        "axes": [*channel, *({"name": axis, "type": "space", "unit": UNIT} for axis in "yx")],
        "datasets": [
            {
                "path": str(k),
                "coordinateTransformations": [
                    {"type": "scale", "scale": [*before, *level.step_mm(grid)]},
                    {"type": "translation", "translation": [*at, *level.origin_mm(grid)]},
                ],
            }
            for k, level in enumerate(levels)
        ],
        "type": "mean" if first_axes else "nearest",
    }
    return {"multiscales": [multiscale if version == "0.5" else {"version": version, **multiscale}]}


def _channel(layer: ImageLayer, colour: str) -> dict[str, object]:
    """Return how viewers display a layer at first: brightness in the colour of its side; relief on demand."""
    low, high = contrast_of(layer)
    window = {"min": low, "max": high, "start": low, "end": high}
    is_first = layer.quantity == "intensity" or layer.side == TRUTH
    return {
        "label": layer.title,
        "color": colour if is_first else "FFFFFF",
        "active": is_first,
        "coefficient": 1,
        "family": "linear",
        "window": window,
    }


def _describe(group: zarr.Group, attributes: Mapping[str, Any], version: OmeVersion) -> None:
    """Write what OME-Zarr says of a group: 0.5 keeps it apart under "ome", 0.4 does not."""
    group.update_attributes({"ome": {"version": version, **attributes}} if version == "0.5" else dict(attributes))


def _array(group: zarr.Group, name: str, shape: tuple[int, ...], dtype: np.dtype[Any], version: OmeVersion) -> Any:
    """Return a new array in chunks of one channel; its parts that hold nothing but NaN, or 0, take no file."""
    sizes = tuple(1 if axis < len(shape) - 2 else min(CHUNK_PX, n) for axis, n in enumerate(shape))
    fill: float = float("nan") if dtype.kind == "f" else 0
    stored: dict[str, Any]
    if version == "0.5":
        compressor = BloscCodec(cname="zstd", clevel=3, shuffle="shuffle")
        stored = {"compressors": compressor, "dimension_names": ("c", "y", "x")[-len(shape) :]}
    else:
        blosc = numcodecs.Blosc(cname="zstd", clevel=3, shuffle=numcodecs.Blosc.SHUFFLE)
        stored = {"compressors": blosc, "chunk_key_encoding": {"name": "v2", "separator": "/"}}
    return group.create_array(name, shape=shape, dtype=dtype, chunks=sizes, fill_value=fill, **stored)


def write_ome_tiff(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write the images of ``source`` to one file: float32, NaN where nothing was observed. Returns what was written."""
    del request

    def images(layer: ImageLayer, level: PyramidLevel) -> Window:
        return lambda first, last: read_level(layer, level, first, last)

    with stages.stage("OME-TIFF") as advance:
        layers = [(layer.title, partial(images, layer)) for layer in source.layers]
        return _write_tiff(path, source, layers, np.dtype(np.float32), advance)


def write_labels(source: Exportable, path: Path, request: ExportRequest, stages: Stages) -> dict[str, object]:
    """Write masks and ids of cells to one file: uint16, 0 for wall, 1, 2 … as in ``cells.csv``.

    A channel for the cells of each side, and one that is 1 where that side observed. Returns what was written.
    """
    del request
    kept: dict[str, NDArray[np.uint16]] = {}

    def labels(layer: LabelLayer, level: PyramidLevel) -> Window:
        if layer.name not in kept:
            kept.clear()  # one at a time: they are read whole, as cells are found around the circle
            kept[layer.name] = layer.read()
        ids = thinned(kept[layer.name], level)
        return lambda first, last: ids[first:last]

    with stages.stage("labels") as advance:
        layers = [(layer.name, partial(labels, layer)) for layer in source.labels]
        return _write_tiff(path, source, layers, np.dtype(np.uint16), advance)


def _write_tiff(
    path: Path,
    source: Exportable,
    layers: Sequence[tuple[str, Callable[[PyramidLevel], Window]]],
    dtype: np.dtype[Any],
    advance: Advance,
) -> dict[str, object]:
    """Write channels, each with its name and what reads its rows at a level; return what was written."""
    levels, names = levels_of(source.grid), [name for name, _ in layers]
    levels = levels if max(source.grid.shape) > LARGE_PX else levels[:1]
    n_rows, n_done = len(names) * sum(level.shape[0] for level in levels), 0

    def rows(level: PyramidLevel) -> Iterator[NDArray[Any]]:
        nonlocal n_done
        for _, window in layers:
            read = window(level)
            for first, last in blocks(0, level.shape[0], TILE_PX):
                yield read(first, last)
                n_done += last - first
                advance(n_done / n_rows)

    n_bytes = len(names) * dtype.itemsize * sum(level.shape[0] * level.shape[1] for level in levels)
    with tifffile.TiffWriter(path, ome=True, bigtiff=n_bytes > _BIG_BYTES) as tiff:
        for k, level in enumerate(levels):
            step_z_mm, step_theta_mm = level.step_mm(source.grid)
            own: dict[str, Any] = {"subfiletype": 1}
            cut: dict[str, Any] = {"data": _pages(rows(level), level.shape[0]), "rowsperstrip": STRIP_ROWS}
            if k == 0:
                # of the same the same, without the time and the machine's number
                identifier = uuid5(NAMESPACE_URL, f"endoct:{output_digest(source.folder)}:{names}")
                described = {"UUID": f"urn:uuid:{identifier}", **_tiff_metadata(names, source.grid, source.title)}
                own = {"subifds": len(levels) - 1, "software": f"endoct {BLANK}", "metadata": described}
            if len(levels) > 1:
                cut = {"data": _tiles(rows(level), level.shape[1]), "tile": (TILE_PX, TILE_PX)}
            tiff.write(
                shape=(len(names), *level.shape),
                dtype=dtype,
                photometric="minisblack",
                compression="zlib",
                resolution=(10 / step_theta_mm, 10 / step_z_mm),
                resolutionunit="CENTIMETER",
                **cut,
                **own,
            )
    mark(path)
    step_mm, shape = list(levels[0].step_mm(source.grid)), [len(names), *source.grid.shape]
    return {"channels": names, "shape": shape, "step_mm": step_mm, "levels": len(levels)}


def _pages(rows: Iterator[NDArray[Any]], n_rows: int) -> Iterator[NDArray[Any]]:
    """Yield whole channels from blocks of their rows."""
    page: list[NDArray[Any]] = []
    for block in rows:
        page.append(block)
        if sum(map(len, page)) == n_rows:
            yield np.concatenate(page)
            page.clear()


def _tiles(rows: Iterator[NDArray[Any]], n_columns: int) -> Iterator[NDArray[Any]]:
    for block in rows:
        for left, right in blocks(0, n_columns, TILE_PX):
            tile = np.zeros((TILE_PX, TILE_PX), block.dtype)
            tile[: block.shape[0], : right - left] = block[:, left:right]
            yield tile


def _tiff_metadata(names: Sequence[str], grid: SurfaceGrid, title: str) -> dict[str, Any]:
    step_z_mm, step_theta_mm = grid.dz_mm, grid.dtheta_mm
    n = len(names)
    return {
        "axes": "CYX",
        "Name": title,
        "Channel": {"Name": list(names)},
        "PhysicalSizeX": step_theta_mm,
        "PhysicalSizeXUnit": "mm",
        "PhysicalSizeY": step_z_mm,
        "PhysicalSizeYUnit": "mm",
        "Plane": {
            "PositionX": [grid.theta0_rad * grid.radius_mm] * n,
            "PositionXUnit": ["mm"] * n,
            "PositionY": [grid.z0_mm] * n,
            "PositionYUnit": ["mm"] * n,
        },
    }
