"""Bores without any unevenness and with chosen cells, whose surfaces can be worked out by hand."""

from functools import cache

from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Cell, Sample

EVEN = {
    "taper_mm": 0.0,
    "wander_mm": 0.0,
    "roughness_mm": 0.0,
    "drill_mark_depth_mm": 0.0,
    "diameter_mm": 2.5,
    "length_mm": 5.0,
}


def bone(*cells: Cell, **bore: object) -> Sample:
    """Return a ``learning`` sample whose bore is a cylinder of 1.25 mm, 5 mm long, with those cells."""
    sample = _any()
    chosen: dict[str, object] = {**EVEN, "cells": cells, **bore}
    return sample.model_copy(update={"bore": sample.bore.model_copy(update=chosen)})


@cache
def _any() -> Sample:
    return draw("learning", 0, ranges={"bore.bone": ("phantom",)})


def hole(**given: object) -> Cell:
    """Return a straight round hole, 0.6 mm across and deep, at z = 3 mm and θ = 1, but for what is ``given``."""
    usual: dict[str, object] = {
        "z_mm": 3.0,
        "theta_rad": 1.0,
        "diameter_mm": 0.6,
        "depth_mm": 0.6,
        "bulge_mm": 0.0,
        "aspect": 1.0,
        "tilt_rad": 0.0,
        "lean_rad": 0.0,
        "lean_direction_rad": 0.0,
        "squareness": 12.0,
        "outline": (),
        "edge_mm": 0.005,
        "lining": 0.8,
        "rim_gain": 0.0,
        "filling": "air",
        "fill_mm": 0.6,
    }
    return Cell.model_validate({**usual, **given})
