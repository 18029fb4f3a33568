"""OME-TIFF: images with sizes in mm, a channel for each image of each side; large ones in tiles, with coarser levels.

Images that are not large lie in strips: ITK, and so SimpleITK and 3D Slicer, reads no tiles.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np
import tifffile
from numpy.typing import NDArray

from endoct.base.files.contents import output_digest
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.exporting.formats import Options
from endoct.workbench.exporting.image_layers import Level, blocks, levels_of, read_level, thinned
from endoct.workbench.exporting.mark import BLANK, mark
from endoct.workbench.exporting.source import Source
from endoct.workbench.running.progress import Advance, Stages

Rows = Callable[[Level], Iterator[NDArray[Any]]]

TILE_PX = 512
LARGE_PX = 2048
"""An image with a longer side has tiles and coarser levels."""
STRIP_ROWS = 64
_BIG_BYTES = 2_000_000_000
"""Larger files get offsets of 64 bits, as compression may save nothing."""


def write_ome_tiff(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write the images of ``source`` to one file: float32, NaN where nothing was observed. Returns what was written."""
    del options
    levels = _levels(source.grid)
    with stages.stage("OME-TIFF") as advance:
        total = len(source.layers) * sum(level.shape[0] for level in levels)
        done = _Counter(advance, total)

        def rows(level: Level) -> Iterator[NDArray[Any]]:
            for layer in source.layers:
                for first, last in blocks(0, level.shape[0], TILE_PX):
                    yield read_level(layer, level, first, last)
                    done.add(last - first)

        names = [f"{layer.name} ({layer.unit})" if layer.unit else layer.name for layer in source.layers]
        _write(path, source, names, np.dtype(np.float32), levels, rows)
    return _facts(source, names, levels)


def write_labels(source: Source, path: Path, options: Options, stages: Stages) -> dict[str, object]:
    """Write masks and ids of cells to one file: uint16, 0 for wall, 1, 2 … as in ``cells.csv``.

    A channel for the cells of each side, and one that is 1 where that side observed. Returns what was written.
    """
    del options
    levels = _levels(source.grid)
    with stages.stage("labels") as advance:
        done = _Counter(advance, len(source.labels) * sum(level.shape[0] for level in levels))
        kept: dict[str, NDArray[np.uint16]] = {}

        def rows(level: Level) -> Iterator[NDArray[Any]]:
            for layer in source.labels:
                if layer.name not in kept:
                    kept.clear()  # one at a time: they are read whole, as cells are found around the circle
                    kept[layer.name] = layer.read()
                ids = thinned(kept[layer.name], level)
                for first, last in blocks(0, level.shape[0], TILE_PX):
                    yield ids[first:last]
                    done.add(last - first)

        names = [layer.name for layer in source.labels]
        _write(path, source, names, np.dtype(np.uint16), levels, rows)
    return _facts(source, names, levels)


def _write(
    path: Path, source: Source, names: Sequence[str], dtype: np.dtype[Any], levels: Sequence[Level], rows: Rows
) -> None:
    """Write channels ``names``; ``rows(level)`` yields their rows channel by channel, in blocks as high as a tile."""
    n_bytes = len(names) * dtype.itemsize * sum(level.shape[0] * level.shape[1] for level in levels)
    with tifffile.TiffWriter(path, ome=True, bigtiff=n_bytes > _BIG_BYTES) as tiff:
        for k, level in enumerate(levels):
            step_z_mm, step_theta_mm = level.step_mm(source.grid)
            own: dict[str, Any] = {"subfiletype": 1}
            cut: dict[str, Any] = {"data": _pages(rows(level), level.shape[0]), "rowsperstrip": STRIP_ROWS}
            if k == 0:
                described = {"UUID": _identifier(source, names), **_metadata(names, source.grid, source.title)}
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


def _identifier(source: Source, names: Sequence[str]) -> str:
    """Return the UUID that OME wants of a file: of the same the same, without the time and the machine's number."""
    return f"urn:uuid:{uuid5(NAMESPACE_URL, f'endoct:{output_digest(source.folder)}:{names}')}"


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


def _metadata(names: Sequence[str], grid: SurfaceGrid, title: str) -> dict[str, Any]:
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


def _levels(grid: SurfaceGrid) -> tuple[Level, ...]:
    levels = levels_of(grid)
    return levels if max(grid.shape) > LARGE_PX else levels[:1]


def _facts(source: Source, names: Sequence[str], levels: Sequence[Level]) -> dict[str, object]:
    return {
        "channels": list(names),
        "shape": [len(names), *source.grid.shape],
        "step_mm": list(levels[0].step_mm(source.grid)),
        "levels": len(levels),
    }


class _Counter:
    def __init__(self, advance: Advance, total: int) -> None:
        self._advance, self._total, self._done = advance, total, 0

    def add(self, rows: int) -> None:
        self._done += rows
        self._advance(self._done / self._total)
