"""Two sides on one grid: what a comparison of two panoramas gives."""

from dataclasses import dataclass

import numpy as np

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import Sampling
from endoct.fusion.result import Result
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.scoring.surface import Surface
from endoct.fusion.segmentation.segmented_side import SegmentedSide
from endoct.stitching.arrays import Image, readonly
from endoct.stitching.grid import SurfaceGrid


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedSide(Surface):
    """One side on a common grid in side A's frame, arrays (n_z, n_theta), read-only.

    Attributes
    ----------
    name: of the side; numbered where both are of one modality ("oct-1", "oct-2").
    mask, valid: bool, cells and what the side observed. ``labels`` numbers the cells.
    intensity: float32, 0 where not valid.
    depth_mm: float32, NaN where the side has none.
    source: the side on its own samples: panorama, evidence, segmentation. None, as ``relief_mm`` and ``contrast`` are,
        where the comparison was read from a store.
    """

    intensity: Image
    depth_mm: Image
    source: SegmentedSide | None = None

    def __post_init__(self) -> None:
        dtypes = {"intensity": np.float32, "depth_mm": np.float32, "mask": np.bool_, "valid": np.bool_}
        for name, dtype in dtypes.items():
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Both sides on one grid in side A's frame.

    Attributes
    ----------
    grid: covers the rows of both sides.
    sides: A first.
    alignment: where B lies in A's frame; None where that could not be found.
    reason: why not, in a full sentence; None where it was found.
    result: what ``result.json`` says; from :func:`~endoct.fusion.comparison.compare_panoramas` what fusion knows of it.
    cells: the cells of both sides as objects, A's first; empty where the comparison was read from a store written
        before there were any.
    """

    grid: SurfaceGrid
    sides: tuple[PlacedSide, PlacedSide]
    alignment: Alignment | None
    reason: str | None
    result: Result
    cells: tuple[Cell, ...] = ()

    @property
    def names(self) -> tuple[str, str]:
        """Names of the sides, A first."""
        return self.sides[0].name, self.sides[1].name


def place(source: SegmentedSide, sampling: Sampling, grid: SurfaceGrid) -> PlacedSide:
    """Return a side on ``grid``, ``sampling`` saying where its samples lie."""
    panorama, placement = source.side.panorama, sampling.onto(grid)
    intensity, valid = placement.image(panorama.intensity, panorama.valid)
    relief, contrast, depth_mm = source.side.relief, source.contrast, panorama.depth_mm
    nowhere = np.full(grid.shape, np.nan, np.float32)
    return PlacedSide(
        name=source.side.name,
        mask=placement.mask(source.segmentation.mask, panorama.valid)[0],
        valid=valid,
        relief_mm=None if relief is None else placement.known(relief.values, relief.valid),
        contrast=None if contrast is None else placement.known(contrast.values, contrast.valid),
        intensity=intensity,
        depth_mm=nowhere if depth_mm is None else placement.known(depth_mm, panorama.valid & np.isfinite(depth_mm)),
        source=source,
    )
