"""How close `endoct compare` comes to the truth of simulated specimens.

    python benchmarks/accuracy.py --seeds 1000-1009 [--preset quick] [--literal] [--csv FILE] [--keep DIR]

Seeds 0–99 are for tuning, from 1000 on for reporting. A row a specimen, then medians.
:func:`endoct.workbench.bench.truth.held_against` says what the columns mean.
"""

import argparse
import csv
import json
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from endoct.fusion.cells import SegmentParameters
from endoct.stitching.store import load_panorama
from endoct.workbench import compare, simulate
from endoct.workbench.bench.truth import held_against, load_truth

EVEN_TURNS = {f"correct_{step}": False for step in ("rotation", "turn_length", "start_angle", "lost_ascans")}
LITERAL = {"undistort": "sine", "wall": "maximum", **EVEN_TURNS}


def evaluate(specimen: Path, work: Path, literal: bool) -> dict[str, float | str]:
    """Compare the specimen's recordings and hold the result against its truth."""
    settings = LITERAL if literal else {}
    comparison = compare(specimen / "endoscope", specimen / "oct", work, settings_b=settings, overwrite=True)
    endoscope, oct_ = (load_panorama(work / "panoramas" / f"{name}.zarr") for name in ("endoscope", "oct"))
    seconds = json.loads((work / "result.json").read_text())["seconds"]
    found = held_against(load_truth(specimen), endoscope, oct_, comparison, SegmentParameters())
    return {"specimen": specimen.name, **found, "seconds": sum(seconds.values())}


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
