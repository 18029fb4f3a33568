"""OME-Zarr, 0.5 and 0.4: a pyramid of images in mm with both sides as channels, masks and cells as labels.

The specification is a page of JSON over Zarr, which endoct has anyway; a library for it would bring Dask along.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec

from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.exporting.formats import OmeVersion, Options
from endoct.workbench.exporting.image_layers import (
    LabelLayer,
    Layer,
    Level,
    blocks,
    contrast_of,
    levels_of,
    read_level,
    thinned,
)
from endoct.workbench.exporting.source import TRUTH, Source
from endoct.workbench.running.progress import Stages

CHUNK_PX = 512
UNIT = "millimeter"
COLOURS = "FF00FF", "00FF00"
"""Colours of the two sides. Where both are bright the sum is white, and no kind of colour blindness mixes the two
up."""


def write_ome_zarr(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the images of ``source`` to the folder ``path``: axes (c, y, x), y along z and x along θ, in mm.

    x is the arc on the nominal wall, from θ = 0; its last sample and its first are neighbours. NaN where nothing was
    observed. Returns what was written.
    """
    version: OmeVersion = options.version or "0.5"
    levels = levels_of(source.grid)
    group = _group(path, version)
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
    group: zarr.Group, labels: Sequence[LabelLayer], grid: SurfaceGrid, levels: Sequence[Level], version: OmeVersion
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
    name: str, grid: SurfaceGrid, levels: Sequence[Level], first_axes: str, version: OmeVersion
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


def _channel(layer: Layer, colour: str) -> dict[str, object]:
    """Return how viewers display a layer at first: brightness in the colour of its side; relief on demand."""
    low, high = contrast_of(layer)
    window = {"min": low, "max": high, "start": low, "end": high}
    label = f"{layer.name} ({layer.unit})" if layer.unit else layer.name
    is_first = layer.quantity == "intensity" or layer.side == TRUTH
    return {
        "label": label,
        "color": colour if is_first else "FFFFFF",
        "active": is_first,
        "coefficient": 1,
        "family": "linear",
        "window": window,
    }


def _group(path: Path, version: OmeVersion) -> zarr.Group:
    return zarr.create_group(path, zarr_format=3 if version == "0.5" else 2)


def _describe(group: zarr.Group, attributes: Mapping[str, Any], version: OmeVersion) -> None:
    """Write what OME-Zarr says of a group: 0.5 keeps it apart under "ome", 0.4 does not."""
    group.update_attributes({"ome": {"version": version, **attributes}} if version == "0.5" else dict(attributes))


def _array(group: zarr.Group, name: str, shape: tuple[int, ...], dtype: np.dtype[Any], version: OmeVersion) -> Any:
    """Return a new array in chunks of one channel; its parts that hold nothing but NaN, or 0, take no file."""
    sizes = tuple(1 if axis < len(shape) - 2 else min(CHUNK_PX, n) for axis, n in enumerate(shape))
    fill: float = float("nan") if dtype.kind == "f" else 0
    axes = ("c", "y", "x")[-len(shape) :]
    if version == "0.5":
        compressor = BloscCodec(cname="zstd", clevel=3, shuffle="shuffle")
        return group.create_array(
            name,
            shape=shape,
            dtype=dtype,
            chunks=sizes,
            compressors=compressor,
            fill_value=fill,
            dimension_names=axes,
        )
    import numcodecs

    return group.create_array(
        name,
        shape=shape,
        dtype=dtype,
        chunks=sizes,
        compressors=numcodecs.Blosc(cname="zstd", clevel=3, shuffle=numcodecs.Blosc.SHUFFLE),
        fill_value=fill,
        chunk_key_encoding={"name": "v2", "separator": "/"},
    )
