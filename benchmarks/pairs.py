"""Both panoramas of a fresh bore, of a preset of the simulator or a set of the other generator, with the truth."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.independent.judge import Wall, measured_place
from benchmarks.independent.pair import make_pair, write_pair
from benchmarks.independent.sets import recipe_of
from benchmarks.independent.truth import between
from endoct.base.arrays import Image, Mask
from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.panorama import Panorama
from endoct.synthetic.sample.presets import PRESETS
from endoct.workbench import simulate, unroll
from endoct.workbench.pipeline.truth import TrueMap, load_truth, true_cells, true_pose, true_relief


@dataclass(frozen=True, eq=False)
class RecordedPair:
    """An endoscope's panorama ``a`` and an OCT's ``b``, where ``b`` truly lies on ``a``, and the wall on ``a``."""

    a: Panorama
    b: Panorama
    lies: Alignment
    cell: Mask
    relief_mm: Image


def seeds_of(sets: Iterable[str]) -> list[tuple[str, int]]:
    """Return the sets and seeds of texts such as "sound:9300:9303", the first seed and the one after the last."""
    parts = (text.split(":") for text in sets)
    return [(name, seed) for name, first, last in parts for seed in range(int(first), int(last))]


def recorded(name: str, seed: int) -> RecordedPair:
    """Make a specimen and unroll both of its recordings."""
    with TemporaryDirectory() as scratch:
        folder = Path(scratch) / "specimen"
        if name in PRESETS:
            simulate(folder, preset=name, seed=seed, progress=False)  # type: ignore[arg-type]
        else:
            pair = make_pair(recipe_of(name, seed), seed)
            write_pair(pair, folder)
        a, b = (unroll(folder / side, progress=False) for side in ("endoscope", "oct"))
        if name in PRESETS:
            truth = load_truth(folder)
            pose = true_pose(a, truth)
            lies = TrueMap(a.z_mm, pose, true_pose(b, truth)).alignment(b.z_mm)
            return RecordedPair(a, b, lies, true_cells(truth, pose, a), true_relief(truth, pose, a))
    grid = a.grid
    wall = Wall(a.intensity, np.zeros(grid.shape, np.bool_), a.valid, grid.z_mm, grid.theta_rad)
    place, _ = measured_place(pair.bore, wall, pair.endoscope_place)
    on_a = between(place, pair.oct_place)
    lies = Alignment(on_a.theta_rad, on_a.z_mm, on_a.scale, on_a.mirrored, on_a.reversed)
    theta, z = np.broadcast_arrays(*place.to_bore(grid.theta_rad[None, :], grid.z_mm[:, None]))
    relief_mm = np.asarray(pair.bore.at(pair.bore.relief_mm, theta, z), np.float32)
    return RecordedPair(a, b, lies, pair.bore.is_cell(theta, z), relief_mm)
