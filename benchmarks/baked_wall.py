"""How exact the baked wall is for rays that are not radial, as those of the endoscope.

    python benchmarks/baked_wall.py [--seed 0] [--rays 20000]

Rays from the bore's axis at slopes of up to ±0.25 off perpendicular are traced through the bone and marched through
the baked height field. Printed for phantom and mastoid: the difference of where they meet it (median, 95th percentile,
share above 0.02 mm; over the wall, and over rays that end in cells), and the error of the map between its nodes.
"""

import argparse

import numpy as np

from endoct.stitching.arrays import Coordinates
from endoct.synthetic.bone.scene import crossings
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.draw import draw

SLOPE = 0.25
STEP_MM = 0.002
LARGE_MM = 0.02


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


def main() -> None:
    """Print a line for each kind of bone and each set of rays."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rays", type=int, default=20_000)
    arguments = parser.parse_args()
    for kind in ("phantom", "mastoid"):
        sample = draw("mastoid", arguments.seed, ranges={"bore.bone": (kind,)})
        wall, rng = build_wall(sample), np.random.default_rng(arguments.seed)
        z_mm = rng.uniform(1, sample.bore.length_mm - 1, arguments.rays)
        theta_rad = rng.uniform(0, 2 * np.pi, arguments.rays)
        for name, slope in (
            ("up to 0.25 off", rng.uniform(-SLOPE, SLOPE, arguments.rays)),
            ("radial, off nodes", np.zeros(arguments.rays)),
        ):
            traced = traced_mm(wall, z_mm, theta_rad, slope)
            off = np.abs(traced - baked_mm(wall, z_mm, theta_rad, slope))
            in_cells = traced > wall.radius_mm + 0.05
            for where, chosen in (("wall", np.full(off.size, True)), ("cells", in_cells)):
                median, high = np.percentile(off[chosen], [50, 95])
                print(
                    f"{kind:8s} {name:18s} {where:6s} n {chosen.sum():6d}  median {1000 * median:6.2f} µm  "
                    f"95th percentile {1000 * high:7.2f} µm  above {LARGE_MM} mm {np.mean(off[chosen] > LARGE_MM):.2%}"
                )


if __name__ == "__main__":
    main()
