"""Where the pixels of a cone-mirror endoscope look and how much light they get, against closed forms.

The wall is a plain cylinder. What is measured is what the renderer says of every pixel, and rendered frames.
"""

import math
from typing import Any

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import noise_free, pixel_maps
from endoct.synthetic.endoscope.cone import band_centre_mm, focal_length_px
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS, PresetName

APEX_MM = 2.0
GAMMA = 1.8  # of the display, undone


def endoscope(half_angle_deg: float = 45.0, preset: PresetName = "learning", **camera: Any) -> tuple[Sample, Wall]:
    """Return a clean, grey endoscope with its apex 2 mm within a plain cylinder; ``camera`` as wanted.

    Its source is in the pinhole, and the wall throws no light on.
    """
    drawn = draw(preset, 1000, ranges={"bore.cell_fraction": (0.0, 0.0), "bore.bone": ("phantom",)})
    bore = {
        "cells": (), "taper_mm": 0.0, "tilt_rad": 0.0, "wander_mm": 0.0, "roughness_mm": 0.0,
        "drill_mark_depth_mm": 0.0, "texture": 0.0, "smear": 0.0, "diameter_mm": 2.5,
    }  # fmt: skip
    n = PRESETS[drawn.preset].n_frames
    optics = {
        "half_angle_deg": half_angle_deg, "visible_length_mm": 1.0, "mirror_distance_mm": 4.0, "distortion": 0.02,
        "inner_px": 100.0, "outer_px": 205.0,
    }  # fmt: skip
    clean = {
        "width_px": 640, "height_px": 480, "colour": False, "inner_shift_px": (0.0, 0.0), "defocus_px": 0.0,
        "defocus_slope_px": 0.0, "exposure": 0.8, "saturated": 0.0, "fibre_ring_mm": 0.0, "bone_albedo": 0.0,
        "bright_side": 0.0, "vignetting": 0.0, "gloss": 0.0,
        "ring_gain": 0.0, "dirt": (), "droplets": (), "debris": (), "roll_rad": (0.0,) * n, "probe_tilt_rad": 0.0,
        "centre_px": ((321.3, 238.6),) * n, "offset_mm": ((0.0, 0.0),) * n,
    }  # fmt: skip
    optics |= {name: value for name, value in camera.items() if name in optics}
    clean["focal_px"] = focal_length_px(optics, optics["inner_px"], optics["outer_px"], 1.25)
    sample = drawn.model_copy(
        update={
            "bore": drawn.bore.model_copy(update=bore),
            "endoscope": drawn.endoscope.model_copy(update=optics | clean | camera),
        }
    )
    z_mm = APEX_MM + band_centre_mm(sample.endoscope, 1.25)
    placed = sample.endoscope.model_copy(update={"z_mm": (z_mm,) * n})
    sample = sample.model_copy(update={"endoscope": placed})
    return sample, build_wall(sample)


def _pixels(sample: Sample, wall: Wall) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return radius and angle in the image, and z from the apex, of all pixels that see the wall."""
    seen = pixel_maps(sample, wall, 0)
    row, column = np.nonzero(seen.valid)
    cx, cy = sample.endoscope.centre_px[0]
    z = seen.z_mm[row, column].astype(np.float64) - APEX_MM
    return np.hypot(column - cx, row - cy), np.arctan2(row - cy, column - cx), z


def _undistorted(sample: Sample, r_px: Coordinates) -> Coordinates:
    """Return tan ψ of radii in the image, from a table of r = f·t·(1 + k1·t²)."""
    camera = sample.endoscope
    t = np.linspace(0, 1.2 * camera.outer_px / camera.focal_px, 40001)
    return np.asarray(np.interp(r_px, camera.focal_px * (t + camera.distortion_k1 * t**3), t))


def closed_form(sample: Sample, r_px: Coordinates) -> tuple[Coordinates, Coordinates]:
    """Return z(r) = −d·cos 2a + (R + d·sin 2a)·cot(2a − ψ) from the apex in mm, and cot(2a − ψ)."""
    camera = sample.endoscope
    a, d, radius = math.radians(camera.half_angle_deg), camera.mirror_distance_mm, sample.bore.diameter_mm / 2
    m = 1 / np.tan(2 * a - np.arctan(_undistorted(sample, r_px)))
    return -d * math.cos(2 * a) + (radius + d * math.sin(2 * a)) * m, m


def z_of_r(half_angle_deg: float) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return radius (px), z (mm from the apex) of every 37th pixel, and z of the closed form."""
    sample, wall = endoscope(half_angle_deg)
    r, _, z = _pixels(sample, wall)
    order = np.argsort(r)[::37]
    return r[order], z[order], closed_form(sample, r[order])[0]


