"""The one wall that both sides of a comparison know: each sample's relief, whether it is a cell, and who decided."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.ranks import robust_sigma
from endoct.base.numeric.regions import Labels, label, quantiles, remove_small
from endoct.fusion.evidence.light_alone import (
    AROUND_MM,
    FARTHEST_MM,
    SHALLOWEST_MM,
    TRUST_MM,
    WIDEST_MM,
    mean_around,
)
from endoct.fusion.evidence.network import AT_ONCE, answers
from endoct.fusion.sides import Placed
from endoct.fusion.wall.both_sides import BothSides, cell_features
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame

NOBODY, BY_LIGHT, BY_DEPTH, BY_BOTH = range(4)
"""Who decided a sample: nobody saw it, one side alone was followed, or both say the same or were weighed."""
SMALLEST_MM2 = 0.01
"""Smaller cells are none, as on either side."""
LEAST_SHARE = 0.5
"""A sample on a measured row is a cell's by depth where a larger share of it is."""
ROW_MM = 0.03
"""Standard deviation of what counts around a sample on a measured row."""
ERRORS_MM = (0.005, 1.0)
"""No depth is known better or worse."""
OF_SCALE, DEEP_MM = (1.4, 2.6), (1.0, 1.4)
"""A standard error is so many scales of the Student's t, with 4 degrees of freedom, that the network learned: 1.14 in
theory, more in bores that it was not trained on, and most in cells so deep that OCT saw no floor."""


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


def depth_features(sides: BothSides, cells: Mask) -> Callable[[NDArray[np.intp]], NDArray[np.float32]]:
    """Return what tells the depth of ``cells``: a function of the flat indices (n,) of some of their samples.

    It returns float32 (24, n), 0 where something is not known. Relief interpolated between measured rows; the distance
    to the cell's outline and to the nearest measured row; relief by parallax and the trust in it; the darkness; the
    means of parallax and darkness around. Of the whole cell: the median and the ninth decile of what was measured,
    whether anything was, and the radius of a disc of its area. Of the rows next to it, the nearer one first: relief,
    the share that is a cell, brightness; around there on the row, the mean and the spread of relief, and the mean of
    brightness; 0 where none is near. A floor in range is smooth along its row; where none is, what was measured is a
    surface in the noise.
    """
    grid, rows, (labels, n) = sides.grid, sides.rows, label(cells)
    outline_mm = signed_distance(cells, (grid.dz_mm, grid.dtheta_mm), FARTHEST_MM)
    around = AROUND_MM / grid.dz_mm, AROUND_MM / grid.dtheta_mm
    by_light = [mean_around(of, cells & np.isfinite(of), around) for of in (sides.parallax_mm, sides.darkness)]
    of_cell = _of_whole_cells(sides, labels, n)
    known = (rows.cells > LEAST_SHARE) & np.isfinite(rows.relief_mm)
    mean_mm, square, bright = (
        mean_around(of, known, (0.0, ROW_MM / grid.dtheta_mm))
        for of in (rows.relief_mm, rows.relief_mm**2, rows.brightness)
    )
    spread_mm = np.sqrt(np.maximum(square - mean_mm**2, 0))
    of_rows = rows.relief_mm, rows.cells, rows.brightness, mean_mm, spread_mm, bright
    from_row_mm, next_to = np.minimum(sides.from_row_mm, FARTHEST_MM), rows.neighbours(grid.z_mm)

    def features_at(samples: NDArray[np.intp]) -> NDArray[np.float32]:
        row, column = np.divmod(samples, grid.n_theta)
        is_near = from_row_mm[row] < FARTHEST_MM
        features = [
            *(of.flat[samples] for of in (sides.relief_mm, outline_mm)),
            from_row_mm[row],
            sides.parallax_mm.flat[samples],
            TRUST_MM / (TRUST_MM + sides.parallax_error_mm.flat[samples]),
            *(of.flat[samples] for of in (sides.darkness, *by_light)),
            *(of[labels.flat[samples]] for of in of_cell),
            *(np.where(is_near, of[near[row], column], 0) for near in next_to for of in of_rows),
        ]
        return np.nan_to_num(np.array(features, np.float32), copy=False)

    return features_at


def _of_whole_cells(sides: BothSides, labels: Labels, n: int) -> Iterable[NDArray[np.floating | np.bool_]]:
    """Return what is known of each of ``n`` cells, four arrays (n + 1,)."""
    grid, rows = sides.grid, sides.rows
    on_grid = np.clip(np.rint(grid.row_of(rows.z_mm)), 0, grid.n_z - 1).astype(np.intp)
    is_on_grid = np.abs(grid.z_mm[on_grid] - rows.z_mm) < grid.dz_mm
    measured = (rows.cells > LEAST_SHARE) & is_on_grid[:, np.newaxis]
    median_mm, high_mm = (
        quantiles(rows.relief_mm[measured], labels[on_grid][measured], n, share) for share in (0.5, 0.9)
    )
    radius_mm = np.sqrt(np.bincount(labels.ravel(), minlength=n + 1) * grid.dz_mm * grid.dtheta_mm / np.pi)
    return median_mm, high_mm, np.isfinite(median_mm), np.minimum(radius_mm, WIDEST_MM)


def known_depth(sides: BothSides) -> Image:
    """Return the relief that was measured, and by parallax where none was, float32, NaN where neither is known."""
    return np.asarray(np.where(np.isfinite(sides.relief_mm), sides.relief_mm, sides.parallax_mm))


def _relief(sides: BothSides, cells: Mask) -> tuple[Image, Image]:
    """Return relief and its standard error: of the plain wall as it was measured, of cells by all that tells of it."""
    plain = sides.observed[sides.depth_side] & ~cells
    relief_mm = np.where(plain, sides.relief_mm, np.float32(np.nan)).astype(np.float32)
    of_wall = relief_mm[plain]
    error_mm = np.where(plain, np.float32(robust_sigma(of_wall) if of_wall.size else np.nan), np.float32(np.nan))
    depth_mm = known_depth(sides)
    told = cells & np.isfinite(depth_mm)
    features_at, samples = depth_features(sides, told), np.flatnonzero(told)
    for first in range(0, samples.size, AT_ONCE):
        some = samples[first : first + AT_ONCE]
        beyond_mm, log_error = answers("depth", features_at(some))
        relief_mm.flat[some] = np.maximum(depth_mm.flat[some] + beyond_mm, SHALLOWEST_MM)
        scales = np.interp(relief_mm.flat[some], DEEP_MM, OF_SCALE)
        error_mm.flat[some] = np.clip(scales * np.exp(log_error), *ERRORS_MM)
    rest = cells & ~told
    relief_mm[rest], error_mm[rest] = sides.light_mm[rest], sides.light_error_mm[rest]
    return relief_mm, error_mm


def _decided(sides: BothSides, cells: Mask) -> NDArray[np.uint8]:
    light, depth = (cells == sides.cells[k] for k in (sides.light_side, sides.depth_side))
    saw_light, saw_depth = sides.observed[sides.light_side], sides.observed[sides.depth_side]
    decided = np.full(cells.shape, BY_BOTH, np.uint8)
    decided[saw_light & (~saw_depth | (light & ~depth))] = BY_LIGHT
    decided[saw_depth & (~saw_light | (depth & ~light))] = BY_DEPTH
    decided[~(saw_light | saw_depth)] = NOBODY
    return decided
