"""Drawn masks on disk: ``drawn.zarr`` next to ``comparison.zarr``, on the same grid."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.base.errors import EndoctError, refusing
from endoct.base.zarr.zarr_metadata import OWN, declared
from endoct.base.zarr.zarr_store import Named, read_arrays, read_attributes, write_arrays
from endoct.fusion.scoring.raters import MOST_DRAWINGS, Drawing
from endoct.stitching.grid import SurfaceGrid, grid_attributes
from endoct.stitching.store import stored_grid

FORMAT = "endoct-drawn-1"
NAME = "drawn.zarr"
MAJORITY = "most raters"
"""In place of a rater's name: what most raters drew."""
LONGEST_NAME = 200


@dataclass(frozen=True)
class DrawnOutline:
    """Drawn masks on disk without the masks: their ``grid``, and of each the rater and the session."""

    grid: SurfaceGrid
    drawn_by: tuple[tuple[str, str], ...]

    @property
    def titles(self) -> tuple[str, ...]:
        """Return what to call each mask: its rater, and the session where that is not the only one."""
        return tuple(rater if session == "1" else f"{rater}, {session}" for rater, session in self.drawn_by)


def save_drawings(drawings: Sequence[Drawing], grid: SurfaceGrid, path: Path) -> None:
    """Write ``drawings``, masks bool (n_z, n_theta) on ``grid``, to ``path``, which must not exist.

    Dims (drawing, z, theta) with coordinates in mm and rad; variables ``mask`` and ``valid``, and ``rater`` and
    ``session`` on dim drawing.
    """
    dims, chunks = ("drawing", "z", "theta"), (1, min(grid.n_z, 512), grid.n_theta)
    arrays = {
        "mask": Named(dims, np.stack([one.mask for one in drawings]), {"long_name": "cells as drawn"}, chunks),
        "valid": Named(dims, np.stack([one.valid for one in drawings]), {"long_name": "where it was drawn"}, chunks),
        "rater": Named(("drawing",), np.array([one.rater for one in drawings], object)),
        "session": Named(("drawing",), np.array([one.session for one in drawings], object)),
        "z": Named(("z",), grid.z_mm, {"units": "mm"}),
        "theta": Named(("theta",), grid.theta_rad, {"units": "rad"}),
    }
    write_arrays(path, arrays, {"format": FORMAT, **grid_attributes(grid)}, coordinates=("rater", "session"))


def read_drawn(folder: Path) -> DrawnOutline | None:
    """Return what was drawn of the comparison in ``folder``; None where nothing was.

    Raises :class:`EndoctError` where the store is something else, or damaged.
    """
    path = folder / NAME
    if not path.is_dir():
        return None
    expected = "a store written by `endoct compare`"
    with refusing(f"{path} cannot be read", expected=expected):
        attributes, shape = read_attributes(path), declared(path / "mask", OWN).shape
        names = read_arrays(path, ("rater", "session"))
        drawn_by = tuple(
            (str(rater)[:LONGEST_NAME], str(session)[:LONGEST_NAME])
            for rater, session in zip(names["rater"].tolist(), names["session"].tolist(), strict=True)
        )
        sound = len(shape) == 3 and shape[0] == len(drawn_by) <= MOST_DRAWINGS + 1
        if attributes.get("format") != FORMAT or not sound or declared(path / "valid", OWN).shape != shape:
            raise EndoctError(f"{path} cannot be read", found=f"masks of shape {shape}", expected=expected)
        return DrawnOutline(stored_grid(attributes, shape, f"the masks in {path}"), drawn_by)
