"""One drilled cell in a plain bore: its light as traced photons have it, and as a rendered frame does.

Both are maps of irradiance about the cell over z and the arc R·θ, rows and columns ``BIN_MM`` apart; 1 is the
irradiance of the plain wall by a source in the pinhole, at normal incidence, in the middle of the annulus. Of the cell
only its floor is shown.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.light.paths import FLOOR, SIDE, Bone, Ring, followed
from benchmarks.physics.mirror import GAMMA, closed_form, endoscope
from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.endoscope.camera import noise_free, pixel_maps
from endoct.synthetic.endoscope.cone import cone_of
from endoct.synthetic.endoscope.irradiance import MIRROR_BEYOND
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.sample.parameters import Cell, Sample

BIN_MM = 0.03
HALF_Z_MM, HALF_ARC_MM = 0.48, 0.75
FLAT = 0.8  # of the cell's half width, within which its floor is flat in the simulator, too
THETA_RAD = 2.0
PHOTONS_AT_ONCE = 500_000


@dataclass(frozen=True, eq=False)
class Maps:
    """Irradiance (z, arc), direct and of all light, NaN where it is not known, and which of it is on the floor."""

    direct: Coordinates
    all: Coordinates
    floor: NDArray[np.bool_]


def bore(
    depth_mm: float, width_mm: float = 0.6, albedo: float = 0.6, at_mm: float = 0.0, **camera: Any
) -> tuple[Sample, Wall]:
    """Return a clean, grey endoscope in a plain bore with one shaft, ``at_mm`` from the middle of the visible band."""
    optics = {"mirror_distance_mm": 1.5, "visible_length_mm": 0.85, "inner_px": 45.0, "outer_px": 210.0}
    sample, _ = endoscope(
        45.0, preset="quick", fibre_ring_mm=0.2, bone_albedo=albedo, exposure=1.0, saturated=0.0, **optics | camera
    )
    if not depth_mm:
        return sample, build_wall(sample)
    cell = Cell(
        z_mm=sample.endoscope.z_mm[0] + at_mm, theta_rad=THETA_RAD, diameter_mm=width_mm, depth_mm=depth_mm, bulge_mm=0,
        aspect=1, tilt_rad=0, lean_rad=0, lean_direction_rad=0, squareness=12, outline=(), edge_mm=0.005, lining=1,
        rim_gain=0, filling="air", fill_mm=depth_mm,
    )  # fmt: skip
    sample = sample.model_copy(update={"bore": sample.bore.model_copy(update={"cells": (cell,)})})
    return sample, build_wall(sample)


def rendered(sample: Sample, wall: Wall) -> Maps:
    """Return the mean of the pixels of a rendered frame that fall into each bin."""
    dark = sample.endoscope.model_copy(update={"bone_albedo": 0.0})
    maps = pixel_maps(sample, wall, 0)
    seen = maps.valid & ~maps.obscured
    z = maps.z_mm[seen].astype(np.float64) - _middle(sample)
    theta = np.angle(np.exp(1j * (maps.theta_rad[seen].astype(np.float64) - THETA_RAD)))
    radius = wall.radius_mm + maps.depth_mm[seen].astype(np.float64)
    bone = _bone(sample)
    x, y = radius * np.cos(theta), radius * np.sin(theta)
    in_cell = np.hypot(y, z) < bone.width_mm / 2
    floor = (np.abs(x - bone.floor_mm) < 0.02) & (np.hypot(y, z) < FLAT * bone.width_mm / 2) & (bone.depth_mm > 0)
    plain = (np.abs(radius - bone.radius_mm) < 0.005) & ~in_cell
    irradiance = [_linear(one, wall)[seen] for one in (sample.model_copy(update={"endoscope": dark}), sample)]
    return _binned(z, bone.radius_mm * theta, floor, floor | plain, irradiance)


def traced(sample: Sample, photons: int, seed: int = 0) -> Maps:
    """Return where photons arrive, counted."""
    bone, source, rng = _bone(sample), ring(sample), np.random.default_rng(seed)
    shape = _shape()
    counts = np.zeros((2, 2, *shape))  # direct and bounced, wall and floor
    for _ in range(0, photons, PHOTONS_AT_ONCE):
        for met, weight, bounces in followed(bone, source, PHOTONS_AT_ONCE, rng, sample.endoscope.bone_albedo):
            theta = np.arctan2(met.place[:, 1], met.place[:, 0])
            row, column, inside = _bin(met.place[:, 2], bone.radius_mm * theta)
            inside &= met.kind != SIDE
            is_floor = (met.kind == FLOOR).astype(int)
            np.add.at(counts, (min(bounces, 1), is_floor[inside], row[inside], column[inside]), weight[inside])
    z, arc = _centres()
    theta = arc / bone.radius_mm
    y = bone.floor_mm * np.tan(theta)
    floor = (np.hypot(y, z[:, None]) < FLAT * bone.width_mm / 2) & (bone.depth_mm > 0)
    plain = np.hypot(bone.radius_mm * np.sin(theta), z[:, None]) > bone.width_mm / 2 + BIN_MM
    area = np.where(floor, BIN_MM * np.gradient(y), BIN_MM**2)
    emitted = source.solid_angle_density(-(-photons // PHOTONS_AT_ONCE) * PHOTONS_AT_ONCE)
    irradiance = np.where(floor, counts[:, 1], counts[:, 0]) / area / emitted / _reference(sample)
    irradiance[:, ~(floor | plain)] = np.nan
    return Maps(irradiance[0], irradiance.sum(axis=0), floor)


def rendered_over_traced(first: Maps, second: Maps, floor: bool) -> tuple[float, float]:
    """Return by how much two maps differ over the floor or the wall, direct light and all light, as a ratio."""
    ratios = []
    for one, two in ((first.direct, second.direct), (first.all, second.all)):
        both = np.isfinite(one) & np.isfinite(two) & (first.floor == floor) & (second.floor == floor)
        ratios.append(float(one[both].sum() / two[both].sum()))
    return ratios[0], ratios[1]


def ring(sample: Sample) -> Ring:
    """Return the source of a sample's endoscope, its cell at z = 0."""
    camera = sample.endoscope
    outermost = float(cone_of(camera).rays(np.array([camera.outer_px])).rho_mm[0])
    return Ring(
        apex_mm=_apex(sample) - _middle(sample),
        distance_mm=camera.mirror_distance_mm,
        half_angle_rad=math.radians(camera.half_angle_deg),
        ring_mm=camera.fibre_ring_mm,
        mirror_mm=MIRROR_BEYOND * outermost,
    )


