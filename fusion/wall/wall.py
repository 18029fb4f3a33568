"""The one wall that both sides of a comparison know: each sample's relief, whether it is a cell, and who decided."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.ranks import robust_sigma
from endoct.base.numeric.regions import label, quantiles, remove_small
from endoct.fusion.sides import Placed
from endoct.fusion.wall.both_sides import FARTHEST_MM, BothSides, cell_features
from endoct.fusion.wall.network import answers
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame

NOBODY, BY_LIGHT, BY_DEPTH, BY_BOTH = range(4)
"""Who decided a sample: nobody saw it, one side alone was followed, or both say the same or were weighed."""
SMALLEST_MM2 = 0.01
"""Smaller cells are none, as on either side."""
TRUST_MM = 0.05
"""A standard error of depth by parallax of this size halves the trust in it."""
LEAST_SHARE = 0.5
"""A sample on a measured row is a cell's by depth where a larger share of it is."""
WIDEST_MM = 1.5
"""A wider cell is no deeper for that."""
SHALLOWEST_MM = 0.01
"""No cell is less deep."""
ERRORS_MM = (0.005, 1.0)
"""No depth is known better or worse."""
OF_SCALE = 1.35
"""A standard error is so many scales of the Student's t, with 4 degrees of freedom, that the network learned: by that,
one and two of it hold 75 % and 95 %, and in bores it was not trained on less."""


@dataclass(frozen=True, eq=False)
class Wall:
    """The wall of two placed sides on their common ``grid``, arrays (n_z, n_theta).

    Attributes
    ----------
    probability: float32, of a cell; NaN where neither side observed the wall.
    cells: bool.
    relief_mm, error_mm: float32, how far the surface lies behind the bore's wall, and its standard error; NaN where
        neither side tells.
    decided: uint8, ``NOBODY``, ``BY_LIGHT``, ``BY_DEPTH`` or ``BY_BOTH``.
    """

    grid: SurfaceGrid
    probability: Image
    cells: Mask
    relief_mm: Image
    error_mm: Image
    decided: NDArray[np.uint8]

    @property
    def observed(self) -> Mask:
        """Where either side observed the wall."""
        return np.asarray(self.decided != NOBODY)

    def as_panorama(self, placed: Placed) -> Panorama:
        """Return the wall as a panorama of the modality "wall", in the frame of side A, for whatever takes one.

        Its intensity is that of the side which sees light, 1 where that saw nothing or is a drawing; it is valid where
        relief is known. What else is known of every sample lies on its rows: the probability of a cell, the error of
        its depth, and who decided.
        """
        k = 0 if placed.both[0].relief is None else 1
        light, lit = placed.sides[k], placed.sides[k].valid & (placed.both[k].drawing is None)
        a = placed.both[0].panorama
        known: Mask = np.isfinite(self.relief_mm)
        return Panorama(
            grid=self.grid,
            intensity=np.where(lit, light.intensity, np.float32(1)),
            depth_mm=np.where(known, self.relief_mm, np.float32(0)),
            valid=known,
            weight=known.astype(np.float32),
            modality="wall",
            handedness_known=a.handedness_known,
            travel_known=a.travel_known,
            frame_dim="row",
            per_frame={
                "row_z_mm": PerFrame(self.grid.z_mm, "mm", "place of the row"),
                "cell_probability": PerFrame(self.probability, "1", "probability of a cell"),
                "relief_error_mm": PerFrame(self.error_mm, "mm", "standard error of depth"),
                "decided": PerFrame(self.decided, "", "0 nobody, 1 the side with light, 2 with depth, 3 both"),
            },
            provenance={"wall_of": [side.name for side in placed.sides]},
        )


def wall_from(sides: BothSides) -> Wall:
    """Return the wall by what both sides show of it."""
    probability, cells = cells_from(sides)
    relief_mm, error_mm = _relief(sides, cells)
    return Wall(sides.grid, probability, cells, relief_mm, error_mm, _decided(sides, cells))


def cells_from(sides: BothSides) -> tuple[Image, Mask]:
    """Return how probable a cell is, NaN where neither side observed the wall, and the cells."""
    light, depth = sides.cells[sides.light_side], sides.cells[sides.depth_side]
    saw_light, saw_depth = sides.observed[sides.light_side], sides.observed[sides.depth_side]
    probability = np.where(saw_light, light, depth).astype(np.float32)
    near, features = cell_features(sides)
    probability[near] = expit(answers("cell", features)[0])
    probability[~(saw_light | saw_depth)] = np.nan
    smallest_px = SMALLEST_MM2 / (sides.grid.dz_mm * sides.grid.dtheta_mm)
    return probability, remove_small(probability > 0.5, smallest_px)


