"""Draws the parameters of a specimen. Nothing random happens elsewhere but noise and texture."""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.random import Generator
from pydantic import BaseModel

from endoct.stitching.arrays import Coordinates
from endoct.synthetic.cells import pit_mm, reach_mm
from endoct.synthetic.cone import wall_z_mm
from endoct.synthetic.parameters import Bore, Cell, Endoscope, Harmonic, Oct, Sample, Shadow, SheathLine, Speck, Travel
from endoct.synthetic.presets import PRESETS, Preset, PresetName
from endoct.synthetic.randomness import Stage, generator

MARGIN_MM = 0.9
OFFSET_RANGE_MM = (0.06, 0.30)
MOST_CELL_FRACTION = 0.295
MOST_OUTLINE = 0.5


def draw(preset: PresetName, seed: int) -> Sample:
    """Return the sample of ``seed``; presets differ in size, not in difficulty."""
    size = PRESETS[preset]
    rng = generator(seed, Stage.DRAW)
    visible_mm = _uniform(rng, Endoscope, "visible_length_mm")
    oct_z, frame_z, length_mm = _positions(rng, size, visible_mm)
    bore = _bore(rng, length_mm)
    return Sample(
        preset=preset,
        seed=seed,
        bore=bore,
        oct=_oct(rng, size, oct_z, length_mm),
        endoscope=_endoscope(rng, frame_z, visible_mm, bore.diameter_mm / 2),
    )


@cache
def _ranges(model: type[BaseModel]) -> dict[str, tuple[float, float]]:
    """Return the range of every number in ``model`` that has one."""
    fields = model.model_json_schema()["properties"].items()
    return {name: (float(field["minimum"]), float(field["maximum"])) for name, field in fields if "maximum" in field}


def _uniform(rng: Generator, model: type[BaseModel], name: str) -> float:
    return float(rng.uniform(*_ranges(model)[name]))


def _ranged(rng: Generator, model: type[BaseModel]) -> dict[str, Any]:
    """Draw every number of ``model`` that has a range, uniformly within it."""
    return {name: _uniform(rng, model, name) for name in _ranges(model)}


def _drift(rng: Generator, n: int) -> Coordinates:
    """Return a smooth random course of n steps within [−1, 1], about one and a half periods long."""
    t = np.linspace(0, 1, n)
    course: Coordinates = np.zeros(n)
    for k in (0.5, 1.0, 1.5, 2.5):
        course += rng.normal() / k * np.cos(2 * np.pi * (k * t + rng.uniform()))
    return course / max(1e-9, float(np.abs(course).max()))


def _listed(values: Coordinates) -> tuple[float, ...]:
    return tuple(values.tolist())


def _harmonics(values: Coordinates) -> tuple[Harmonic, ...]:
    return tuple((float(cos), float(sin)) for cos, sin in values)


def _positions(rng: Generator, size: Preset, visible_mm: float) -> tuple[Coordinates, Coordinates, float]:
    """Return z of slices and of frames, ascending, so that 60–100 % of the shorter is in both; and the length."""
    oct_z = size.pitch_mm * np.arange(size.n_slices) + 0.004 * rng.normal(size=size.n_slices)
    oct_z = np.sort(oct_z - oct_z.min())
    feed = size.pitch_mm * (1 + 0.1 * np.clip(rng.normal(size=size.n_frames - 1), -2.5, 2.5))
    frame_z = np.concatenate([[0.0], np.cumsum(feed)])
    oct_span, frame_span = float(oct_z[-1]), float(frame_z[-1]) + visible_mm
    shared = rng.uniform(0.6, 1.0) * min(oct_span, frame_span)
    start = oct_span - shared if rng.random() < 0.5 else shared - frame_span
    frame_z += start + visible_mm / 2
    mouth = min(0.0, start) - MARGIN_MM - rng.uniform(0, 0.5)
    end = max(oct_span, start + frame_span) + MARGIN_MM
    return oct_z - mouth, frame_z - mouth, float(end - mouth)


def _bore(rng: Generator, length_mm: float) -> Bore:
    drawn = _ranged(rng, Bore)
    bore = Bore(**drawn | {"diameter_mm": round(drawn["diameter_mm"], 2)}, length_mm=length_mm)
    return bore.model_copy(update={"cells": _cells(rng, bore)})


