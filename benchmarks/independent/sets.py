"""Named sets of recipes: what each draws for a seed. Kinds alternate with the seed, so that any run has all of them."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.random import Generator

from benchmarks.independent.mirror import focal_px, wall_z_mm
from benchmarks.independent.recipe import (
    BoreRecipe,
    CatheterFault,
    CatheterRecipe,
    MirrorFault,
    MirrorRecipe,
    Recipe,
    Stated,
)

SETS = ("few", "usual", "many", "tiny", "mirrors", "sound", "broken", "dim", "curve", "sparse", "specks", "floors")
CATHETER_FAULTS: tuple[tuple[CatheterFault, float], ...] = (
    ("turn_step", 0.3),
    ("start_jump", 0.3),
    ("lost_slices", 4.0),
    ("swapped_slices", 5.0),
    ("pitch", 0.8),
    ("pitch", 1.25),
    ("pitch", 1.5),
    ("capillary", 1.05),
    ("capillary", 1.1),
    ("capillary", 0.53),
    ("upside_down", 0.0),
    ("no_catheter", 0.0),
)
MIRROR_FAULTS: tuple[MirrorFault, ...] = ("far_rim", "non_square", "saturated", "pipe_end")
CURVE: tuple[tuple[CatheterFault, tuple[float, ...]], ...] = (
    ("turn_step", (0.03, 0.06, 0.1, 0.15, 0.2)),
    ("start_jump", (0.03, 0.06, 0.1, 0.15, 0.2)),
    ("lost_slices", (1, 2, 3, 6, 8)),
    ("pitch", (1.02, 1.05, 1.08, 1.12, 1.2)),
    ("capillary", (1.01, 1.02, 1.03, 0.97, 0.95)),
)
"""From hardly a fault to a gross one: between ``sound`` and ``broken``."""
MIRROR_KINDS = ("telecentric", "usual", "wide", "near")
STATED: tuple[Stated, ...] = ("optics", "half_angle", "visible_length", "feed")


def recipe_of(name: str, seed: int) -> Recipe:
    """Return the recipe of a set for a seed."""
    rng = np.random.default_rng([seed, SETS.index(name), 77])
    if name == "few":
        return _pair(replace(_bore(rng), cells=4, size_mm=(0.6, 1.5)), rng)
    if name == "many":
        return _pair(replace(_bore(rng), cells=80, size_mm=(0.3, 0.8)), rng)
    if name == "tiny":
        return _pair(replace(_bore(rng), cells=30, size_mm=(0.2, 0.4), depth_mm=(0.2, 0.6)), rng)
    if name in ("sparse", "specks"):
        return _full_size(name, seed, rng)
    if name == "floors":
        return _pair(replace(_bore(rng), floor_brightness=(0.7, 1.15)), rng)
    bore = _bore(rng)
    if name == "sound":
        kinds: tuple[dict[str, Any], ...] = (
            {},
            {"cells": 4, "size_mm": (0.6, 1.5)},
            {"cells": 80, "size_mm": (0.3, 0.8)},
            {"floor_brightness": (0.5, 0.8)},
            {"texture": 0.05},
        )
        bore = replace(bore, **kinds[seed % 5])
    recipe = _pair(bore, rng)
    if name == "sound" and seed % 3 == 0:
        recipe = replace(recipe, oct=replace(recipe.oct, lines=(int(rng.integers(200, 300)),)))
    if name in ("mirrors", "sound"):
        kind, stated = MIRROR_KINDS[seed % 4], STATED[(seed // 4) % 4]
        endoscope = replace(_mirror(kind, rng), stated=stated)
        return replace(recipe, endoscope=replace(endoscope, ahead=seed % 3 > 0))
    if name == "dim":
        exposure = float(rng.uniform(0.05, 0.45))
        return replace(
            recipe, endoscope=replace(recipe.endoscope, exposure=exposure, ring=float(rng.uniform(0.2, 1.0)))
        )
    if name == "curve":
        fault, sizes = CURVE[seed % len(CURVE)]
        return replace(
            recipe, oct=replace(recipe.oct, fault=fault, fault_size=float(sizes[seed // len(CURVE) % len(sizes)]))
        )
    if name == "broken":
        kind_of = seed % (len(CATHETER_FAULTS) + len(MIRROR_FAULTS))
        if kind_of >= len(CATHETER_FAULTS):
            mirror_fault = MIRROR_FAULTS[kind_of - len(CATHETER_FAULTS)]
            aspect = 1.1 if mirror_fault == "non_square" else 1.0
            return replace(recipe, endoscope=replace(recipe.endoscope, fault=mirror_fault, aspect=aspect))
        fault, size = CATHETER_FAULTS[kind_of]
        return replace(recipe, oct=replace(recipe.oct, fault=fault, fault_size=size))
    return recipe


def _full_size(name: str, seed: int, rng: Generator) -> Recipe:
    """Return bare bores, of no to four cells or two to eleven tiny ones, well sampled by a catheter that lies still."""
    if name == "sparse":
        bore = replace(_bore(rng), cells=seed % 5, size_mm=(0.5, 1.4))
    else:
        bore = replace(_bore(rng), cells=2 + seed % 10, size_mm=(0.2, 0.4), depth_mm=(0.2, 0.6))
    recipe = _pair(bore, rng)
    room = recipe.oct.capillary_outer_mm / 2 - recipe.oct.glass_mm - recipe.oct.sheath_mm / 2
    still = replace(
        recipe.oct,
        slices=45,
        pitch_mm=0.2,
        a_scans=1000,
        depths=512,
        wander_mm=0.0,
        offset_mm=float(rng.uniform(0.1, 0.95)) * room,
    )
    return replace(recipe, oct=still)


def _bore(rng: Generator) -> BoreRecipe:
    return BoreRecipe(
        diameter_mm=float(rng.choice([2.2, 2.5, 2.8])),
        cells=int(rng.integers(10, 26)),
        texture=float(rng.uniform(0.08, 0.15)),
        floor_slope=float(rng.choice([0.0, 0.5])),
    )


def _pair(bore: BoreRecipe, rng: Generator) -> Recipe:
    """Return a catheter steadily off axis, or slowly wandering in one of four, and an endoscope with stated optics."""
    capillary = bore.diameter_mm - float(rng.uniform(0.6, 0.9))
    glass = float(rng.uniform(0.1, 0.2))
    sheath = float(rng.uniform(0.5, 0.62)) * (capillary - 2 * glass)
    room = capillary / 2 - glass - sheath / 2
    catheter = CatheterRecipe(
        capillary_outer_mm=round(capillary, 2),
        glass_mm=glass,
        sheath_mm=sheath,
        first_sample_mm=float(rng.uniform(0.5, 0.9)) * (sheath / 2 - 0.08),
        offset_mm=float(rng.uniform(0.15, 0.95)) * room,
        offset_rad=float(rng.uniform(0, 2 * np.pi)),
        wander_mm=float(rng.uniform(0.02, 0.06)) if rng.random() < 0.25 else 0.0,
        start_rad=float(rng.uniform(0, 2 * np.pi)),
        start_mm=float(rng.uniform(1.2, 2.5)),
        mirrored=bool(rng.random() < 0.5),
        states_handedness=bool(rng.random() < 0.5),
        travel="out" if rng.random() < 0.8 else "in",
        signal_db=float(rng.uniform(20, 30)),
        attenuation_per_mm=float(rng.uniform(2.5, 5)),
        linear=bool(rng.random() < 0.25),
    )
    return Recipe(bore, catheter, _mirror("usual", rng))


def _mirror(kind: str, rng: Generator) -> MirrorRecipe:
    """Return an endoscope whose view is neither too short nor too slanted to be one."""
    nearest, farthest = {"telecentric": (20, 40), "usual": (3, 7), "wide": (0.9, 1.6), "near": (1.6, 2.6)}[kind]
    for _ in range(1000):
        mirror = MirrorRecipe(
            half_angle_deg=float(rng.uniform(43, 47) if kind == "usual" else rng.uniform(36, 54)),
            distance_mm=float(rng.uniform(nearest, farthest)),
            mirror_radius_mm=float(rng.uniform(0.8, 1.0)),
            inner_share=float(rng.uniform(0.3, 0.5)),
            size_px=int(rng.integers(140, 195)) * 2,
            exposure=float(rng.uniform(0.5, 1.0)),
            light_around=float(rng.uniform(0.0, 0.3)),
            light_along=float(rng.uniform(0.0, 0.5)),
            ring=float(rng.uniform(0.0, 0.8)),
            overlap=float(rng.uniform(0.7, 0.8)),
            start_rad=float(rng.uniform(0, 2 * np.pi)),
            feed_factor=float(rng.normal(1, 0.005)),
        )
        mirror = replace(mirror, outer_px=round(0.44 * mirror.size_px, 1))
        rims = np.array([mirror.inner_share * mirror.outer_px, mirror.outer_px])
        z = wall_z_mm(mirror, 1.25, focal_px(mirror), rims)
        psi = np.arctan(rims / focal_px(mirror))
        leaves = np.rad2deg(2 * np.deg2rad(mirror.half_angle_deg) - psi)
        if 0.45 < z[1] - z[0] < 1.8 and leaves.min() > 52 and leaves.max() < 118:
            return mirror
    raise ValueError(f"no {kind} mirror could be drawn")
