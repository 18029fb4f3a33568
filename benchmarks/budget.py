"""Whether the agreement budget predicts what really happens on simulated specimens.

    python benchmarks/budget.py SPECIMEN … [--csv FILE]

A row a specimen that ``endoct simulate`` wrote; its recordings are unrolled and compared. Beside the predicted parts of
the budget stand the true losses: the true cells, at the true places of both panoramas' samples, are sent through the
found alignment to the common grid as real masks are.

- ``true_sampling``: 1 − J of the endoscope's true cells and the same seen at the OCT's samples only.
- ``true_geometry``: what is lost besides where the OCT's true cells are put by the found alignment: its error, and what
  of both panoramas is not rigid.
- ``true_rest``: the rest of 1 − J, which visibility and segmentation predict together.
- ``error_z_um``, ``sd_z_um``: error of the alignment along z amid the overlap, and what its covariance says;
  ``error_arc_um``, ``sd_arc_um`` the same around the bore.
"""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

from endoct.fusion.comparison import compare_panoramas
from endoct.fusion.placement import IN_PLACE, Placement
from endoct.stitching.arrays import Mask
from endoct.stitching.circle import wrap_rad
from endoct.workbench import unroll
from endoct.workbench.bench.truth import jaccard, load_truth, true_cells, true_pose


def evaluate(specimen: Path) -> dict[str, float | str]:
    """Return the row of one specimen; of one that is not aligned the name only."""
    a, b = unroll(specimen / "endoscope"), unroll(specimen / "oct")
    comparison = compare_panoramas(a, b)
    found = comparison.alignment
    if found is None or found.covariance is None:
        return {"specimen": specimen.name}
    truth, grid, seen = load_truth(specimen), comparison.grid, comparison.valid.all(axis=0)
    pose_a, pose_b = true_pose(a, truth), true_pose(b, truth)
    cells_a, cells_b = true_cells(truth, pose_a, a), true_cells(truth, pose_b, b)
    rows = np.clip(np.rint(np.interp(found.z_to_a(b.z_mm), a.z_mm, np.arange(a.z_mm.size))), 0, None).astype(int)
    columns = np.rint(a.grid.column_of(found.theta_to_a(b.grid.theta_rad))).astype(int) % a.grid.n_theta

    def placed(k: int, mask: Mask) -> Mask:
        side, where = ((a, IN_PLACE), (b, found))[k]
        return Placement(side, where, grid, grid.z_mm, grid.dz_mm).mask(mask, np.ones_like(mask))[0]

    of_a = placed(0, cells_a)
    sampled = jaccard(of_a, placed(1, cells_a[np.ix_(rows, columns)]), seen)
    through = jaccard(of_a, placed(1, cells_b), seen)
    z_a, z_b = pose_a.z_bore(a.z_mm), pose_b.z_bore(b.z_mm)
    shared = (z_b >= z_a.min()) & (z_b <= z_a.max())
    order = np.argsort(z_a)
    error_mm = found.z_to_a(b.z_mm[shared]) - np.interp(z_b[shared], z_a[order], a.z_mm[order])
    true_rad = (pose_b.theta_bore(b.grid.theta_rad) - pose_a.theta0_rad) * pose_a.sense
    turn_rad = float(np.median(wrap_rad(found.theta_to_a(b.grid.theta_rad) - true_rad)))
    covariance = np.array(found.covariance)
    lever = np.array([0, 1, b.z_mm[shared].mean() * (-1 if found.z_reversed else 1)])
    shares = {name: part["share"] for name, part in comparison.result["budget"]["parts"].items()}
    return {
        "specimen": specimen.name,
        "jaccard": comparison.result["jaccard"],
        **shares,
        "true_sampling": 1 - sampled,
        "true_geometry": sampled - through,
        "true_rest": through - comparison.result["jaccard"],
        "error_z_um": 1e3 * float(np.median(error_mm)),
        "sd_z_um": 1e3 * float(np.sqrt(lever @ covariance @ lever)),
        "error_arc_um": 1e3 * turn_rad * a.grid.radius_mm,
        "sd_arc_um": 1e3 * float(np.sqrt(covariance[0, 0])) * a.grid.radius_mm,
    }


def main() -> None:
    """Evaluate the specimens named and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specimens", type=Path, nargs="+")
    parser.add_argument("--csv", type=Path)
    arguments = parser.parse_args()
    rows = []
    for specimen in arguments.specimens:
        rows.append(evaluate(specimen))
        print("  ".join(f"{k}={v:.3f}" if isinstance(v, float) else f"{v}" for k, v in rows[-1].items()), flush=True)
    known = [row for row in rows if "jaccard" in row]
    if arguments.csv and known:
        with arguments.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(known[0]))
            writer.writeheader()
            writer.writerows(known)
    sys.exit(0 if known else 1)


if __name__ == "__main__":
    main()