def _cells(rng: Generator, bore: Bore) -> tuple[Cell, ...]:
    """Draw cells until the wanted part of the wall is cut away; one that would exceed 0.295 is drawn anew."""
    radius_mm = bore.diameter_mm / 2
    z_mm = np.arange(0, bore.length_mm, 0.02)[:, None]
    theta_rad = np.linspace(0, 2 * np.pi, 512, endpoint=False)[None, :]
    cut = np.zeros((z_mm.size, theta_rad.size), np.bool_)
    cells: list[Cell] = []
    while cut.mean() < bore.cell_fraction:
        cell = _cell(rng, bore.length_mm)
        near = np.abs(z_mm[:, 0] - cell.z_mm) <= reach_mm(cell)
        more = cut.copy()
        more[near] |= pit_mm(cell, z_mm[near], theta_rad, radius_mm) > 0
        if more.mean() <= MOST_CELL_FRACTION:
            cut = more
            cells.append(cell)
    return tuple(cells)


def _cell(rng: Generator, length_mm: float) -> Cell:
    diameter = float(np.exp(rng.uniform(np.log(0.2), np.log(1.5))))
    orders = np.arange(2, 8)
    outline = 0.3 * rng.normal(size=(orders.size, 2)) / orders[:, None] / math.sqrt(2)
    outline *= min(1.0, MOST_OUTLINE / float(np.hypot(*outline.T).sum()))
    return Cell(
        **_ranged(rng, Cell)
        | {
            "z_mm": float(rng.uniform(0, length_mm)),
            "diameter_mm": diameter,
            "depth_mm": float(np.exp(rng.uniform(np.log(0.05), np.log(min(1.5, 1.1 * diameter))))),
            "rim_gain": float(rng.uniform(0.2, 0.8)) if rng.random() < 0.2 else 0.0,
        },
        outline=_harmonics(outline),
    )


def _oct(rng: Generator, size: Preset, z_mm: Coordinates, length_mm: float) -> Oct:
    n = size.n_slices
    drawn = _ranged(rng, Oct)
    sheath = _sheath(rng, drawn["axial_pixel_mm"])

    # the catheter leaves room for the capillary's wall, and that wall takes what room there is
    low, high = OFFSET_RANGE_MM
    room = drawn["capillary_outer_diameter_mm"] / 2 - sheath[-1].radius_mm
    thin, thick = _ranges(Oct)["glass_mm"]
    high = min(high, room - thin)
    middle = rng.uniform(low + 0.03, high - 0.03)
    offset = middle + min(middle - low, high - middle, rng.uniform(0.02, 0.06)) * _drift(rng, n)
    offset = np.clip(offset, low, high)
    direction = rng.uniform(0, 2 * np.pi) + rng.uniform(0.2, 1.2) * _drift(rng, n)
    drawn["glass_mm"] = float(rng.uniform(thin, np.clip(room - offset.max(), thin, thick)))

    travel: Travel = "out" if rng.random() < 0.75 else "in"
    order = slice(None, None, -1) if travel == "out" else slice(None)
    shadows = (_ranged(rng, Shadow) for _ in range(rng.poisson(0.5 * length_mm)))
    return Oct(
        **drawn,
        sheath=sheath,
        shadows=tuple(Shadow(**s, z_mm=float(rng.uniform(0, length_mm))) for s in shadows),
        n_glints=int(rng.poisson(6 * length_mm)),
        travel=travel,
        sense=1 if rng.random() < 0.5 else -1,
        z_mm=_listed(z_mm[order]),
        offset_mm=_listed(offset),
        offset_direction_rad=_listed(np.mod(direction, 2 * np.pi)),
        start_angle_rad=_listed(np.deg2rad(0.3) * rng.normal(size=n)),
        rotation_error_rad=_rotation_error(rng, n),
        states_first_sample=bool(rng.random() < 0.2),
        stated_travel=travel if rng.random() < 0.7 else "unknown",
        states_handedness=bool(rng.random() < 0.5),
    )


def _sheath(rng: Generator, axial_pixel_mm: float) -> tuple[SheathLine, ...]:
    radii = np.array([0.12, 0.29, 0.355, 0.42]) + rng.uniform(-0.02, 0.02, 4)
    return tuple(
        SheathLine(
            radius_mm=float(radius),
            wobble_mm=float(rng.uniform(3, 5)) * axial_pixel_mm,
            phase_rad=float(rng.uniform(0, 2 * np.pi)),
            level_db=_uniform(rng, SheathLine, "level_db"),
        )
        for radius in radii[int(rng.random() < 0.5) :]
    )


