"""What a task gives for nothing: ``nothing`` does nothing at all, ``constant`` gives one answer to every case.

A method that is not ahead of both has not solved the task.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from endoct.base.arrays import Image, Mask
from endoct.fusion.geometry.alignment import Alignment
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import Trajectory
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip
from endoct.workbench.bench.rivals.depth import TYPICAL_MM
from endoct.workbench.bench.tasks.depth import Views
from endoct.workbench.bench.tasks.oct import even
from endoct.workbench.bench.tasks.pose import Located, LocatedSide
from endoct.workbench.bench.tasks.stitching import StripPoses
from endoct.workbench.bench.tasks.wall import JoinedWall, ShownPair


def no_cells(panorama: Panorama) -> Mask:
    """Return that there is no cell anywhere."""
    return np.zeros(panorama.grid.shape, np.bool_)


def all_cells(panorama: Panorama) -> Mask:
    """Return that everything is a cell."""
    return np.ones(panorama.grid.shape, np.bool_)


def no_wall_cells(pair: ShownPair) -> JoinedWall:
    """Return a wall without a cell."""
    plain = np.zeros(pair.sides.grid.shape, np.float32)
    return JoinedWall(plain > 0, plain)


def all_wall_cells(pair: ShownPair) -> JoinedWall:
    """Return one cell everywhere, of one depth."""
    deep = np.full(pair.sides.grid.shape, TYPICAL_MM, np.float32)
    return JoinedWall(deep > 0, deep)


def in_place(a: Panorama, b: Panorama) -> Alignment:
    """Return B as it lies in A without being moved."""
    del a, b
    return Alignment(0.0, 0.0)


def middles(a: Panorama, b: Panorama) -> Alignment:
    """Return B with its middle on A's."""
    return Alignment(0.0, float(np.mean(a.z_mm[[0, -1]]) - np.mean(b.z_mm[[0, -1]])))


def unmoved(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """Return strips that all lie in one place."""
    return nominal(strips, 0 * nominal_pitch_mm)


def nominal(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """Return strips at the nominal pitch that never rolled."""
    n = len(strips)
    return StripPoses(nominal_pitch_mm * np.arange(n, dtype=np.float64), np.zeros(n), np.ones(n, np.bool_))


def flat_pullback(recording: Path) -> Panorama:
    """Return the rows of a pullback with a flat wall, but for one sample: a judge looks for cells."""
    unrolled = even(recording)
    flat = np.zeros(unrolled.grid.shape, np.float32)
    flat[0, 0] = TYPICAL_MM
    return replace(unrolled, depth_mm=flat, valid=np.ones_like(unrolled.valid))


def striped_pullback(recording: Path) -> Panorama:
    """Return the rows of a pullback with a cell along a fifth of every turn."""
    flat = flat_pullback(recording)
    n_theta = flat.grid.n_theta
    striped = np.where(np.arange(n_theta) < n_theta / 5, np.float32(TYPICAL_MM), np.float32(0))
    return replace(flat, depth_mm=np.broadcast_to(striped, flat.grid.shape).copy())


def typical_depth(views: Views) -> Image:
    """Return one depth everywhere, between those of the wall and of cells."""
    return np.full(views.panorama.grid.shape, TYPICAL_MM / 10, np.float32)


def as_planned(sides: tuple[Panorama, ...], ct: CtVolume, plan: Trajectory) -> Located:
    """Return the bore where it was planned, its last row at the plan's end."""
    return _along_plan(sides, ct, plan, 0.0)


def half_a_millimetre_short(sides: tuple[Panorama, ...], ct: CtVolume, plan: Trajectory) -> Located:
    """Return the same, ending half a millimetre before the plan does."""
    return _along_plan(sides, ct, plan, 0.5)


def _along_plan(sides: tuple[Panorama, ...], ct: CtVolume, plan: Trajectory, short_mm: float) -> Located:
    del ct
    entry, target = np.asarray(plan.entry_mm), np.asarray(plan.target_mm)
    inward = (target - entry) / np.linalg.norm(target - entry)
    across = np.cross(inward, np.eye(3)[int(np.argmin(np.abs(inward)))])
    end = target - short_mm * inward
    places = [
        LocatedSide(np.array([end - float(one.z_mm[-1] - one.z_mm[0]) * inward, end]), across / np.linalg.norm(across))
        for one in sides
    ]
    return Located(tuple(places))
