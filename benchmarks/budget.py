"""Whether the agreement budget predicts what really happens on simulated specimens.

    python benchmarks/budget.py SPECIMEN … [--cache DIR] [--csv FILE]

A row a specimen that ``endoct simulate`` wrote; its recordings are unrolled and compared. Next to the predicted parts
of the budget stand the true losses, taken in the budget's own order (what is lost first hides part of what follows):

- ``true_alignment``: 1 − J of the true cells at the true places of the endoscope's panorama and at those of the OCT's
  where the alignment puts them, both on the fine grid: its error, and what of both panoramas' z is not rigid.
- ``true_sampling``: what is lost in addition where both are taken at the panoramas' own samples only and brought from
  there to the common grid as real masks are.
- ``true_rest``: the rest of 1 − J, which visibility and segmentation predict together.
- ``error_z_um``, ``sd_z_um``: error of the alignment along z amid the overlap, and what its covariance says;
  ``error_arc_um``, ``sd_arc_um`` the same around the bore.

Last, of the specimens together: the ratio of predicted and true loss by alignment, and the root mean square of errors
in units of their standard errors, which is 1 where the covariance is right.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from panoramas import SIDES, unroll_both, unrolled

from endoct.base.arrays import Coordinates, Mask
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.comparison import compare_panoramas
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.geometry.placement import IN_PLACE, Placement
from endoct.fusion.scoring.overlap import jaccard
from endoct.stitching.panorama import Panorama
from endoct.workbench.pipeline.truth import TrueMap, TruePose, Truth, load_truth, true_cells, true_pose


def evaluate(specimen: Path, cache: Path) -> dict[str, float | str]:
    """Return the row of one specimen; of one that is not aligned the name only."""
    unroll_both(specimen, cache)
    a, b = (unrolled(specimen, side, cache) for side in SIDES)
    comparison = compare_panoramas(a, b)
    alignment = comparison.alignment
    if alignment is None or alignment.covariance is None:
        return {"specimen": specimen.name}
    truth, grid, valid = load_truth(specimen), comparison.grid, comparison.sides[0].valid & comparison.sides[1].valid
    pose_a, pose_b = true_pose(a, truth), true_pose(b, truth)

    def fine(pose: TruePose, where: Alignment) -> Mask:
        theta_rad = where.rigid.theta_to_b(grid.theta_rad)
        return _cells_at(truth, pose.z_bore(where.z_to_b(grid.z_mm)), pose.theta_bore(theta_rad))

    def sampled(side: Panorama, pose: TruePose, where: Alignment) -> Mask:
        mask = true_cells(truth, pose, side)
        return Placement.averaging(side.grid, where, grid).mask(mask, np.ones_like(mask))[0]

    put = jaccard(fine(pose_a, IN_PLACE), fine(pose_b, alignment), valid)
    through = jaccard(sampled(a, pose_a, IN_PLACE), sampled(b, pose_b, alignment), valid)
    true = TrueMap(a.z_mm, pose_a, pose_b)
    z_true_mm, theta_rad = true.z_to_a(b.z_mm), b.grid.theta_rad
    shared = np.isfinite(z_true_mm)
    error_mm = alignment.z_to_a(b.z_mm[shared]) - z_true_mm[shared]
    turn_rad = float(np.median(wrap_rad(alignment.theta_to_a(theta_rad, b.z_mm[:, None]) - true.theta_to_a(theta_rad))))
    covariance = np.array(alignment.covariance)
    lever = np.array([0, 1, b.z_mm[shared].mean() * (-1 if alignment.z_reversed else 1)])
    budget, overlap = comparison.result.budget, comparison.result.jaccard
    if budget is None or overlap is None:
        return {"specimen": specimen.name}
    shares = {cause: part.share for cause, part in budget.parts.by_cause().items()}
    return {
        "specimen": specimen.name,
        "jaccard": overlap,
        **shares,
        "true_alignment": 1 - put,
        "true_sampling": put - through,
        "true_rest": through - overlap,
        "error_z_um": 1e3 * float(np.median(error_mm)),
        "sd_z_um": 1e3 * float(np.sqrt(lever @ covariance @ lever)),
        "error_arc_um": 1e3 * turn_rad * a.grid.radius_mm,
        "sd_arc_um": 1e3 * float(np.sqrt(covariance[0, 0])) * a.grid.radius_mm,
    }


def _cells_at(truth: Truth, z_mm: Coordinates, theta_rad: Coordinates) -> Mask:
    """Return the true cells at places of the bore, bool (z, θ), False beyond its ends."""
    wall_mm, n_theta = truth.wall["z"], truth.wall["theta"].size
    rows = np.rint((z_mm - wall_mm[0]) / (wall_mm[1] - wall_mm[0])).astype(int)
    columns = np.rint(theta_rad / (2 * np.pi) * n_theta).astype(int) % n_theta
    inside = (rows >= 0) & (rows < wall_mm.size)
    cells = truth.wall["cell"][np.ix_(np.clip(rows, 0, wall_mm.size - 1), columns)].astype(np.bool_)
    return np.asarray(cells & inside[:, np.newaxis])


def summarise(rows: list[dict[str, float | str]]) -> str:
    """Return how predictions and truth compare over specimens."""

    def values(name: str) -> Coordinates:
        return np.array([float(row[name]) for row in rows])

    def rms(of: Coordinates) -> float:
        return float(np.sqrt(np.mean(of**2)))

    ratio = values("alignment") / values("true_alignment")
    within = int(np.sum((ratio > 1 / 1.5) & (ratio < 1.5)))
    lines = [
        f"alignment, predicted / true: median {np.median(ratio):.2f}, {ratio.min():.2f} to {ratio.max():.2f}, "
        f"{within} of {len(rows)} within a factor of 1.5"
    ]
    for axis in ("z", "arc"):
        error, sd = values(f"error_{axis}_um"), values(f"sd_{axis}_um")
        lines.append(
            f"error of {axis} {rms(error):.1f} µm rms, mean {error.mean():.1f}, {rms(error / sd):.2f} deviations"
        )
    return "; ".join(lines)


def main() -> None:
    """Evaluate the specimens named and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specimens", type=Path, nargs="+")
    parser.add_argument("--cache", type=Path, help="keep panoramas here, and reuse them")
    parser.add_argument("--csv", type=Path)
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for specimen in arguments.specimens:
            rows.append(evaluate(specimen, arguments.cache or Path(scratch)))
            print(
                "  ".join(f"{k}={v:.3f}" if isinstance(v, float) else f"{v}" for k, v in rows[-1].items()), flush=True
            )
    known = [row for row in rows if "jaccard" in row]
    if known:
        print(summarise(known))
    if arguments.csv and known:
        pd.DataFrame(known).to_csv(arguments.csv, index=False)
    sys.exit(0 if known else 1)


if __name__ == "__main__":
    main()