def _rotation_error(rng: Generator, n: int) -> tuple[tuple[Harmonic, ...], ...]:
    """Return the harmonics of every slice's error: the pattern of a bent, rubbing catheter changes slowly."""
    orders = np.arange(1, 5)
    pattern = rng.normal(size=(orders.size, 2))
    courses = np.stack([_drift(rng, n) for _ in range(2 * orders.size)], axis=1).reshape(n, orders.size, 2)
    error = (pattern + 0.35 * courses + 0.06 * rng.normal(size=courses.shape)) / orders[:, None]
    turn = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    waves = np.stack([np.cos(np.outer(orders, turn)), np.sin(np.outer(orders, turn))], axis=1)
    peak = float(np.abs(np.einsum("nkc,kct->nt", error, waves)).max())
    error *= np.deg2rad(rng.uniform(0.5, 2.5)) / peak
    return tuple(_harmonics(of_slice) for of_slice in error)


def _endoscope(rng: Generator, z_mm: Coordinates, visible_mm: float, radius_mm: float) -> Endoscope:
    n = z_mm.size
    drawn = _ranged(rng, Endoscope) | {"visible_length_mm": visible_mm}
    width, height = ((640, 480), (800, 600))[int(rng.random() < 0.4)]
    outer = float(rng.uniform(0.42, 0.46)) * height
    inner = float(rng.uniform(0.42, 0.56)) * outer
    wander = np.stack([_drift(rng, n), _drift(rng, n)], axis=1) * rng.uniform(1, 5) + 0.3 * rng.normal(size=(n, 2))
    centre = np.array([width / 2, height / 2]) + rng.uniform(-0.015, 0.015, 2) * height + wander
    roll = rng.uniform(0, 2 * np.pi) + np.deg2rad(rng.uniform(1, 8) * _drift(rng, n) + 0.7 * rng.normal(size=n))
    probe = 0.02 * np.stack([_drift(rng, n), _drift(rng, n)], axis=1) + rng.uniform(-0.03, 0.03, 2)
    travel: Travel = "in" if rng.random() < 0.75 else "out"
    order = slice(None, None, -1) if travel == "out" else slice(None)
    specks = []
    for _ in range(int(rng.integers(8, 26))):
        r, angle = rng.uniform(inner, outer), rng.uniform(0, 2 * np.pi)
        specks.append(Speck(**_ranged(rng, Speck), x_px=float(r * np.cos(angle)), y_px=float(r * np.sin(angle))))
    return Endoscope(
        **drawn,
        width_px=width,
        height_px=height,
        colour=bool(rng.random() < 0.65),
        focal_px=_focal_px(drawn, inner, outer, radius_mm),
        inner_px=inner,
        outer_px=outer,
        inner_shift_px=(float(rng.normal() * 0.008 * outer), float(rng.normal() * 0.008 * outer)),
        ring_px=float(rng.uniform(inner + 8, outer - 8)),
        dirt=tuple(specks),
        travel=travel,
        z_mm=_listed(z_mm[order]),
        roll_rad=_listed(np.mod(roll, 2 * np.pi)),
        centre_px=tuple((float(x), float(y)) for x, y in centre),
        offset_mm=tuple((float(x), float(y)) for x, y in probe),
        states_optics=bool(rng.random() < 0.5),
        states_annulus=bool(rng.random() < 0.25),
        stated_travel=travel if rng.random() < 0.7 else "unknown",
    )


def _focal_px(optics: dict[str, Any], inner_px: float, outer_px: float, radius_mm: float) -> float:
    """Return the focal length with which the annulus spans the visible length on the nominal wall."""
    length, d, a = optics["visible_length_mm"], optics["mirror_distance_mm"], np.deg2rad(optics["half_angle_deg"])
    focal = (radius_mm + d) * (outer_px - inner_px) / length
    for _ in range(30):  # the span is very nearly inversely proportional to the focal length
        z = wall_z_mm(np.array([inner_px, outer_px]), focal, d, a, radius_mm)
        focal *= float(z[1] - z[0]) / length
    return float(focal)
