"""Contradictions planted into pairs that were unrolled: how many the one wall finds, and how many it finds elsewhere.

    python -m benchmarks.wall_planted sound:9300:9303 quick:9300:9303

Each pair gets one of each kind, where there is room: a cell painted on the wall, a pale stain on it, a cell filled with
fluid, whose surface is flush with the wall, and the shadow behind a fold of the sheath, where OCT meets no surface.
Apart from these, the last 0.2 mm of every cell toward larger z are lit like wall, and it is counted how often that is
said, and how often without it.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.pairs import recorded, seeds_of
from endoct.base.arrays import Image, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.regions import label
from endoct.fusion.comparison import place_sides
from endoct.fusion.evidence.side import two_sides
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.result import Contradiction
from endoct.fusion.sides import Placed
from endoct.fusion.wall.both_sides import both_sides_of
from endoct.fusion.wall.cells import contradictions_of
from endoct.fusion.wall.short_ends import doubt_of_short_ends
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

KINDS = ("painted", "stain", "fluid", "shadow")
RADIUS_MM, ROOM_MM, FROM_END_MM = 0.25, 0.35, 1.0
PAINT, STAIN = 0.25, 0.6
"""What is left of the light on a painted cell and on a stain."""
OUT_OF_RANGE_MM = 0.9
NEAR_MM = 0.15
SHORT_MM = 0.2


@dataclass(frozen=True)
class Plant:
    """What was planted where, in the frame of side A, and the side that should alone show a cell there."""

    kind: str
    theta_rad: float
    z_mm: float
    shown_by: str


def away_mm(grid: SurfaceGrid, theta_rad: float, z_mm: float) -> NDArray[np.float64]:
    """Return how far every sample lies from a place on the wall."""
    arc = np.abs(np.mod(grid.theta_rad - theta_rad + np.pi, 2 * np.pi) - np.pi) * grid.radius_mm
    return np.asarray(np.hypot(grid.z_mm[:, np.newaxis] - z_mm, arc))


def free_places(
    grid: SurfaceGrid, cells: Mask, valid: Mask, rng: np.random.Generator, n: int
) -> list[tuple[float, float]]:
    """Return up to ``n`` places (θ, z) with no cell within the room of a plant, far from each other and the ends."""
    room = signed_distance(cells | ~valid, (grid.dz_mm, grid.dtheta_mm), 1.0) < -(RADIUS_MM + ROOM_MM)
    inner = (grid.z_mm > grid.z_mm[0] + FROM_END_MM) & (grid.z_mm < grid.z_mm[-1] - FROM_END_MM)
    room &= inner[:, np.newaxis]
    places: list[tuple[float, float]] = []
    while len(places) < n and room.any():
        row, column = np.unravel_index(rng.choice(np.flatnonzero(room)), room.shape)
        places.append((float(grid.theta_rad[column]), float(grid.z_mm[row])))
        room &= away_mm(grid, *places[-1]) > 3 * RADIUS_MM + ROOM_MM
    return places


def planted(a: Panorama, b: Panorama, placed: Placed, seed: int) -> tuple[Panorama, Panorama, list[Plant]]:
    """Return an endoscope's panorama ``a`` and one of OCT with plants, and these."""
    rng, where = np.random.default_rng(seed), placed.samplings[1].where
    of_b, relief = placed.cells[1], placed.both[1].relief
    assert relief is not None
    assert b.depth_mm is not None
    names, plants = [side.name for side in placed.sides], list[Plant]()
    intensity: Image = a.intensity.copy()
    both = placed.sides[0].mask | placed.sides[1].mask
    seen = placed.sides[0].valid & placed.sides[1].valid
    at = dict(zip(("painted", "stain", "shadow"), free_places(placed.grid, both, seen, rng, 3), strict=False))
    for kind, left in (("painted", PAINT), ("stain", STAIN)):
        if kind in at:
            from_mm = away_mm(a.grid, *at[kind])
            soft = np.clip((RADIUS_MM - from_mm) / 0.02, 0, 1) if kind == "painted" else np.exp(-((from_mm / 0.2) ** 4))
            intensity *= (1 - (1 - left) * soft).astype(np.float32)
            plants.append(Plant(kind, *at[kind], names[0]))
    depth_mm = b.depth_mm.copy()
    if "shadow" in at:
        theta_b, z_b = where.theta_to_b(at["shadow"][0]), float(where.z_to_b(at["shadow"][1]))
        arc = np.abs(np.mod(b.grid.theta_rad - theta_b + np.pi, 2 * np.pi) - np.pi) * b.grid.radius_mm
        stripe = (np.abs(b.grid.z_mm - z_b)[:, np.newaxis] < 2 * RADIUS_MM) & (arc < RADIUS_MM / 2)
        depth_mm[stripe] += OUT_OF_RANGE_MM
        plants.append(Plant("shadow", *at["shadow"], names[1]))
    if (part := _a_cell(of_b.mask & b.valid, b.grid, rng)) is not None:
        depth_mm[part] -= relief.values[part]
        theta_b = np.angle(np.exp(1j * b.grid.theta_rad[np.nonzero(part)[1]]).mean())
        place = float(where.theta_to_a(theta_b)), float(where.z_to_a(b.grid.z_mm[np.nonzero(part)[0]].mean()))
        plants.append(Plant("fluid", *place, names[0]))
    return replace(a, intensity=intensity), replace(b, depth_mm=depth_mm), plants


