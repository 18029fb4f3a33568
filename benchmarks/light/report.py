"""The light in a drilled cell: figures of the physics report, with the tracer's beside the renderer's."""

import math
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.light.cell import HALF_ARC_MM, HALF_Z_MM, Maps, bore, rendered, rendered_over_traced, traced
from benchmarks.light.paths import FLOOR, WALL, Bone, Outwards, followed
from benchmarks.physics.drawing import save
from benchmarks.physics.plots import Line
from endoct.base.arrays import Coordinates
from tests import tolerances as within

DEPTHS_MM = 0.15, 0.5, 1.2
DIRECT_PHOTONS, PHOTONS = 8_000_000, 3_000_000
ALBEDO = 0.6
# what another tracer, whose source is not recorded, gave for a cell 0.6 mm wide: floor over wall, direct and all light
ANOTHER = {0.15: (0.76, 0.87), 0.5: (0.43, 0.53), 1.2: (0.20, 0.26)}
ANOTHERS_BOUNCES = {"wall": 0.38, "cells": 0.68}  # over direct light
NEUTRAL = Outwards(ring_mm=0.35, reach_mm=0.75)


def cells(folder: Path) -> Iterator[Line]:
    """The light of cells of three depths, traced and rendered."""
    pairs = []
    for depth in DEPTHS_MM:
        sample, wall = bore(depth, albedo=ALBEDO)
        direct_only = sample.model_copy(update={"endoscope": sample.endoscope.model_copy(update={"bone_albedo": 0.0})})
        ours, direct, all_ = rendered(sample, wall), traced(direct_only, DIRECT_PHOTONS), traced(sample, PHOTONS)
        theirs = Maps(direct.direct, all_.all, all_.floor)
        pairs.append((depth, ours, theirs))
        for place, floor in (("wall", False), ("floor", True)):
            of_direct, of_all = rendered_over_traced(ours, theirs, floor)
            name = f"cell {depth:g} mm deep: {place}, rendered over traced"
            yield Line(f"{name}, direct light", of_direct, 1.0, within.DIRECT_LIGHT_REL)
            yield Line(f"{name}, all light", of_all, 1.0, within.ALL_LIGHT_REL)
    _pictures(folder / "light_in_cells.png", pairs)
    bounces = []
    for depth in DEPTHS_MM:
        floor_light, wall_light = floor_and_wall(Bone(depth_mm=depth), NEUTRAL, PHOTONS // 2)
        of_direct, of_all = floor_light[0] / wall_light[0], floor_light.sum() / wall_light.sum()
        bounces.append((wall_light[1] / wall_light[0], floor_light[1] / floor_light[0]))
        for name, found, other in zip(("direct", "all"), (of_direct, of_all), ANOTHER[depth], strict=True):
            yield Line(f"traced, no mirror, {depth:g} mm deep: floor over wall, {name} light", found, other, 0.07)
    for name, found in zip(("wall", "cells"), np.mean(bounces, axis=0), strict=True):
        yield Line(f"traced, no mirror: bounced over direct light, {name}", float(found), ANOTHERS_BOUNCES[name], 0.07)


def floor_and_wall(bone: Bone, source: Outwards, photons: int) -> tuple[Coordinates, Coordinates]:
    """Return direct and bounced light a unit of area: of the cell's floor, and of the wall far from it around."""
    rng, half, away = np.random.default_rng(0), bone.width_mm / 2, math.pi / 3
    floor, wall = np.zeros(2), np.zeros(2)
    for _ in range(0, photons, 500_000):
        for met, weight, bounces in followed(bone, source, 500_000, rng, ALBEDO):
            beside = (np.abs(met.place[:, 2]) < half) & (met.place[:, 0] < bone.radius_mm * math.cos(away))
            floor[min(bounces, 1)] += weight[met.kind == FLOOR].sum()
            wall[min(bounces, 1)] += weight[(met.kind == WALL) & beside].sum()
    return floor / (math.pi * half**2), wall / (2 * half * bone.radius_mm * 2 * (math.pi - away))


def _pictures(path: Path, pairs: list[tuple[float, Maps, Maps]]) -> None:
    figure, axes = plt.subplots(len(pairs), 4, figsize=(12.5, 2.35 * len(pairs)), sharex=True, sharey=True)
    extent = (-HALF_ARC_MM, HALF_ARC_MM, -HALF_Z_MM, HALF_Z_MM)
    for row, (depth, ours, theirs) in zip(axes, pairs, strict=True):
        shown = (
            ("traced, direct", theirs.direct),
            ("rendered, direct", ours.direct),
            ("traced, all", theirs.all),
            ("rendered, all", ours.all),
        )
        for axis, (title, image) in zip(row, shown, strict=True):
            axis.set_facecolor("#5577aa")
            axis.imshow(image, cmap="gray", vmin=0, vmax=1.7, extent=extent, origin="lower", interpolation="nearest")
            if depth == pairs[0][0]:
                axis.set_title(title, fontsize=11)
        row[0].set_ylabel(f"{depth:g} mm deep\nz (mm)")
    for axis in axes[-1]:
        axis.set_xlabel("along the arc (mm)")
        axis.set_xticks([-0.5, 0, 0.5])
    figure.tight_layout()
    save(figure, path, 256)