def _apex(sample: Sample) -> float:
    """Return z of the apex: the visible band of the plain wall has its middle where the frame's z is."""
    rims = closed_form(sample, np.array([sample.endoscope.inner_px, sample.endoscope.outer_px]))[0]
    return float(sample.endoscope.z_mm[0] - rims.mean())


def _middle(sample: Sample) -> float:
    cells = sample.bore.cells
    return cells[0].z_mm if cells else sample.endoscope.z_mm[0]


def _bone(sample: Sample) -> Bone:
    cells = sample.bore.cells
    size = {"width_mm": cells[0].diameter_mm, "depth_mm": cells[0].depth_mm} if cells else {}
    return Bone(radius_mm=sample.bore.diameter_mm / 2, **size)


def _reference(sample: Sample) -> float:
    """Return sin ψ/(L·R) in the middle of the annulus, L by way of the unfolded mirror."""
    camera, radius = sample.endoscope, sample.bore.diameter_mm / 2
    z, m = closed_form(sample, np.array([(camera.inner_px + camera.outer_px) / 2]))
    a, d = math.radians(camera.half_angle_deg), camera.mirror_distance_mm
    psi = 2 * a - math.atan(1 / float(m[0]))
    path = math.hypot(radius + d * math.sin(2 * a), float(z[0]) + d * math.cos(2 * a))
    return math.sin(psi) / (path * radius)


def _linear(sample: Sample, wall: Wall) -> Coordinates:
    """Return the irradiance in a frame: its light, less that of one in the dark, over the gain."""
    lighting = lighting_of(sample, wall)
    lit, unlit = (
        (noise_free(sample, wall, one, 0) / 255.0) ** GAMMA for one in (lighting, replace(lighting, gain=0.0))
    )
    return np.asarray((lit - unlit) / lighting.gain)


def _shape() -> tuple[int, int]:
    return round(2 * HALF_Z_MM / BIN_MM), round(2 * HALF_ARC_MM / BIN_MM)


def _centres() -> tuple[Coordinates, Coordinates]:
    rows, columns = _shape()
    return (np.arange(rows) + 0.5) * BIN_MM - HALF_Z_MM, (np.arange(columns) + 0.5) * BIN_MM - HALF_ARC_MM


def _bin(z: Coordinates, arc: Coordinates) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    row, column = np.floor((z + HALF_Z_MM) / BIN_MM).astype(int), np.floor((arc + HALF_ARC_MM) / BIN_MM).astype(int)
    rows, columns = _shape()
    return row, column, (row >= 0) & (row < rows) & (column >= 0) & (column < columns)


def _binned(
    z: Coordinates, arc: Coordinates, floor: NDArray[np.bool_], known: NDArray[np.bool_], values: list[Coordinates]
) -> Maps:
    row, column, inside = _bin(z, arc)
    inside &= known
    size = math.prod(_shape())
    place = (row * _shape()[1] + column)[inside]
    count = np.bincount(place, minlength=size).astype(float)
    count[count < 3] = np.nan
    direct, all_, of_floor = (
        (np.bincount(place, one[inside], minlength=size) / count).reshape(_shape())
        for one in (*values, floor.astype(float))
    )
    mixed = (of_floor > 0) & (of_floor < 1)
    return Maps(np.where(mixed, np.nan, direct), np.where(mixed, np.nan, all_), of_floor == 1)