def ring_centres(
    half_angle_deg: float, offset_mm: float = 0.02, tilt_rad: float = 0.004
) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return radius (px) of rings of one z, and how far their centres lie from the image's, found and expected, in mm.

    Bore's axis off the probe's by ``offset_mm`` and tilted by ``tilt_rad`` towards θ = 0; px are turned into mm with
    dz/dr: −[m(e + τz₀) + τR].
    """
    sample, wall = endoscope(half_angle_deg)
    n = PRESETS[sample.preset].n_frames
    moved = {"offset_mm": ((-offset_mm, 0.0),) * n, "probe_tilt_rad": tilt_rad, "probe_tilt_direction_rad": math.pi}
    sample = sample.model_copy(update={"endoscope": sample.endoscope.model_copy(update=moved)})
    r, angle, z = _pixels(sample, wall)
    rings = np.arange(110.0, 200.0, 10)
    level, m = closed_form(sample, rings)
    mm_per_px = closed_form(sample, rings + 0.5)[0] - closed_form(sample, rings - 0.5)[0]
    found = []
    for ring, z0, scale in zip(rings, level, mm_per_px, strict=True):
        near = np.abs(r - ring) < 4
        of_ring = r[near] + (z0 - z[near]) / scale
        design = np.stack([np.ones(of_ring.size), np.cos(angle[near]), np.sin(angle[near])], axis=1)
        found.append(np.linalg.lstsq(design, of_ring, rcond=None)[0][1] * scale)
    expected = -(m * (offset_mm + tilt_rad * level) + tilt_rad * sample.bore.diameter_mm / 2)
    return rings, np.array(found), expected


def _linear(sample: Sample, wall: Wall) -> Coordinates:
    """Return the light of a frame, less that of one in the dark."""
    dark = sample.model_copy(update={"endoscope": sample.endoscope.model_copy(update={"exposure": 0.0})})
    lit, unlit = ((noise_free(one, wall, lighting_of(one, wall), 0) / 255.0) ** GAMMA for one in (sample, dark))
    return np.asarray(lit - unlit)


def light_along(half_angle_deg: float) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return z from the apex (mm), mean light of rings of pixels, and that of rays counted where they arrive.

    Rays leave the pinhole evenly over solid angle, so sin ψ dψ of them fall on R dz of the wall: neither a cosine nor
    an inverse square is put in. Both are scaled to one in the middle of the annulus.
    """
    sample, wall = endoscope(half_angle_deg)
    image = _linear(sample, wall)
    cx, cy = sample.endoscope.centre_px[0]
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    r = np.hypot(x - cx, y - cy)
    rings = np.arange(104.0, 202.0, 4.0)
    found = np.array([image[np.abs(r - ring) < 1].mean() for ring in rings])
    density = _arriving(sample, rings)
    middle = _arriving(sample, np.array([152.5]))
    scale = np.interp(152.5, rings, found)
    return closed_form(sample, rings)[0], found / scale, density / middle


def _arriving(sample: Sample, r_px: Coordinates) -> Coordinates:
    step = 1e-3
    psi = [np.arctan(_undistorted(sample, r_px + k * step)) for k in (-1, 0, 1)]
    z = [closed_form(sample, r_px + k * step)[0] for k in (-1, 1)]
    return np.asarray(np.sin(psi[1]) * (psi[2] - psi[0]) / (z[1] - z[0]))


def light_around(offset_mm: float = 0.15) -> tuple[Coordinates, Coordinates, Coordinates]:
    """Return θ (rad), light of one ring seen by a probe off the axis, and rays counted where they arrive, mean 1.

    The wall is met at ρ(θ) from the probe's axis and leans against the ray by i: the light goes as cos i/ρ/L, and
    rays spread over the area between neighbours of four on the wall say so without any of these.
    """
    sample, wall = endoscope(45.0)
    n = PRESETS[sample.preset].n_frames
    moved = {"offset_mm": ((offset_mm, 0.0),) * n}
    sample = sample.model_copy(update={"endoscope": sample.endoscope.model_copy(update=moved)})
    image = _linear(sample, wall)
    cx, cy = sample.endoscope.centre_px[0]
    theta = 2 * np.pi * (np.arange(36) + 0.5) / 36
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    r, angle = np.hypot(x - cx, y - cy), np.mod(np.arctan2(y - cy, x - cx), 2 * np.pi)
    near = np.abs(r - 152.5) < 3
    sector = (angle[near] / (2 * np.pi) * 36).astype(int)
    found = np.bincount(sector, image[near]) / np.bincount(sector)
    a, d, radius = math.radians(45.0), sample.endoscope.mirror_distance_mm, sample.bore.diameter_mm / 2
    h = 1e-4

    def arrives(turn: Coordinates, r_px: float) -> Coordinates:
        psi = math.atan(float(_undistorted(sample, np.array([r_px]))[0]))
        z = d * math.tan(psi) / (math.tan(a) - math.tan(psi))
        rho = z * math.tan(a)
        start = offset_mm + rho * np.exp(1j * turn)
        beam = np.exp(1j * turn)
        along = (start * beam.conj()).real
        way = np.sqrt(radius**2 - np.abs(start) ** 2 + along**2) - along
        place = start + way * beam
        return np.stack([place.real, place.imag, z + way / math.tan(2 * a - psi)], axis=-1)

    around = (arrives(theta + h, 152.5) - arrives(theta - h, 152.5)) / (2 * h)
    along = (arrives(theta, 152.5 + 0.01) - arrives(theta, 152.5 - 0.01)) / 0.02
    density = 1 / np.linalg.norm(np.cross(around, along), axis=-1)
    return theta, found / found.mean(), density / density.mean()