def shortened(a: Panorama, cells: Mask, seed: int) -> Panorama:
    """Return an endoscope's panorama whose ``cells`` end ``SHORT_MM`` before they do toward larger z."""
    rng, rows = np.random.default_rng(seed), round(SHORT_MM / a.grid.dz_mm)
    lost = cells & ~np.vstack([cells[rows:], np.zeros_like(cells[:rows])])
    intensity = a.intensity.copy()
    for row, wall, of_row in zip(intensity, a.valid & ~cells, lost, strict=True):
        row[of_row] = rng.choice(row[wall], of_row.sum()) if wall.any() else row[of_row]
    nowhere = np.float32(np.nan)
    parallax = {
        name: None if image is None else np.where(lost, nowhere, image)
        for name, image in (("parallax_depth_mm", a.parallax_depth_mm), ("parallax_error_mm", a.parallax_error_mm))
    }
    return replace(a, intensity=intensity, **parallax)


def short(placed: Placed) -> bool:
    """Say whether cells of the endoscope are said to end short."""
    sides = both_sides_of(placed)
    return sides is not None and doubt_of_short_ends(sides, (placed.sides[0].name, placed.sides[1].name)) is not None


def _a_cell(cells: Mask, grid: SurfaceGrid, rng: np.random.Generator) -> Mask | None:
    """Return one cell of 0.15 to 1 mm², with what lies beside it, away from the ends."""
    labels, n = label(cells)
    order = rng.permutation(np.arange(1, n + 1))
    for number in order:
        part = labels == number
        rows = grid.z_mm[part.any(axis=1)]
        inner = rows[0] > grid.z_mm[0] + FROM_END_MM and rows[-1] < grid.z_mm[-1] - FROM_END_MM
        if inner and 0.15 < part.sum() * grid.dz_mm * grid.dtheta_mm < 1.0:
            return signed_distance(part, (grid.dz_mm, grid.dtheta_mm), 0.3) > -0.1
    return None


def contradictions_in(placed: Placed) -> tuple[Contradiction, ...]:
    """Return the contradictions of two placed sides; none where they were not aligned."""
    sides = both_sides_of(placed)
    return () if sides is None else contradictions_of(sides, (placed.sides[0].name, placed.sides[1].name))


def is_at(plant: Plant, each: Contradiction, radius_mm: float) -> bool:
    """Say whether a contradiction is that of a plant."""
    arc_mm = abs((each.theta_rad - plant.theta_rad + np.pi) % (2 * np.pi) - np.pi) * radius_mm
    return each.shown_by == plant.shown_by and np.hypot(arc_mm, each.z_mm - plant.z_mm) < RADIUS_MM + NEAR_MM


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wall_planted", description=__doc__)
    parser.add_argument("sets", nargs="+")
    n_planted, n_found, n_false, n_plain, n_pairs = dict.fromkeys(KINDS, 0), dict.fromkeys(KINDS, 0), 0, 0, 0
    n_short, n_said = 0, 0
    for name, seed in seeds_of(parser.parse_args().sets):
        pair = recorded(name, seed)
        a, b = pair.a, pair.b
        plain = place_sides(*two_sides(a, b), CompareParameters())
        if plain.outcome.alignment is None:
            continue
        before = contradictions_in(plain)
        with_a, with_b, plants = planted(a, b, plain, seed)
        after = contradictions_in(place_sides(*two_sides(with_a, with_b), CompareParameters()))
        short_ends = place_sides(*two_sides(shortened(a, plain.cells[0].mask, seed), b), CompareParameters())
        n_short, n_said = n_short + short(short_ends), n_said + short(plain)
        radius_mm, n_pairs, n_plain = a.grid.radius_mm, n_pairs + 1, n_plain + len(before)
        for plant in plants:
            n_planted[plant.kind] += 1
            n_found[plant.kind] += any(is_at(plant, each, radius_mm) for each in after)
        elsewhere = [each for each in after if not any(is_at(plant, each, radius_mm) for plant in plants)]
        n_false += len(elsewhere)
        print(
            name, seed, [plant.kind for plant in plants], "found", len(after) - len(elsewhere), "else", len(elsewhere)
        )
    for kind in KINDS:
        print(f"{kind}: {n_found[kind]} of {n_planted[kind]} found")
    before_mean, after_mean = n_plain / max(n_pairs, 1), n_false / max(n_pairs, 1)
    print(f"contradictions a bore: {before_mean:.2f} before anything was planted, {after_mean:.2f} elsewhere after")
    print(f"cells that end short: said of {n_short} of {n_pairs} pairs with them, and of {n_said} without")


if __name__ == "__main__":
    main()
