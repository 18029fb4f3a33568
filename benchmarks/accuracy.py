"""How close `endoct compare` comes to the truth of simulated specimens.

    python benchmarks/accuracy.py --seeds 1000-1009 [--preset quick] [--literal] [--csv FILE] [--keep DIR]

Seeds 0–99 are for tuning, from 1000 on for reporting. A row a specimen, then medians. What the columns mean:

- ``oct_truth``: Jaccard index of the OCT cells against the true cells, on the OCT's own rows and columns placed in
  the bore by the true pose of every slice, over the samples the OCT calls valid; ``endo_truth`` the same for the
  endoscope.
- ``oct_valid``: share of the OCT's samples that are valid, within the z range both instruments covered.
- ``pair_native``, ``pair_grid``: endoscope against OCT, on the OCT's rows and on the comparison's grid.
- ``theta_deg``, ``z_mm``: error of the alignment, median over the overlap; ``landmark_mm``: 95th percentile of the
  distance between where a wall point of the OCT panorama is mapped to and where it is, stitching included.
- ``right``: whether handedness and direction of travel were found.
"""

import argparse
import csv
import json
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from endoct.fusion.cells import segment
from endoct.stitching.circle import wrap_rad
from endoct.stitching.panorama import Panorama
from endoct.stitching.store import load_panorama
from endoct.workbench import compare, simulate

LITERAL = {"undistort": "sine", "wall": "maximum"}


