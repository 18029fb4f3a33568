"""How exactly two sides are aligned, and whether the stated errors hold: fresh bores of both generators, by set.

    python -m benchmarks.alignment quick:9400:9412 floors:9400:9412 [--drift] [--workers 2]

Sets are presets of the simulator and those of the independent generator. Errors are those of the middle of the OCT.
``--drift`` disturbs each OCT panorama by one of :data:`DRIFTS`, drawn by its seed. Errors are then medians over its
rows, with the bend, and without; and what the drift costs of the Jaccard index of both sides, with and without. 15 s of
one core for each bore, a minute with a drift.
"""

import argparse
import os
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import nan

import numpy as np
from scipy.stats import spearmanr

from benchmarks.pairs import recorded, seeds_of
from endoct.base.arrays import Coordinates
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.comparison import compare_panoramas, compare_placed, place_sides
from endoct.fusion.evidence.side import two_sides
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.parameters import CompareParameters
from endoct.stitching.panorama import Panorama

DRIFTS = "roll", "rollstep", "feedstep", "lost", "doubled"
"""A catheter slips smoothly, or at once, by up to 15°; a feed is 1–8 % off from a place on; slices are lost or doubled.
"""
WRONG_MM = 0.3


@dataclass(frozen=True)
class Aligned:
    """Errors of one pair along the bore (mm), around it (rad) and of the scale, those stated, and those without a bend.

    All are None where the pair was not aligned. ``cost``: by how much the Jaccard index of both sides is lower than
    without the drift, with the bend and without; where nothing is disturbed, than by the true place.
    """

    drift: str
    errors: Coordinates | None = None
    stated: Coordinates | None = None
    rigid: Coordinates | None = None
    cost: tuple[float, float] | None = None


def drifted(panorama: Panorama, drift: str, random: np.random.Generator) -> tuple[Panorama, Coordinates, Coordinates]:
    """Return ``panorama`` disturbed, and where each of its rows truly lies (mm) and by how much it is turned (rad)."""
    z_mm, n = panorama.grid.z_mm, panorama.grid.n_z
    share, rows = np.linspace(0, 1, n), np.arange(n)
    at, size = int(n * random.uniform(0.25, 0.75)), random.choice([-1, 1])
    turn_rad, labels_mm = np.zeros(n), z_mm
    if drift.startswith("roll"):
        course = share >= share[at] if drift == "rollstep" else np.sin(np.pi * share * random.uniform(0.5, 2)) ** 2
        turn_rad = size * np.radians(random.uniform(1, 15)) * course
    elif drift == "feedstep":
        labels_mm = z_mm + size * random.uniform(0.01, 0.08) * np.maximum(z_mm - z_mm[at], 0)
    else:
        count = int(random.integers(1, 4))
        rows = np.delete(rows, slice(at, at + count)) if drift == "lost" else np.insert(rows, at, [at] * count)
        labels_mm = z_mm[0] + panorama.grid.dz_mm * np.arange(rows.size)
        turn_rad = np.zeros(rows.size)
    columns = np.rint(turn_rad / panorama.grid.dtheta_rad).astype(int)

    def moved(image: np.ndarray) -> np.ndarray:
        return np.stack([np.roll(image[row], by) for row, by in zip(rows, columns, strict=True)])

    grid = replace(panorama.grid, n_z=rows.size, rows_mm=tuple(labels_mm.tolist()))
    images = (moved(image) for image in (panorama.intensity, panorama.depth_mm, panorama.valid, panorama.weight))
    intensity, depth_mm, valid, weight = images
    disturbed = replace(
        panorama, grid=grid, intensity=intensity, depth_mm=depth_mm, valid=valid, weight=weight, per_frame={}
    )
    return disturbed, z_mm[rows], columns * panorama.grid.dtheta_rad


