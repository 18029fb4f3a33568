"""Depth of cells by what an endoscope shows of them alone: its network trained, and held against truth.

    python -m benchmarks.light_alone make sound:9300:9320 quick:9300:9312 mastoid:9300:9312 hard:9300:9312 \\
        few:9300:9308 many:9300:9307 floors:9300:9306 tiny:9300:9303 --into BORES
    python -m benchmarks.light_alone train --bores BORES [--into fusion/evidence/networks.safetensors]
    python -m benchmarks.light_alone judge --bores OTHER_BORES
    python -m benchmarks.light_alone compare SPECIMEN…

Sets are presets of the simulator and those of the independent generator. ``make`` unrolls an endoscope's recording,
finds its cells as `endoct compare` does, and keeps them with the truth. These 80 bores are those that it learned on.
``compare`` tells of how many cells an endoscope has a depth of its own, and how far that is from OCT's.
"""

import argparse
import os
import pickle
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchmarks.pairs import seeds_of
from benchmarks.parallax import DEPTHS_MM, of_independent, of_simulator
from benchmarks.wall import fitted, keep, save_networks
from endoct.base.arrays import Image, Mask
from endoct.base.numeric.regions import label, quantiles
from endoct.fusion.comparison import place_sides
from endoct.fusion.evidence.light_alone import DEEPEST_MM, depth_by_light, light_features
from endoct.fusion.evidence.side import Side, two_sides
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.scoring.cells import measure
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.fusion.wall.both_sides import both_sides_of
from endoct.synthetic.sample.presets import PRESETS
from endoct.workbench import unroll

SAMPLES_A_BORE = 5000
WIDTH = 48
Light = tuple[tuple[float, float], Mask, Image, Image, Image]
"""What :func:`depth_by_light` is given."""


@dataclass(frozen=True, eq=False)
class Bore:
    """What an endoscope shows of a bore, with its true cells and relief, to 2.5 mm, on the same samples."""

    name: str
    light: Light
    cell: Mask
    relief_mm: Image


def made(into: Path, case: tuple[str, int]) -> str:
    """Make and keep a bore; say that it is there."""
    name, seed = case
    path = into / f"{name}-{seed}.pkl"
    if not path.exists():
        with TemporaryDirectory() as scratch:
            recorded = (of_simulator if name in PRESETS else of_independent)(name, seed, Path(scratch))
        side, valid = Side("endoscope", recorded.panorama), recorded.panorama.valid
        cells = segment_side(side, SegmentParameters(), "dark").mask & valid
        relief_mm = np.minimum(recorded.relief_mm, np.float32(DEEPEST_MM))
        keep(Bore(name, light_of(side, cells), recorded.cell & valid, relief_mm), path)
    return path.name


def light_of(side: Side, cells: Mask) -> Light:
    """Return what tells the depth of ``cells``."""
    nowhere = np.full(cells.shape, np.nan, np.float32)
    parallax = (nowhere, nowhere) if side.parallax is None else (side.parallax.relief_mm, side.parallax.error_mm)
    return ((side.grid.dz_mm, side.grid.dtheta_mm), cells, side.contrast("dark").values, *parallax)


def kept(folder: Path) -> Iterator[Bore]:
    """Yield the bores in a folder."""
    for path in sorted(folder.glob("*.pkl")):
        yield pickle.loads(path.read_bytes())


def train(folder: Path, into: Path) -> None:
    """Train the network on the bores in ``folder``, and write its weights beside others."""
    rng = np.random.default_rng(0)
    samples = []
    for bore in kept(folder):
        of_cells = light_features(*bore.light)
        some = rng.integers(0, of_cells.shape[1], SAMPLES_A_BORE)
        samples.append((of_cells[:, some], bore.relief_mm[bore.light[1]][some][None]))
    save_networks({"light": fitted(samples, WIDTH, 2)}, into)


