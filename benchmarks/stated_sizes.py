"""Sidecars that contradict their pullback, on independent recordings: which are refused or doubted, and by what.

    python -m benchmarks.stated_sizes [--first 100] [--count 40] [--slices 24] [--workers 2]

Every seed is unrolled with its true sidecar, with a capillary 5 % too wide, and with three of the other faults in turn.
`in_water`: bore and capillary filled, and the index of water stated that many times too large.
"""

import argparse
import json
import os
import tempfile
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import tifffile

from benchmarks.independent.bore import drill
from benchmarks.independent.catheter import pull_back
from benchmarks.independent.pair import oct_sidecar
from benchmarks.independent.recipe import CatheterRecipe
from benchmarks.independent.sets import recipe_of
from endoct.base.errors import NotSeen
from endoct.workbench import unroll

FAULTS = (
    ("capillary_outer_diameter_mm", 0.53),
    ("capillary_outer_diameter_mm", 0.95),
    ("capillary_outer_diameter_mm", 1.1),
    ("axial_pixel_mm", 0.8),
    ("axial_pixel_mm", 0.9),
    ("axial_pixel_mm", 0.95),
    ("axial_pixel_mm", 1.05),
    ("axial_pixel_mm", 1.1),
    ("axial_pixel_mm", 1.2),
    ("medium_index", 1.05),
    ("medium_index", 1.1),
    ("medium_index", 1.25),
    ("in_water", 1.0 / 1.33),
    ("in_water", 0.9),
    ("in_water", 0.95),
    ("in_water", 1.0),
    ("in_water", 1.05),
    ("in_water", 1.1),
    ("bore_diameter_mm", 1.04),
    ("no_catheter", 1.0),
)
WATER = 1.33
TOO_WIDE = ("capillary_outer_diameter_mm", 1.05)
SOUND = ("sound", 1.0)
Fault = tuple[str, float]


def answers(seed: int, slices: int) -> list[tuple[Fault, str]]:
    """Return what becomes of one bore's pullback under each fault."""
    recipe = recipe_of("sound", seed)
    bore = drill(recipe.bore, np.random.default_rng([seed, 0]))
    said = []
    with tempfile.TemporaryDirectory() as scratch:
        for fault in (SOUND, TOO_WIDE, *(FAULTS[(3 * seed + k) % len(FAULTS)] for k in range(3))):
            made = replace(recipe.oct, slices=slices, fault="no_catheter" if fault[0] == "no_catheter" else None)
            if fault[0] == "in_water":
                made = in_water(made)
            path = Path(scratch) / (fault[0] if fault[0] in ("no_catheter", "in_water") else "sound") / "pullback.tif"
            if not path.exists():
                path.parent.mkdir()
                samples = pull_back(bore, made, np.random.default_rng([seed, 1])).samples
                tifffile.imwrite(path, samples, photometric="minisblack")
            keys = oct_sidecar(recipe.oct, recipe.bore.diameter_mm) | {"medium_index": 1.0}
            if fault[0] == "in_water":
                keys["medium_index"] = WATER * fault[1]
            keys |= {fault[0]: float(keys[fault[0]]) * fault[1]} if fault[0] in keys else {}  # type: ignore[arg-type]
            (path.parent / "acquisition.toml").write_text("".join(f"{k} = {json.dumps(v)}\n" for k, v in keys.items()))
            said.append((fault, _answer(path.parent)))
    return said


def in_water(recipe: CatheterRecipe) -> CatheterRecipe:
    """Return the pullback of a flushed bore: a pixel is shorter there, and glass bends less."""
    return replace(recipe, axial_pixel_mm=recipe.axial_pixel_mm / WATER, glass_index=recipe.glass_index / WATER)


def _answer(recording: Path) -> str:
    try:
        panorama = unroll(recording, progress=False)
    except NotSeen:
        return "refused"
    return " + ".join(doubt.code for doubt in panorama.doubts) or "believed"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stated_sizes", description=__doc__)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--slices", type=int, default=24)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    table: dict[Fault, dict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
    seeds = range(options.first, options.first + options.count)
    with ProcessPoolExecutor(options.workers) as pool:
        for seed, said in zip(seeds, pool.map(partial(answers, slices=options.slices), seeds), strict=True):
            for fault, answer in said:
                table[fault][answer].append(seed)
                print(seed, *fault, answer, flush=True)
    for fault, by_answer in sorted(table.items()):
        counts = ", ".join(f"{len(of)} {answer}" for answer, of in sorted(by_answer.items()))
        print(f"{fault[0]} × {fault[1]:.3g}: {counts}; believed: {by_answer.get('believed', []) or 'none'}")


if __name__ == "__main__":
    main()
