"""What a comparison of two panoramas gives."""

from dataclasses import dataclass

import numpy as np

from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result import Result
from endoct.fusion.scoring.cells import Cell
from endoct.stitching.arrays import Image, Mask, readonly
from endoct.stitching.grid import SurfaceGrid


@dataclass(frozen=True, eq=False)
class Comparison:
    """Both sides on one grid in side A's frame.

    Attributes
    ----------
    grid: covers the rows of both sides.
    sides: names of the sides, A first; numbered where they are the same ("oct-1", "oct-2").
    intensity: float32 (2, n_z, n_theta), 0 where not valid.
    depth_mm: float32 (2, n_z, n_theta), NaN where a side has none.
    mask: bool (2, n_z, n_theta), cells.
    valid: bool (2, n_z, n_theta), observed by that side.
    alignment: where B lies in A's frame; None where that could not be found.
    reason: why not, in a full sentence; None where it was found.
    result: what ``result.json`` says; from :func:`~endoct.fusion.comparison.compare_panoramas` what fusion knows of it.
    cells: the cells of both sides as objects, A's first; empty where the comparison was read from a store written
        before there were any.

    Arrays are read-only.
    """

    grid: SurfaceGrid
    sides: tuple[str, str]
    intensity: Image
    depth_mm: Image
    mask: Mask
    valid: Mask
    alignment: Alignment | None
    reason: str | None
    result: Result
    cells: tuple[Cell, ...] = ()

    def __post_init__(self) -> None:
        for name, dtype in (
            ("intensity", np.float32),
            ("depth_mm", np.float32),
            ("mask", np.bool_),
            ("valid", np.bool_),
        ):
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))
