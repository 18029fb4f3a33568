"""Bores whose cells are all of one size, for sweeps over it: the simulator draws sizes from 0.2 to 1.5 mm at once."""

import math

from numpy.random import Generator

from endoct.synthetic.bone.drawn_cells import draw_holes
from endoct.synthetic.bone.opening import CutWall
from endoct.synthetic.sample.parameters import Bore, Cell

LEAST_MM = 0.2
DEPTHS_MM = (0.05, 1.5)
DEEPEST = 1.1
"""Depth over opening; this and the depths are those between which the phantom's holes are drawn."""
TRIES = 20
"""For each cell that would be needed if none met another."""


def uniform_cells(rng: Generator, bore: Bore, opening_mm: float) -> tuple[Cell, ...]:
    """Return drilled holes ``opening_mm`` across that cut away the share of the wall that the ``bore`` wants.

    Holes as the phantom has them, brought to that size, each with the depth that one of that size could have, and
    laid anywhere. Raises :class:`EndoctError` where there is no room for so many.
    """
    wall, holes = CutWall(bore), [_brought_to(hole, opening_mm) for hole in draw_holes(rng, bore)]
    needed = bore.cell_fraction * math.pi * bore.diameter_mm * bore.length_mm / (math.pi / 4 * opening_mm**2)
    for _ in range(TRIES * math.ceil(needed)):
        if wall.enough:
            break
        place = {"z_mm": float(rng.uniform(0, bore.length_mm)), "theta_rad": float(rng.uniform(0, 2 * math.pi))}
        wall.take(holes[int(rng.integers(len(holes)))].model_copy(update=place))
    return wall.all_taken()


def _brought_to(hole: Cell, opening_mm: float) -> Cell:
    slant = math.sqrt(math.cos(hole.lean_rad))  # a leaning hole's opening is an ellipse
    share = math.log(hole.depth_mm / DEPTHS_MM[0]) / math.log(_deepest_mm(hole.diameter_mm / slant) / DEPTHS_MM[0])
    depth_mm = DEPTHS_MM[0] * (_deepest_mm(opening_mm) / DEPTHS_MM[0]) ** min(1.0, share)
    fill_mm = min(depth_mm, hole.fill_mm * depth_mm / hole.depth_mm)
    diameter_mm = max(LEAST_MM, opening_mm * slant)
    return hole.model_copy(update={"diameter_mm": diameter_mm, "depth_mm": depth_mm, "fill_mm": fill_mm})


def _deepest_mm(opening_mm: float) -> float:
    return min(DEPTHS_MM[1], DEEPEST * opening_mm)