def depth_features(sides: BothSides, cells: Mask) -> NDArray[np.float32]:
    """Return what tells the depth of ``cells``, float32 (16, n), for each of their samples; 0 where it is not known.

    Relief interpolated between measured rows; the distance to the cell's outline and to the nearest measured row;
    relief by parallax and the trust in it; the darkness; of the rows next to it, the nearer one first, relief, the
    share that is a cell, brightness; of the whole cell, the median and the ninth decile of what was measured, whether
    anything was, and the radius of a disc of its area.
    """
    features = np.empty((16, np.count_nonzero(cells)), np.float32)
    for feature, part in zip(features, chain(_of_samples(sides, cells), _of_whole(sides, cells)), strict=True):
        feature[:] = part
    return np.nan_to_num(features, copy=False)


def _of_samples(sides: BothSides, cells: Mask) -> Iterator[NDArray[np.floating]]:
    """Yield what is known of each sample of ``cells`` alone, twelve arrays (n,)."""
    rows, (row, column) = sides.rows, np.nonzero(cells)
    yield sides.relief_mm[cells]
    yield signed_distance(cells, (sides.grid.dz_mm, sides.grid.dtheta_mm), FARTHEST_MM)[cells]
    yield sides.from_row_mm[row]
    yield sides.parallax_mm[cells]
    yield TRUST_MM / (TRUST_MM + sides.parallax_error_mm[cells])
    yield sides.darkness[cells]
    for next_to in rows.neighbours(sides.grid.z_mm):
        yield from (image[next_to[row], column] for image in (rows.relief_mm, rows.cells, rows.brightness))


def _of_whole(sides: BothSides, cells: Mask) -> Iterator[NDArray[np.floating | np.bool_]]:
    """Yield what is known of the whole cell that each sample lies in, four arrays (n,)."""
    grid, rows, (labels, n) = sides.grid, sides.rows, label(cells)
    at, on_grid = labels[cells], np.clip(np.rint(grid.row_of(rows.z_mm)), 0, grid.n_z - 1).astype(np.intp)
    shown = rows.cells > LEAST_SHARE
    median_mm, high_mm = (quantiles(rows.relief_mm[shown], labels[on_grid][shown], n, share) for share in (0.5, 0.9))
    yield median_mm[at]
    yield high_mm[at]
    yield np.isfinite(median_mm)[at]
    yield np.minimum(np.sqrt(np.bincount(at, minlength=n + 1) * grid.dz_mm * grid.dtheta_mm / np.pi), WIDEST_MM)[at]


def known_depth(sides: BothSides) -> Image:
    """Return the relief that was measured, and by parallax where none was, float32, NaN where neither is known."""
    return np.asarray(np.where(np.isfinite(sides.relief_mm), sides.relief_mm, sides.parallax_mm))


def _relief(sides: BothSides, cells: Mask) -> tuple[Image, Image]:
    """Return relief and its standard error: of the plain wall as it was measured, of cells by all that tells of it."""
    plain = sides.observed[sides.depth_side] & ~cells
    relief_mm = np.where(plain, sides.relief_mm, np.float32(np.nan)).astype(np.float32)
    of_wall = relief_mm[plain]
    error_mm = np.where(plain, np.float32(robust_sigma(of_wall) if of_wall.size else np.nan), np.float32(np.nan))
    told = cells & np.isfinite(known_depth(sides))
    beyond_mm, log_error = answers("depth", depth_features(sides, told))
    relief_mm[told] = np.maximum(known_depth(sides)[told] + beyond_mm, SHALLOWEST_MM)
    error_mm[told] = np.clip(OF_SCALE * np.exp(log_error), *ERRORS_MM)
    return relief_mm, error_mm


def _decided(sides: BothSides, cells: Mask) -> NDArray[np.uint8]:
    light, depth = (cells == sides.cells[k] for k in (sides.light_side, sides.depth_side))
    saw_light, saw_depth = sides.observed[sides.light_side], sides.observed[sides.depth_side]
    decided = np.full(cells.shape, BY_BOTH, np.uint8)
    decided[saw_light & (~saw_depth | (light & ~depth))] = BY_LIGHT
    decided[saw_depth & (~saw_light | (depth & ~light))] = BY_DEPTH
    decided[~(saw_light | saw_depth)] = NOBODY
    return decided
