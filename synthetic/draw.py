"""Draws the parameters of a specimen. Nothing random happens elsewhere but noise and texture."""

from typing import Any

import numpy as np
from annotated_types import Ge, Le
from numpy.random import Generator
from pydantic import BaseModel

from endoct.stitching.arrays import Coordinates
from endoct.synthetic.cells import pit_mm, reach_mm
from endoct.synthetic.cone import wall_z_mm
from endoct.synthetic.parameters import Bore, Cell, Endoscope, Oct, Sample, Travel
from endoct.synthetic.presets import PRESETS, Preset, PresetName
from endoct.synthetic.randomness import Stage, generator

MARGIN_MM = 0.9
SHEATH_TO_GLASS_MM = 0.005
OFFSET_RANGE_MM = (0.06, 0.30)
MOST_CELL_FRACTION = 0.295


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


def _bounds(model: type[BaseModel], name: str) -> tuple[float, float] | None:
    field = model.model_fields[name]
    low = [m.ge for m in field.metadata if isinstance(m, Ge)]
    high = [m.le for m in field.metadata if isinstance(m, Le)]
    return (float(low[0]), float(high[0])) if field.annotation is float and low and high else None  # type: ignore[arg-type]


def _uniform(rng: Generator, model: type[BaseModel], name: str) -> float:
    bounds = _bounds(model, name)
    if bounds is None:
        raise ValueError(f"{model.__name__}.{name} has no range")
    return float(rng.uniform(*bounds))


def _ranged(rng: Generator, model: type[BaseModel]) -> dict[str, Any]:
    """Draw every field of ``model`` that has a range, uniformly within it."""
    return {name: _uniform(rng, model, name) for name in model.model_fields if _bounds(model, name)}


def _drift(rng: Generator, n: int) -> Coordinates:
    """Return a smooth random course of n steps within [−1, 1], about one and a half periods long."""
    t = np.linspace(0, 1, n)
    course: Coordinates = np.zeros(n)
    for k in (0.5, 1.0, 1.5, 2.5):
        course += rng.normal() / k * np.cos(2 * np.pi * (k * t + rng.uniform()))
    return course / max(1e-9, float(np.abs(course).max()))


def _listed(values: Coordinates) -> tuple[float, ...]:
    return tuple(values.tolist())


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
    harmonics = np.arange(2, 8)
    amplitude = np.clip(0.16 * rng.normal(size=harmonics.size) / np.sqrt(harmonics), -0.2, 0.2)
    amplitude *= min(1.0, 0.5 / float(np.abs(amplitude).sum()))
    return Cell(
        **_ranged(rng, Cell)
        | {
            "z_mm": float(rng.uniform(0, length_mm)),
            "diameter_mm": diameter,
            "depth_mm": float(np.exp(rng.uniform(np.log(0.05), np.log(min(1.5, 1.1 * diameter))))),
            "rim_gain": float(rng.uniform(0.2, 0.8)) if rng.random() < 0.2 else 0.0,
        },
        outline_amplitude=_listed(amplitude),
        outline_phase_rad=_listed(rng.uniform(0, 2 * np.pi, harmonics.size)),
    )


def _oct(rng: Generator, size: Preset, z_mm: Coordinates, length_mm: float) -> Oct:
    n = size.n_slices
    low, high = OFFSET_RANGE_MM
    middle = rng.uniform(low + 0.03, high - 0.03)
    offset = middle + min(middle - low, high - middle, rng.uniform(0.02, 0.06)) * _drift(rng, n)
    direction = rng.uniform(0, 2 * np.pi) + rng.uniform(0.2, 1.2) * _drift(rng, n)

    drawn = _ranged(rng, Oct)
    sheath = np.array([0.12, 0.29, 0.355, 0.42]) + rng.uniform(-0.02, 0.02, 4)
    room = drawn["capillary_outer_diameter_mm"] / 2 - offset.max() - sheath[-1] - SHEATH_TO_GLASS_MM
    drawn["glass_mm"] = float(rng.uniform(0.10, np.clip(room, 0.10, 0.30)))
    sheath = sheath[int(rng.random() < 0.5) :]

    # the pattern of a bent, rubbing catheter repeats from turn to turn and changes slowly
    harmonics = np.arange(1, 5)
    shape = rng.normal(size=(2, 4)) / harmonics
    courses = np.stack([[_drift(rng, n) for _ in harmonics] for _ in range(2)]) / harmonics[:, None]
    error = shape[:, :, None] + 0.35 * courses + 0.06 * rng.normal(size=(2, 4, n)) / harmonics[:, None]
    x = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    waves = np.cos(np.outer(harmonics, x)), np.sin(np.outer(harmonics, x))
    peak = np.abs(error[0].T @ waves[0] + error[1].T @ waves[1]).max()
    error *= np.deg2rad(rng.uniform(0.5, 2.5)) / peak

    travel: Travel = "out" if rng.random() < 0.75 else "in"
    order = slice(None, None, -1) if travel == "out" else slice(None)
    dirt = [
        (
            float(rng.uniform(0, length_mm)),
            float(rng.uniform(0, 2 * np.pi)),
            float(rng.uniform(0.1, 0.5)),
            float(np.deg2rad(rng.uniform(0.7, 3))),
            float(rng.uniform(5, 18)),
        )
        for _ in range(rng.poisson(0.5 * length_mm))
    ]
    return Oct(
        **drawn,
        sheath_radius_mm=_listed(sheath),
        sheath_wobble_mm=_listed(rng.uniform(3, 5, sheath.size) * drawn["axial_pixel_mm"]),
        sheath_phase_rad=_listed(rng.uniform(0, 2 * np.pi, sheath.size)),
        sheath_db=_listed(rng.uniform(22, 38, sheath.size)),
        shadows=tuple(dirt),
        n_glints=int(rng.poisson(6 * length_mm)),
        travel=travel,
        sense=1 if rng.random() < 0.5 else -1,
        z_mm=_listed(z_mm[order]),
        offset_mm=_listed(np.clip(offset, low, high)),
        offset_direction_rad=_listed(np.mod(direction, 2 * np.pi)),
        start_angle_rad=_listed(np.deg2rad(0.3) * rng.normal(size=n)),
        rotation_error_cos_rad=tuple(_listed(e) for e in error[0].T),
        rotation_error_sin_rad=tuple(_listed(e) for e in error[1].T),
        states_first_sample=bool(rng.random() < 0.2),
        stated_travel=travel if rng.random() < 0.7 else "unknown",
        states_handedness=bool(rng.random() < 0.5),
    )


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
    dirt = [
        (
            float(r * np.cos(a)),
            float(r * np.sin(a)),
            float(rng.uniform(1.5, 5)),
            float(rng.uniform(0.2, 0.8)),
        )
        for r, a in zip(rng.uniform(inner, outer, 25), rng.uniform(0, 2 * np.pi, 25), strict=True)
    ]
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
        dirt=tuple(dirt[: int(rng.integers(8, 26))]),
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