@dataclass(frozen=True)
class Pose:
    """Where a panorama truly lies: θ_bore = theta0_rad + sense · θ, z_bore by interpolation over its frames."""

    theta0_rad: float
    sense: int
    z_panorama_mm: NDArray[np.float64]
    z_bore_mm: NDArray[np.float64]

    def z_bore(self, z_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the place in the bore of rows at ``z_mm``, continued beyond the first and last frame."""
        inner = np.interp(z_mm, self.z_panorama_mm, self.z_bore_mm)
        slope = np.sign(self.z_bore_mm[-1] - self.z_bore_mm[0]) if len(self.z_bore_mm) > 1 else 1.0
        return inner + slope * (z_mm - np.clip(z_mm, self.z_panorama_mm[0], self.z_panorama_mm[-1]))

    def theta_bore(self, theta_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angle in the bore frame of columns at ``theta_rad``."""
        return self.theta0_rad + self.sense * theta_rad


def true_pose(panorama: Panorama, truth: dict, stated_mirrored: bool) -> Pose:
    """Return the pose of ``panorama`` from the recording's truth, frame by frame."""
    index = panorama.per_frame[f"{panorama.frame_dim}_index"]
    z_panorama = panorama.per_frame[f"{panorama.frame_dim}_z_mm"]
    z_bore = np.asarray(truth["z_mm"])[index]
    if "roll_rad" in truth:  # the panorama's angle of a frame is image angle + estimated roll
        turn = np.asarray(truth["roll_rad"])[index] - panorama.per_frame["roll_rad"]
        return Pose(float(turn[0] + np.median(wrap_rad(turn - turn[0]))), 1, z_panorama, z_bore)
    sense = int(truth["theta_sense"]) * (-1 if stated_mirrored else 1)
    return Pose(float(truth["theta_origin_rad"]), sense, z_panorama, z_bore)


def true_cells(wall: xr.Dataset, pose: Pose, panorama: Panorama) -> NDArray[np.bool_]:
    """Return the true cells at the centres of the panorama's samples, bool (n_z, n_theta)."""
    dz = float(wall.z[1] - wall.z[0])
    n_theta = wall.sizes["theta"]
    rows = np.clip(np.rint((pose.z_bore(panorama.z_mm) - float(wall.z[0])) / dz), 0, wall.sizes["z"] - 1).astype(int)
    columns = np.rint(pose.theta_bore(panorama.grid.theta_rad) / (2 * np.pi) * n_theta).astype(int) % n_theta
    return wall.cell.values[np.ix_(rows, columns)].astype(bool)


def jaccard(a: NDArray[np.bool_], b: NDArray[np.bool_], where: NDArray[np.bool_]) -> float:
    """Return |A ∩ B| / |A ∪ B| over ``where``."""
    return float((a & b & where).sum() / max((((a | b) & where).sum()), 1))


def evaluate(specimen: Path, work: Path, literal: bool) -> dict[str, float | bool | str]:
    """Compare the specimen's recordings and hold the result against its truth."""
    settings = LITERAL if literal else {}
    comparison = compare(specimen / "endoscope", specimen / "oct", work, settings_b=settings, overwrite=True)
    result = json.loads((work / "result.json").read_text())
    truth = json.loads((specimen / "truth" / "recording.json").read_text())
    wall = xr.open_zarr(specimen / "truth" / "wall.zarr").load()
    endoscope, oct_ = (load_panorama(work / "panoramas" / f"{name}.zarr") for name in ("endoscope", "oct"))
    pose_e = true_pose(endoscope, truth["endoscope"], False)
    pose_o = true_pose(oct_, truth["oct"], oct_.provenance["acquisition"]["handedness"] == "mirrored")
    z_e, z_o = pose_e.z_bore(endoscope.z_mm), pose_o.z_bore(oct_.z_mm)
    shared = (z_o >= z_e.min()) & (z_o <= z_e.max())
    oct_cells, endo_cells = segment(oct_), segment(endoscope)
    row: dict[str, float | bool | str] = {
        "specimen": specimen.name,
        "aligned": comparison.alignment is not None,
        "oct_truth": jaccard(oct_cells, true_cells(wall, pose_o, oct_), oct_.valid),
        "oct_valid": float(oct_.valid[shared].mean()),
        "endo_truth": jaccard(endo_cells, true_cells(wall, pose_e, endoscope), endoscope.valid),
        "seconds": sum(result["seconds"].values()),
    }
    if (alignment := comparison.alignment) is None:
        return row
    row |= {"pair_native": result["scores"]["own_rows"]["jaccard"], "pair_grid": result["jaccard"]}
    # where each OCT sample of the overlap truly lies in the endoscope's frame, and where the alignment puts it
    theta_true = (pose_o.theta_bore(oct_.grid.theta_rad) - pose_e.theta0_rad) * pose_e.sense
    order = np.argsort(z_e)
    z_true = np.interp(z_o[shared], z_e[order], endoscope.z_mm[order])
    theta_found = alignment.theta_to_a(oct_.grid.theta_rad)
    z_found = alignment.z_to_a(oct_.z_mm[shared])
    d_theta, d_z = wrap_rad(theta_found - theta_true), z_found - z_true
    distance = np.hypot(d_theta[None] * oct_.grid.radius_mm, d_z[:, None])
    row |= {
        "theta_deg": float(np.rad2deg(np.median(d_theta))),
        "z_mm": float(np.median(d_z)),
        "landmark_mm": float(np.percentile(distance, 95)),
        "right": bool(
            alignment.mirrored == (pose_o.sense != pose_e.sense)
            and alignment.z_reversed == (np.sign(np.ptp(z_o) * (z_o[-1] - z_o[0]) * (z_e[-1] - z_e[0])) < 0)
        ),
        "confidence": float(alignment.confidence),
    }
    return row


def main() -> None:
    """Evaluate the seeds asked for and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--literal", action="store_true", help="the paper's chain taken literally for the OCT")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--keep", type=Path, help="keep specimens (and reuse them) and comparisons here")
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("-")
    folder = arguments.keep or Path(tempfile.mkdtemp())
    rows = []
    for seed in range(int(first), int(last or first) + 1):
        specimen = folder / f"{arguments.preset}-{seed}"
        if not specimen.exists():
            simulate(specimen, preset=arguments.preset, seed=seed)
        rows.append(
            evaluate(specimen, folder / f"{specimen.name}{'-literal' * arguments.literal}-compared", arguments.literal)
        )
        print(
            "  ".join(f"{k}={v:.3f}" if isinstance(v, float) else f"{k}={v}" for k, v in rows[-1].items()), flush=True
        )
    for key in sorted({k for row in rows for k, v in row.items() if isinstance(v, float)}):
        values = np.array([row[key] for row in rows if key in row])
        print(
            f"{key:12s} median {np.median(values):.3f}  min {values.min():.3f}  max {values.max():.3f}  n {values.size}"
        )
    if arguments.csv:
        with arguments.csv.open("w", newline="") as file:
            writer = csv.DictWriter(file, sorted({k for row in rows for k in row}))
            writer.writeheader()
            writer.writerows(rows)
    if arguments.keep is None:
        shutil.rmtree(folder)


if __name__ == "__main__":
    sys.exit(main())
