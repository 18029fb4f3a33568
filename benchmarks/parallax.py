"""Depth of the endoscope by parallax, and its cells by brightness, by depth and by both, against truth.

    python -m benchmarks.parallax sound:6000:6030 quick:2200:2230 [--csv parallax.csv] [--workers 2]
    python -m benchmarks.parallax --table parallax.csv

A set with its first seed and the one after its last. Sets are presets of the simulator and those of the independent
generator. A row a recording, 15 s of one core each.
"""

import argparse
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from benchmarks.independent.bore import drill
from benchmarks.independent.judge import Wall, measured_place
from benchmarks.independent.mirror import travel
from benchmarks.independent.pair import write_endoscope
from benchmarks.independent.sets import recipe_of
from benchmarks.independent.truth import endoscope_place
from benchmarks.pairs import seeds_of
from endoct.base.arrays import Image, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.ranks import robust_sigma
from endoct.fusion.evidence.side import Side
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.side_cells import doubts_of_side, segment_side
from endoct.stitching.panorama import Panorama
from endoct.synthetic import specimen_files
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import stored_frame
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.sample.presets import PRESETS
from endoct.synthetic.truth import write_truth
from endoct.workbench import unroll
from endoct.workbench.pipeline.truth import load_truth, true_cells, true_pose, true_relief

DEPTHS_MM = ((0.03, 0.1), (0.1, 0.3), (0.3, 0.7), (0.7, 1.5))
EDGES = {"edge -z": (0, -1), "edge +z": (0, 1), "edge -theta": (1, -1), "edge +theta": (1, 1)}
"""Sides of a cell, by the axis and direction in which they face out of it."""
FARTHEST_MM = 0.3
"""An edge farther off than this was not moved but missed."""
FEWEST = 500
"""Samples of which a spread is told."""
WAYS = {
    "brightness": SegmentParameters(eye="off", by_depth=False),
    "both": SegmentParameters(eye="off"),
    "eye, brightness": SegmentParameters(by_depth=False),
    "eye": SegmentParameters(),
}
"""How cells are found: by rules, from brightness and with depth, and by the learned eye, without depth and with it."""
Row = Mapping[str, object]


@dataclass(frozen=True, eq=False)
class Recorded:
    """A panorama with its true relief and cells, on its own samples."""

    panorama: Panorama
    relief_mm: Image
    cell: Mask


def of_simulator(preset: str, seed: int, folder: Path) -> Recorded:
    """Return the endoscope's panorama of a specimen of the simulator."""
    sample = draw(preset, seed)  # type: ignore[arg-type]
    wall = build_wall(sample)
    maps = wall.maps()
    lighting = lighting_of(sample, maps)
    frames = (stored_frame(sample, maps, lighting, k) for k in range(len(sample.endoscope.z_mm)))
    specimen_files.write_endoscope(folder / "endoscope", sample, frames)
    write_truth(folder / "truth", sample, wall)
    panorama, truth = unroll(folder / "endoscope", progress=False), load_truth(folder)
    pose = true_pose(panorama, truth)
    return Recorded(panorama, true_relief(truth, pose, panorama), true_cells(truth, pose, panorama))


def of_independent(name: str, seed: int, folder: Path) -> Recorded:
    """Return the endoscope's panorama of a bore of the independent generator."""
    recipe = recipe_of(name, seed)
    bore = drill(recipe.bore, np.random.default_rng([seed, 0]))
    journey = travel(bore, recipe.endoscope, np.random.default_rng([seed, 2]))
    write_endoscope(journey, recipe, folder)
    panorama = unroll(folder, progress=False)
    grid = panorama.grid
    wall = Wall(panorama.intensity, np.zeros(grid.shape, np.bool_), panorama.valid, grid.z_mm, grid.theta_rad)
    place, _ = measured_place(bore, wall, endoscope_place(recipe.endoscope, journey))
    theta, z = np.broadcast_arrays(*place.to_bore(grid.theta_rad[None, :], grid.z_mm[:, None]))
    return Recorded(panorama, np.asarray(bore.at(bore.relief_mm, theta, z), np.float32), bore.is_cell(theta, z))


def judged(name: str, seed: int) -> Row:
    """Return figures of one recording."""
    with TemporaryDirectory() as scratch:
        recorded = (of_simulator if name in PRESETS else of_independent)(name, seed, Path(scratch))
    side = Side("endoscope", recorded.panorama)
    row: dict[str, object] = {"set": name, "seed": seed}
    cell, valid = recorded.cell & recorded.panorama.valid, recorded.panorama.valid
    by_depth = np.zeros(cell.shape, np.bool_)
    if (relief := side.parallax) is not None:
        by_depth = relief.known & (relief.relief_mm > np.fmax(0.05, relief.error_mm))
    answers = {how: segment_side(side, parameters, "dark") for how, parameters in WAYS.items()}
    for how, mask in {"depth": by_depth, **{how: answer.mask for how, answer in answers.items()}}.items():
        row[how] = jaccard(mask, cell, valid)
        row[f"{how} precision"] = (mask & cell).sum() / max(mask.sum(), 1)
        row[f"{how} recall"] = (mask & cell).sum() / max(cell.sum(), 1)
    row["doubts"] = ", ".join(doubt.code for doubt in doubts_of_side(side, answers["eye"]))
    return row | dict(_depths(recorded, side)) | dict(_edges(recorded, answers["eye"].mask))


