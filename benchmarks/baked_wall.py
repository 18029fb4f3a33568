"""How exact the baked wall is for rays that are not radial, as those of the endoscope.

    python benchmarks/baked_wall.py [--seeds 0-7] [--rays 20000] [--frames 3]

Rays are traced through the bone itself and marched through the baked height field: from the bore's axis at slopes of
up to ±0.25 off perpendicular, at no slope, and those of pixels of rendered frames (every 40 th of some frames). Printed
for phantom and mastoid: the share of rays that end more than 0.02 mm apart, over the wall and over rays that end in
cells, as the least, the median and the largest of the seeds, and the median of the distance.
"""

import argparse
from collections import defaultdict

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.synthetic.bone.scene import crossings
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.cone import FrameView, rays_of
from endoct.synthetic.endoscope.sight import follow, view, visible
from endoct.synthetic.sample.parameters import Sample
from endoct.workbench.bench.runner import parse_seeds

SLOPE = 0.25
STEP_MM = 0.002
LARGE_MM = 0.02
IN_CELL_MM = 0.05
EVERY_PIXEL = 40


def baked_mm(wall: Wall, z_mm: Coordinates, theta_rad: Coordinates, slope: Coordinates) -> Coordinates:
    """Return the radius at which rays that start on the axis at ``z_mm`` fall behind the baked wall."""
    radius = np.full(z_mm.size, wall.radius_mm + float(wall.relief_mm.min()))
    on = np.ones(z_mm.size, np.bool_)
    while on.any():
        r = radius[on]
        behind = r >= wall.radius_mm + wall.at(wall.relief_mm, z_mm[on] + slope[on] * r, theta_rad[on])
        index = np.flatnonzero(on)
        on[index[behind]] = False
        radius[index[~behind]] += STEP_MM
    return radius - STEP_MM / 2


def traced_mm(wall: Wall, z_mm: Coordinates, theta_rad: Coordinates, slope: Coordinates) -> Coordinates:
    """Return the radius at which the same rays meet bone or dust."""
    direction = np.stack([np.cos(theta_rad), np.sin(theta_rad), slope], axis=1)
    length = np.sqrt(1 + slope**2)
    origin = np.stack([0 * z_mm, 0 * z_mm, z_mm], axis=1)
    n = z_mm.size
    found = crossings(wall.scene, origin, direction / length[:, None], np.full(n, 0.5), np.full(n, 5.0))
    return found.entry_mm / length


def of_pixels(sample: Sample, wall: Wall, frames: int) -> tuple[Coordinates, Coordinates]:
    """Return how far apart rays of pixels end, traced and as frames are rendered, and their radius as traced, (n,)."""
    camera, off, radii = sample.endoscope, [], []
    for index in np.linspace(0, len(camera.z_mm) - 1, frames).astype(int):
        frame = FrameView.of(camera, index, wall.radius_mm)
        pixels = view(frame)
        hits = follow(visible(wall, frame), frame, pixels)
        rays = rays_of(frame, pixels.look_x_px, pixels.look_y_px)
        some = np.arange(0, pixels.pixel.size, EVERY_PIXEL)
        cos, sin = (turn(rays.theta_rad[some].astype(np.float64)) for turn in (np.cos, np.sin))
        origin, way = (
            np.stack([u[some] * cos - v[some] * sin, u[some] * sin + v[some] * cos, z[some] + from_mm], axis=1)
            for u, v, z, from_mm in ((rays.u0, rays.v0, rays.z0, frame.apex_mm), (rays.u1, rays.v1, rays.z1, 0.0))
        )
        way /= np.linalg.norm(way, axis=1)[:, None]
        found = crossings(wall.scene, origin, way, np.zeros(some.size), np.full(some.size, 5.0))
        traced = origin + found.entry_mm[:, None] * way
        theta = hits.column[some] * wall.dtheta_rad
        radius = hits.radius_mm[some].astype(np.float64)
        z_mm = (hits.row[some] + hits.first_row) * wall.dz_mm
        rendered = np.stack([radius * np.cos(theta), radius * np.sin(theta), z_mm], axis=1)
        # where the wall ends, neither has anything to say
        known = np.isfinite(found.entry_mm) & (z_mm > 0.1) & (z_mm < sample.bore.length_mm - 0.1)
        off.append(np.linalg.norm(traced - rendered, axis=1)[known])
        radii.append(np.hypot(traced[:, 0], traced[:, 1])[known])
    return np.concatenate(off), np.concatenate(radii)


def main() -> None:
    """Print a line for each kind of bone and each set of rays."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0-7", help="first-last")
    parser.add_argument("--rays", type=int, default=20_000)
    parser.add_argument("--frames", type=int, default=3, help="of each specimen")
    arguments = parser.parse_args()
    shares, medians = defaultdict(list), defaultdict(list)
    for kind in ("phantom", "mastoid"):
        for seed in parse_seeds(arguments.seeds):
            sample = draw("mastoid", seed, ranges={"bore.bone": (kind,)})
            wall, rng = build_wall(sample), np.random.default_rng(seed)
            z_mm = rng.uniform(1, sample.bore.length_mm - 1, arguments.rays)
            theta_rad = rng.uniform(0, 2 * np.pi, arguments.rays)
            sets = {"pixels of frames": of_pixels(sample, wall, arguments.frames)}
            for name, slope in (
                ("up to 0.25 off", rng.uniform(-SLOPE, SLOPE, arguments.rays)),
                ("radial, off nodes", np.zeros(arguments.rays)),
            ):
                traced = traced_mm(wall, z_mm, theta_rad, slope)
                sets[name] = np.abs(traced - baked_mm(wall, z_mm, theta_rad, slope)), traced
            for name, (off, radius) in sets.items():
                for where, chosen in (("all", radius > 0), ("cells", radius > wall.radius_mm + IN_CELL_MM)):
                    shares[kind, name, where].append(float(np.mean(off[chosen] > LARGE_MM)))
                    medians[kind, name, where].append(float(np.median(off[chosen])))
    for (kind, name, where), share in shares.items():
        of_seeds = f"{min(share):.2%}  {np.median(share):.2%}  {max(share):.2%}"
        apart_um = 1000 * float(np.median(medians[kind, name, where]))
        print(f"{kind:8s} {name:18s} {where:6s} above {LARGE_MM} mm: {of_seeds}   median apart {apart_um:.2f} µm")


if __name__ == "__main__":
    main()
