"""A bore in such bone, recorded by the second generator under a lamp that lights the far rims of cells; a pose case."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.random import Generator
from scipy import ndimage

from benchmarks.independent.bore import STEP_MM, Bore, Cell, Floats, drill
from benchmarks.independent.catheter import pull_back
from benchmarks.independent.mirror import travel
from benchmarks.independent.pair import Pair, write_pair
from benchmarks.independent.recipe import Recipe
from benchmarks.independent.sets import recipe_of
from benchmarks.second_origin.bone import (
    DEEPEST_MM,
    WALL_MM,
    Bone,
    drilled_line,
    frame,
    made_of_ellipsoids,
    segmented,
    wall_places,
)
from benchmarks.second_origin.scanner import scanned
from endoct.modalities.ct.ct_volume import CtVolume
from endoct.modalities.ct.trajectory import Trajectory
from endoct.stitching.panorama import Panorama
from endoct.workbench import unroll
from endoct.workbench.bench.cases.bores import PoseCase, TrueBore, plan_off
from endoct.workbench.pipeline.truth import TruePose

FIRST_MM, LAST_MM = 1.0, 1.0
"""Of the bore at either end, that no recording shows."""
MARCH_MM = 0.03
DARK_MM = 0.8
"""Depth at which a floor has the brightness that is drawn for it."""
LIT = 0.8
"""How many times as bright as plain wall a face of 45° towards the lamp is, less one."""
REAL_VOXEL_MM = 0.192


@dataclass(frozen=True, eq=False)
class BoneBore:
    """A bone, where it was drilled (4, 4), its CT, the plan, and what two instruments recorded."""

    name: str
    bone: Bone
    to_lps: Floats
    length_mm: float
    ct: CtVolume
    plan: Trajectory
    pair: Pair

    def case(self, folder: Path) -> PoseCase:
        """Return the case for the bench, OCT first; recordings are written below ``folder``, which must not exist."""
        write_pair(self.pair, folder)
        panoramas = tuple(unroll(folder / side, progress=False) for side in ("oct", "endoscope"))
        truth = TrueBore(self.to_lps, self.length_mm, (self._oct(panoramas[0]), self._endoscope(panoramas[1])))
        return PoseCase(self.name, (panoramas, self.ct, self.plan), truth, {})

    def _oct(self, panorama: Panorama) -> TruePose:
        place, true = self.pair.oct_place, np.sort(self.pair.oct.z_mm)
        return TruePose(place.theta_rad, -1 if place.mirrored else 1, _frames_mm(panorama), true)

    def _endoscope(self, panorama: Panorama) -> TruePose:
        place, journey = self.pair.endoscope_place, self.pair.endoscope
        true = np.sort(journey.apex_mm + place.z_mm - journey.apex_mm.min())
        return TruePose(place.theta_rad, 1, _frames_mm(panorama), true)


def made(seed: int, *, sparse: bool) -> BoneBore:
    """Return a bore in bone of ellipsoids."""
    rng = np.random.default_rng([seed, 41])
    length_mm = float(rng.uniform(20, 24))
    to_lps = frame(np.full(3, 22.5), rng)
    to_lps[:3, 3] -= length_mm / 2 * to_lps[:3, 2]
    bone = made_of_ellipsoids(rng, to_lps, length_mm, sparse=sparse)
    return _recorded(f"{'sparse' if sparse else 'made'}-{seed}", seed, bone, to_lps, length_mm, rng)


def real(folder: Path, seed: int) -> BoneBore:
    """Return a bore in the real bone whose slices are in ``folder``."""
    rng = np.random.default_rng([seed, 42])
    bone, length_mm = segmented(folder, REAL_VOXEL_MM), float(rng.uniform(20, 24))
    return _recorded(f"{folder.name}-{seed}", seed, bone, drilled_line(bone, rng, length_mm), length_mm, rng)


def _recorded(name: str, seed: int, bone: Bone, to_lps: Floats, length_mm: float, rng: Generator) -> BoneBore:
    drawn = recipe_of("usual", seed)
    seen_mm = length_mm - FIRST_MM - LAST_MM
    wall = replace(drawn.bore, length_mm=length_mm, cells=0)
    catheter = replace(drawn.oct, slices=int(seen_mm / 0.2), pitch_mm=0.2, start_mm=FIRST_MM)
    mirror = replace(drawn.endoscope, length_mm=seen_mm, start_mm=FIRST_MM)
    recipe = Recipe(wall, catheter, mirror)
    bore = _bored(recipe, bone, to_lps, rng)
    # what the lamp lights are faces towards it; the OCT has no lamp
    lit = replace(bore, albedo=_lit(bore, 1.0 if mirror.ahead else -1.0))
    pair = Pair(recipe, bore, pull_back(bore, catheter, rng), travel(lit, mirror, rng))
    ct = scanned(bone, to_lps, length_mm, float(rng.uniform(30, 150)), rng)
    return BoneBore(name, bone, to_lps, length_mm, ct, plan_off(to_lps, length_mm, 1.0, 2.0, rng), pair)


def _bored(recipe: Recipe, bone: Bone, to_lps: Floats, rng: Generator) -> Bore:
    """Return the wall: the bare one of the second generator, with the cells that the bone has there."""
    bare = drill(recipe.bore, rng)
    radius, length = recipe.bore.diameter_mm / 2, recipe.bore.length_mm
    places = wall_places(to_lps, length, radius, WALL_MM)
    outward = places - (to_lps[:3, 3] + (np.arange(len(places)) * WALL_MM)[:, None, None] * to_lps[:3, 2])
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    first = bone.share(places)
    depth, going = np.zeros(first.shape, np.float32), first > 0.5
    for behind in np.arange(MARCH_MM, DEEPEST_MM, MARCH_MM):
        if not going.any():
            break
        going[going] = bone.share(places[going] + behind * outward[going]) > 0.5
        depth[going] = behind + MARCH_MM / 2
    level = _finer(2 * (1 - first), bare.level.shape)  # 1 where the share of air is a half
    cells, n_cells = ndimage.label(np.concatenate([first, first], axis=1) > 0.5)
    relief = np.where(level < 1, _finer(depth, bare.level.shape), bare.relief_mm)
    number = _finer(cells[:, : first.shape[1]].astype(np.float32), bare.level.shape, nearest=True)
    floors = tuple(
        Cell(0, 0, 1, (0.0,) * 6, (0.0,) * 6, DARK_MM, (0, 0), 6,
             float(rng.uniform(0.15, 0.45)))
        for _ in range(n_cells + 1)
    )  # fmt: skip
    return replace(bare, cells=floors, level=level, relief_mm=relief.astype(np.float32), number=number.astype(np.int32))


def _lit(bore: Bore, lamp: float) -> Floats:
    """Return the wall's brightness under a lamp that shines along the bore, towards +z where ``lamp`` is 1."""
    relief = ndimage.gaussian_filter(bore.relief_mm, 0.04 / STEP_MM, mode=("nearest", "wrap"))
    facing = np.maximum(-lamp * np.gradient(relief, STEP_MM, axis=0), 0)
    return np.asarray(bore.albedo * (1 + LIT * np.minimum(facing, 1) * (bore.level < 1)), dtype=np.float32)


def _finer(values: Floats, shape: tuple[int, ...], *, nearest: bool = False) -> Floats:
    """Return a map (n_z, n_theta) of the wall on the grid of the second generator."""
    rows = np.arange(shape[0]) * STEP_MM / WALL_MM
    columns = np.arange(shape[1]) * (values.shape[1] / shape[1])
    at = np.meshgrid(rows, columns, indexing="ij")
    found = ndimage.map_coordinates(values, at, order=0 if nearest else 1, mode="grid-wrap")
    return np.asarray(found, dtype=np.float32)


def _frames_mm(panorama: Panorama) -> Floats:
    return np.sort(panorama.per_frame[f"{panorama.frame_dim}_z_mm"].values)