def _edges(recorded: Recorded, mask: Mask) -> Iterator[tuple[str, float]]:
    """Yield by how much each side of cells is found short, µm, the median along its edge; less than 0 is too long."""
    grid, valid = recorded.panorama.grid, recorded.panorama.valid
    sample_mm = grid.dz_mm, grid.dtheta_mm
    true_mm, found_mm = (signed_distance(cells & valid, sample_mm, 2 * FARTHEST_MM) for cells in (recorded.cell, mask))
    slopes = np.gradient(true_mm, sample_mm[0], axis=0), (np.roll(true_mm, -1, 1) - np.roll(true_mm, 1, 1)) / 2
    slopes = slopes[0], slopes[1] / sample_mm[1]
    edge = valid & (np.abs(true_mm) <= max(sample_mm)) & (np.abs(found_mm) < FARTHEST_MM)
    for name, (axis, sense) in EDGES.items():
        facing = edge & (-sense * slopes[axis] > np.abs(slopes[1 - axis]))
        if facing.sum() >= FEWEST // 5:
            yield name, -1e3 * float(np.median((found_mm - true_mm)[facing]))


def _depths(recorded: Recorded, side: Side) -> Iterator[tuple[str, float]]:
    """Yield bias and spread, µm, share within two standard errors and known share, of the wall and of floors."""
    plain = ~recorded.cell & (np.abs(recorded.relief_mm) < 0.01)
    floors = {
        f"{low:g} to {high:g}": recorded.cell & (recorded.relief_mm > low) & (recorded.relief_mm < high)
        for low, high in DEPTHS_MM
    }
    relief = side.parallax
    for name, where in {"wall": plain, **floors}.items():
        where = where & recorded.panorama.valid
        known = where & relief.known if relief is not None else np.zeros(where.shape, np.bool_)
        if where.sum() < FEWEST:
            continue
        yield f"{name} known", float(known.sum() / where.sum())
        if relief is not None and known.sum() >= FEWEST:
            error = (relief.relief_mm - recorded.relief_mm)[known]
            yield f"{name} bias", 1e3 * float(np.median(error))
            yield f"{name} spread", 1e3 * robust_sigma(error - np.median(error))
            yield f"{name} in 2 sigma", float((np.abs(error) <= 2 * relief.error_mm[known]).mean())


def table(rows: pd.DataFrame) -> str:
    """Return what sets come to: medians, worst deciles, worst and means of cells; medians of depths."""
    lines = []
    for name, of in rows.groupby("set", sort=False):
        doubted = int(of["doubts"].astype(str).str.contains("cells").sum())
        lines.append(f"{name}: {len(of)} recordings, the cells of {doubted} doubted")
        for how in (*WAYS, "depth"):
            j, right, found = of[how].fillna(0), of[f"{how} precision"].median(), of[f"{how} recall"].median()
            lines.append(
                f"  {how:15s} median {j.median():.3f}, worst decile {j.quantile(0.1):.3f}, worst {j.min():.3f}, mean "
                f"{j.mean():.3f}; precision {right:.3f}, recall {found:.3f}"
            )
        short = (f"{edge[5:]} {of[edge].median():+.0f} (mean {of[edge].mean():+.0f})" for edge in EDGES if edge in of)
        lines.append(f"  edges found short, µm: {', '.join(short)}")
        for what in ("wall", *(f"{low:g} to {high:g}" for low, high in DEPTHS_MM)):
            if f"{what} spread" in of and of[f"{what} spread"].notna().any():
                bias, spread, held, known = (of[f"{what} {part}"] for part in ("bias", "spread", "in 2 sigma", "known"))
                lines.append(
                    f"  {what:10s} spread {spread.median():.0f} (mean {spread.mean():.0f}, worst {spread.max():.0f}), "
                    f"bias {bias.median():+.0f} µm, in 2 sigma {held.median():.2f} (worst {held.min():.2f}), "
                    f"known {known.median():.2f}"
                )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.parallax", description=__doc__)
    parser.add_argument("sets", nargs="*")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.table:
        print(table(pd.read_csv(options.table)))
        return
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    rows = []
    with ProcessPoolExecutor(options.workers) as pool:
        for row in pool.map(judged, *zip(*seeds_of(options.sets), strict=True)):
            rows.append(row)
            print(
                row["set"],
                row["seed"],
                *(f"{how} {row[how]:.3f}" for how in (*WAYS, "depth")),
                flush=True,
            )
            if options.csv:
                pd.DataFrame(rows).to_csv(options.csv, index=False)
    print(table(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
