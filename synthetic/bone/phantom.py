"""The drilled phantom: holes of several diameters and directions drilled across the bore into bone substitute."""

import math
from typing import Any

import numpy as np
from numpy.random import Generator

from endoct.synthetic.bone.opening import CutWall, drawn_contents, drawn_outline
from endoct.synthetic.sample.parameters import Bore, Cell

TRIES = 20  # for each mm² to be cut away, and at least ten times as many
MOST_LEAN_RAD = 0.6


def draw_holes(rng: Generator, bore: Bore) -> tuple[Cell, ...]:
    """Draw holes until the wanted part of the wall is cut away.

    Raises :class:`EndoctError` where it cannot be, after a bounded number of tries.
    """
    wall = CutWall(bore)
    wanted_mm2 = bore.cell_fraction * math.pi * bore.diameter_mm * bore.length_mm
    for _ in range(10 * TRIES + math.ceil(TRIES * wanted_mm2)):
        if wall.enough:
            break
        wall.take(_hole(rng, bore))
    return wall.all_taken()


def _hole(rng: Generator, bore: Bore) -> Cell:
    opening = float(np.exp(rng.uniform(np.log(0.2), np.log(1.5))))
    depth = float(np.exp(rng.uniform(np.log(0.05), np.log(min(1.5, 1.1 * opening)))))
    # a shallow hole that leans more would leave the wall on one side
    lean = rng.uniform(0, min(MOST_LEAN_RAD, math.atan(1.2 * depth / opening)))
    contents: dict[str, Any] = drawn_contents(rng, bore, depth)
    return Cell(
        z_mm=float(rng.uniform(0, bore.length_mm)),
        theta_rad=float(rng.uniform(0, 2 * np.pi)),
        diameter_mm=max(0.2, opening * math.sqrt(math.cos(lean))),
        depth_mm=depth,
        bulge_mm=0.0,
        aspect=float(rng.uniform(0.85, 1)),
        tilt_rad=float(rng.uniform(0, np.pi)),
        lean_rad=lean,
        lean_direction_rad=float(rng.uniform(0, 2 * np.pi)),
        squareness=float(rng.uniform(5, 12)),
        outline=drawn_outline(rng, 0.08, 6),
        **contents,
    )