def judged(bore: Bore) -> dict[str, float]:
    """Return how far depths are off in true cells, where what is not known counts as the wall, and how errors hold."""
    depth_mm, error_mm = depth_by_light(*bore.light)
    parallax_mm, cell = bore.light[3], bore.cell
    row = {
        f"{name}, median µm": 1e3 * float(np.median(np.abs(np.nan_to_num(of) - bore.relief_mm)[cell]))
        for name, of in (("light", depth_mm), ("parallax", parallax_mm))
    }
    right = cell & np.isfinite(depth_mm)
    off_mm = depth_mm - bore.relief_mm
    for low, high in ((0.0, 9.0), *DEPTHS_MM):
        part = right & (bore.relief_mm > low) & (bore.relief_mm <= high)
        if part.sum() > 500:
            within = np.abs(off_mm[part]) / error_mm[part]
            row |= {f"{low:g}–{high:g}: within {k}": float((within <= k).mean()) for k in (1, 2)}
            row[f"{low:g}–{high:g}: bias µm"] = 1e3 * float(np.median(off_mm[part]))
            row[f"{low:g}–{high:g}: mean µm"] = 1e3 * float(np.abs(off_mm[part]).mean())
    return row | of_whole_cells(bore, depth_mm, error_mm)


def of_whole_cells(bore: Bore, depth_mm: Image, error_mm: Image) -> dict[str, float]:
    """Return how far the median depths of true cells are off, as in ``cells.csv``, and how their errors hold."""
    labels, n = label(bore.light[1])
    known = np.isfinite(depth_mm)
    depth, error, true, is_cell = (
        quantiles(of[known], labels[known], n, 0.5)[1:]
        for of in (depth_mm, error_mm, bore.relief_mm, bore.cell.astype(np.float32))
    )
    off_mm, error = np.abs(depth - true)[is_cell == 1], error[is_cell == 1]
    if not off_mm.size:
        return {}
    row = {f"whole cells: within {k}": float((off_mm <= k * error).mean()) for k in (1, 2)}
    return row | {"whole cells": float(off_mm.size), "whole cells: median µm": 1e3 * float(np.median(off_mm))}


def compared(specimen: Path) -> dict[str, float]:
    """Return of how many cells an endoscope has a depth by parallax and by light, and how far that is from OCT's.

    Depths are medians over a cell, of both sides over the endoscope's.
    """
    placed = place_sides(*two_sides(unroll(specimen / "endoscope"), unroll(specimen / "oct")), CompareParameters())
    shown, (light, depth) = both_sides_of(placed), placed.sides
    if shown is None:
        return {"not aligned": 1.0}
    parallax = replace(light, relief_mm=shown.parallax_mm, relief_error_mm=shown.parallax_error_mm)
    row = {}
    for name, side in (("parallax", parallax), ("light", light)):
        cells = [cell for cell in measure(side, depth, placed.grid, aligned=True) if cell.side == light.name]
        known = [cell for cell in cells if cell.own_depth_mm is not None]
        off_um = [1e3 * abs(c.own_depth_mm - c.depth_median_mm) for c in known if c.depth_of == depth.name]
        row |= {"cells": float(len(cells)), f"{name}: cells": float(len(known))}
        row |= {f"{name}: from OCT, µm": float(np.median(off_um))} if off_um else {}
    return row


def table(rows: Sequence[tuple[str, dict[str, float]]]) -> Iterator[str]:
    """Yield, by set, the medians over bores of all figures, with their least and greatest."""
    for name in dict.fromkeys(of for of, _ in rows):
        mine = [row for of, row in rows if of == name]
        yield f"{name}: {len(mine)}"
        for key in dict.fromkeys(key for row in mine for key in row):
            values: NDArray[np.float64] = np.array([row[key] for row in mine if key in row])
            yield f"    {key}: {np.median(values):.3g} ({values.min():.3g} to {values.max():.3g}; {values.mean():.3g})"


def main() -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    parser = argparse.ArgumentParser(prog="python -m benchmarks.light_alone", description=__doc__)
    parser.add_argument("act", choices=("make", "train", "judge", "compare"))
    parser.add_argument("given", nargs="*", help="sets of bores, or folders of specimens")
    parser.add_argument("--bores", type=Path)
    parser.add_argument("--into", type=Path, default=Path("fusion/evidence/networks.safetensors"))
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.act == "train":
        train(options.bores, options.into)
    elif options.act == "judge":
        print("\n".join(table([(bore.name, judged(bore)) for bore in kept(options.bores)])))
    elif options.act == "compare":
        with ProcessPoolExecutor(options.workers) as pool:
            rows = pool.map(compared, map(Path, options.given))
            print("\n".join(table([("all", row) for row in rows])))
    else:
        options.into.mkdir(exist_ok=True)
        with ProcessPoolExecutor(options.workers) as pool:
            for name in pool.map(partial(made, options.into), seeds_of(options.given)):
                print(name, flush=True)


if __name__ == "__main__":
    main()