def aligned(job: tuple[str, int], *, drift: bool) -> tuple[str, Aligned]:
    """Return the name of the set, and how far off a comparison places its OCT."""
    name, seed = job
    pair = recorded(name, seed)
    a, b, truth = pair.a, pair.b, pair.lies
    kind, z_mm, turn_rad = "", b.grid.z_mm, np.zeros(b.grid.n_z)
    before = nan
    if drift:
        before = compare_panoramas(a, b).result.jaccard or nan
        random = np.random.default_rng(seed)
        kind = str(random.choice(DRIFTS))
        b, z_mm, turn_rad = drifted(b, kind, random)
    sides, parameters = two_sides(a, b), CompareParameters()
    placed = place_sides(*sides, parameters)
    found = placed.outcome.alignment
    if found is None or (found.mirrored, found.z_reversed) != (truth.mirrored, truth.z_reversed):
        return name, Aligned(kind, None if found is None else np.full(3, np.inf))

    def off(alignment: Alignment, rows: np.ndarray) -> Coordinates:
        along_mm = alignment.z_to_a(b.grid.z_mm[rows]) - truth.z_to_a(z_mm[rows])
        around = alignment.theta_to_a(np.zeros(rows.size), b.grid.z_mm[rows]) - truth.theta_to_a(-turn_rad[rows])
        return np.stack([along_mm, wrap_rad(around)])

    if drift:
        every = np.arange(b.grid.n_z)
        errors, rigid = (np.median(np.abs(off(of, every)), axis=1) for of in (found, found.rigid))
        of_bend, of_rigid = (
            compare_placed(sides, placed.cells, of, parameters).result.jaccard or nan for of in (found, found.rigid)
        )
        cost = before - of_bend, before - of_rigid
        return name, Aligned(kind, errors, rigid=rigid if found.bend else None, cost=cost)
    middle_mm = float(b.grid.z_mm[[0, -1]].mean())
    along_mm = float(found.rigid.z_to_a(middle_mm) - truth.z_to_a(middle_mm))
    around_rad = float(wrap_rad(np.float64(found.theta_shift_rad - truth.theta_shift_rad)))
    to_middle = np.array([[0, 1, -middle_mm if found.z_reversed else middle_mm], [1, 0, 0], [0, 0, 1.0]])
    stated = np.sqrt(np.diag(to_middle @ np.array(found.covariance) @ to_middle.T))
    errors = np.array([along_mm, around_rad, found.z_scale - truth.z_scale])
    of_found, of_truth = (compare_placed(sides, placed.cells, of, parameters).result.jaccard for of in (found, truth))
    return name, Aligned(kind, errors, stated, cost=((of_truth or nan) - (of_found or nan), nan))


def line_of(name: str, every: list[Aligned]) -> str:
    """Return a line on one set, or one kind of drift."""
    errors = np.array([one.errors for one in every if one.errors is not None])
    if not errors.size:
        return f"{name} {len(every)}: none aligned"
    wrong = np.abs(errors[:, 0]) > WRONG_MM
    along_um, around_deg = 1e3 * errors[:, 0], np.degrees(errors[:, 1])
    line = (
        f"{name} {len(every)}: aligned {len(errors)}, wrong {wrong.sum()}; along {np.median(np.abs(along_um)):.1f} µm "
        f"(mean {along_um.mean():+.1f}), around {np.median(np.abs(around_deg)):.2f}° (mean {around_deg.mean():+.2f})"
    )
    if every[0].drift:
        rigid = np.array([one.rigid for one in every if one.rigid is not None]).reshape(-1, 2)
        before = np.median(rigid, axis=0) if rigid.size else np.zeros(2)
        bent = [one.cost for one in every if one.cost and one.rigid is not None]
        return (
            f"{line}; bent {len(rigid)}, without a bend {1e3 * before[0]:.1f} µm, {np.degrees(before[1]):.2f}°; "
            f"cost of the index {_cost([one.cost[0] for one in every if one.cost])}, of the bent "
            f"{_cost([one[0] for one in bent])}, of these without a bend {_cost([one[1] for one in bent])}"
        )
    stated = np.array([one.stated for one in every if one.errors is not None])
    within = np.abs(errors / stated)
    shares = ", ".join(f"{share:.0%}" for share in (within < 2).mean(axis=0))
    most = " and ".join(np.array2string(np.quantile(of, 0.9, axis=0), precision=4) for of in (np.abs(errors), within))
    ranks = ", ".join(f"{spearmanr(*of).statistic:.2f}" for of in zip(stated.T, np.abs(errors).T, strict=True))
    of_truth = np.array([one.cost[0] for one in every if one.cost])
    return (
        f"{line}; within two σ along, around, scale {shares}; nine in ten within {most} σ; Spearman of σ and error "
        f"{ranks}; the index by the true place {np.nanmedian(of_truth):+.3f}, at most {np.nanmax(np.abs(of_truth)):.3f}"
    )


def _cost(values: list[float]) -> str:
    return "{:.3f} (nine in ten {:.3f})".format(*np.nanquantile(values, (0.5, 0.9))) if values else "unknown"


def main() -> None:
    """Measure every set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", help="NAME:FIRST:LAST, seeds before LAST")
    parser.add_argument("--drift", action="store_true")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    given = parser.parse_args()
    by = defaultdict[str, list[Aligned]](list)
    with ProcessPoolExecutor(given.workers) as pool:
        for name, one in pool.map(partial(aligned, drift=given.drift), seeds_of(given.sets)):
            by[one.drift or name].append(one)
            by["all"].append(one)
    for name, every in by.items():
        print(line_of(name, every))


if __name__ == "__main__":
    main()
