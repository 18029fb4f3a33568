"""Runs the estimators on rendered recordings and puts what they find next to what the truth records."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.physics import catheter, probe
from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import render_frame
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.oct.bscan import render_bscan
from endoct.synthetic.oct.sweep import build_appearance
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PresetName
from endoct.synthetic.sample.ranges import Range
from endoct.synthetic.truth import recording

# enough of a rotation error, and enough of cells, to tell one from the other
TURNING: Mapping[str, Range] = {
    "oct.rotation_error_peak_rad": (0.08, 0.08),
    "oct.scan": ("step",),
    "oct.wall_db": (20.0, 22.0),
    "bore.bone": ("phantom",),
    "bore.cell_fraction": (0.27, 0.27),
}
# a smooth, round bore that shows nothing but paint, which no light and no depth can shift
PAINTED: Mapping[str, Range] = {
    "bore.bone": ("phantom",),
    "bore.texture": (0.3, 0.3),
    **{
        f"bore.{name}": (0.0, 0.0)
        for name in ("cell_fraction", "taper_mm", "wander_mm", "roughness_mm", "drill_mark_depth_mm")
    },
    "endoscope.gloss": (0.0, 0.0),
}
N_ANGLES = 4096


@dataclass(frozen=True, eq=False)
class Slice:
    """What was found in one B-scan and what is true.

    ``offset_mm``: of the catheter off the capillary's axis, as x + iy in the bore frame; ``deeper_mm``: by how much
    the outer face lies too deep; ``wall_px``: by how many rows the wall does. ``error_rad`` and ``tells``: error of
    every A-scan's angle against an even turn, and whether the wall there tells it. ``at_z``: how much the brightness
    steps up along the wall that the truth has at each of ``Z_SHIFTS_MM`` from where the slice is said to be.
    """

    offset_mm: complex
    true_offset_mm: complex
    deeper_mm: float
    wall_px: float
    error_rad: Coordinates
    true_error_rad: Coordinates
    tells: NDArray[np.bool_]
    at_z: Coordinates


Z_SHIFTS_MM = np.arange(-0.2, 0.201, 0.02)


def specimen(preset: PresetName, seed: int, ranges: Mapping[str, Range]) -> tuple[Sample, Wall]:
    """Return a sample and its wall."""
    sample = draw(preset, seed, ranges=ranges)
    return sample, build_wall(sample)


def slices(sample: Sample, wall: Wall, indices: Sequence[int]) -> list[Slice]:
    """Render some slices and measure them; a stepped scan."""
    truths = json.loads(json.dumps(recording(sample)))
    truth, rig = truths["oct"], catheter.Rig.of(truths, json.loads(sample.model_dump_json()))
    look = build_appearance(sample, wall)
    found = []
    for i in indices:
        bscan = render_bscan(sample, wall, look, i)
        n = bscan.shape[1]
        alpha = catheter.beam_rad(truth, i, n)
        offset, deeper, _ = catheter.find_catheter(bscan, rig, alpha)
        true_offset = truth["offset_mm"][i] * np.exp(1j * truth["offset_direction_rad"][i])
        axis, place = catheter.catheter_in_bore(truth, i, truth["z_mm"][i], sample.bore.length_mm)
        fine = 2 * np.pi * np.arange(N_ANGLES) / N_ANGLES
        rows = catheter.wall_row(rig, _relief(wall, truth["z_mm"][i]), axis, place, fine)
        even = 2 * np.pi * np.arange(n) / n
        turn = catheter.turn_rad(truth, i, n)
        error = catheter.find_turning(rig, bscan, rows, truth["theta_origin_rad"] + truth["theta_sense"] * even)
        step = catheter.step_up(catheter.without_lines(bscan))
        steps = []
        for shift in Z_SHIFTS_MM:
            there = catheter.wall_row(
                rig, _relief(wall, truth["z_mm"][i] + shift), axis, place, alpha[:: max(1, n // 256)]
            )
            seen = np.isfinite(there) & (there < bscan.shape[0] - 12)
            ascans = np.arange(0, n, max(1, n // 256))[seen]
            steps.append(float(step[np.rint(there[seen]).astype(int), ascans].sum()) / there.size)
        of_beams = rows[np.rint(alpha / (2 * np.pi) * N_ANGLES).astype(int) % N_ANGLES]
        found.append(
            Slice(
                offset_mm=offset,
                true_offset_mm=complex(true_offset),
                deeper_mm=deeper,
                wall_px=catheter.shift_of_depth_px(rig, bscan, of_beams),
                error_rad=error,
                true_error_rad=truth["theta_sense"] * (turn - even + catheter.rotation_error_rad(truth, i, turn)),
                tells=catheter.tells_angle(rows, alpha),
                at_z=np.array(steps),
            )
        )
    return found


def _relief(wall: Wall, z_mm: float) -> NDArray[np.float32]:
    row = z_mm / wall.dz_mm
    low = int(row)
    part = np.float32(row - low)
    return np.asarray((1 - part) * wall.relief_mm[low] + part * wall.relief_mm[low + 1])


@dataclass(frozen=True, eq=False)
class Frames:
    """What was found in a run of endoscope frames and what is true; (n − 1,) between neighbours, or (n,).

    ``feed_mm``, ``roll_rad``: from frame to frame; ``z_error_mm``, ``roll_error_rad``: of every frame against the true
    wall's cells or, where it has none, its paint; ``rim_px``: how far x, y and radius of the outer rim lie off, (n, 3).
    """

    feed_mm: Coordinates
    true_feed_mm: Coordinates
    roll_rad: Coordinates
    true_roll_rad: Coordinates
    z_error_mm: Coordinates
    roll_error_rad: Coordinates
    rim_px: Coordinates


def frames(sample: Sample, wall: Wall, indices: Sequence[int]) -> Frames:
    """Render neighbouring frames and measure them."""
    truths = json.loads(json.dumps(recording(sample)))
    truth, optics, radius = (
        truths["endoscope"],
        json.loads(sample.model_dump_json())["endoscope"],
        truths["bore_radius_mm"],
    )
    lighting = lighting_of(sample, wall)
    images = [render_frame(sample, wall, lighting, i) for i in indices]
    strips = probe.evened(
        [
            probe.strip(image, truth["centre_px"][i], optics, radius, truth["apex_to_band_centre_mm"])
            for i, image in zip(indices, images, strict=True)
        ]
    )
    between = np.array([probe.shift_between(a, b, 0.6)[:2] for a, b in pairwise(strips)])
    z, roll = np.array(truth["z_mm"])[list(indices)], np.array(truth["roll_rad"])[list(indices)]
    reach, half = 40, len(strips[0]) // 2
    brightness = -wall.cell.astype(np.float32) if wall.cell.any() else np.log(wall.albedo)
    against = []
    for strip, z0, turned in zip(strips, z, roll, strict=True):
        places = z0 + probe.DZ_MM * np.arange(-half - reach, half + reach + 1)
        dz, dtheta, _ = probe.shift_between(probe.wall_strip(brightness, wall.dz_mm, places), strip, 0)
        against.append((dz - reach * probe.DZ_MM, float(np.angle(np.exp(1j * (dtheta - turned))))))
    return Frames(
        feed_mm=between[:, 0],
        true_feed_mm=np.diff(z),
        roll_rad=between[:, 1],
        true_roll_rad=np.angle(np.exp(1j * np.diff(roll))),
        z_error_mm=np.array(against)[:, 0],
        roll_error_rad=np.array(against)[:, 1],
        rim_px=np.array(
            [
                probe.rim(image, truth["centre_px"][i], truth["outer_px"])
                for i, image in zip(indices, images, strict=True)
            ]
        ),
    )
