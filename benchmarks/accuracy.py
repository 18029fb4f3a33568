"""How close a comparison comes to the truth of simulated specimens.

    python benchmarks/accuracy.py --seeds 1000-1029 [--preset quick] [--literal] [--keep DIR] [--cache DIR] [--csv FILE]

Seeds 0–99 are for tuning, from 1000 on for reporting. Both recordings are unrolled and compared as `endoct compare`
does it, without its report. A row a specimen, then for each column the median with its 95 % interval, bootstrapped over
specimens. :func:`endoct.workbench.pipeline.truth.held_against` says what the columns mean; ``lost_…`` are the parts of
the agreement budget, of 1 − Jaccard on the grid.
"""

import argparse
import csv
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from panoramas import both_unrolled, unrolled
from scipy.stats import bootstrap

from endoct.fusion.comparison import compare_panoramas
from endoct.fusion.segmentation.segment import SegmentParameters
from endoct.stitching.errors import EndoctError
from endoct.workbench import simulate
from endoct.workbench.pipeline.truth import held_against, load_truth
from endoct.workbench.running.threads import one_blas_thread

EVEN_TURNS = {f"correct_{step}": False for step in ("rotation", "turn_length", "start_angle", "lost_ascans")}
LITERAL = {"undistort": "sine", "wall": "maximum", **EVEN_TURNS}

Row = dict[str, float | str]


@one_blas_thread()
def evaluate(seed: int, preset: str, folder: Path, cache: Path, literal: bool) -> Row:
    """Compare a specimen's recordings and hold the result against its truth. Cannot be unrolled: ``aligned`` 0."""
    specimen, variant = folder / f"{preset}-{seed}", "literal" * literal
    if not specimen.exists():
        simulate(specimen, preset=preset, seed=seed)
    both_unrolled(specimen, cache, variant, LITERAL if literal else None)
    try:
        endoscope, oct_ = unrolled(specimen, "endoscope", cache), unrolled(specimen, "oct", cache, variant)
    except EndoctError as error:
        return {"specimen": specimen.name, "aligned": 0.0, "reason": str(error)}
    comparison = compare_panoramas(endoscope, oct_)
    row: Row = {"specimen": specimen.name}
    row |= held_against(load_truth(specimen), endoscope, oct_, comparison, SegmentParameters())
    budget = comparison.result.budget
    return row | {f"lost_{cause}": part.share for cause, part in (budget.parts.by_cause() if budget else {}).items()}


def summary(rows: Sequence[Row]) -> list[str]:
    """Return a line a column: median, its interval, extremes."""
    said = []
    for key in dict.fromkeys(k for row in rows for k, v in row.items() if isinstance(v, float)):
        values = np.array([row[key] for row in rows if key in row], dtype=float)
        low, high = values.min(), values.max()
        if values.size > 1 and low < high:
            found = bootstrap((values,), np.median, method="percentile", rng=np.random.default_rng(0))
            low, high = found.confidence_interval
        said.append(
            f"{key:18s} median {np.median(values):.3f} ({low:.3f} to {high:.3f})  min {values.min():.3f}  "
            f"max {values.max():.3f}  n {values.size}"
        )
    return said


def main() -> None:
    """Evaluate the seeds asked for and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--literal", action="store_true", help="the paper's chain taken literally for the OCT")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--keep", type=Path, help="keep specimens here, PRESET-SEED, and reuse them")
    parser.add_argument("--cache", type=Path, help="keep panoramas here, and reuse them")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("-")
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch, ProcessPoolExecutor(arguments.workers) as pool:
        work = partial(
            evaluate,
            preset=arguments.preset,
            folder=arguments.keep or Path(scratch),
            cache=arguments.cache or Path(scratch) / "panoramas",
            literal=arguments.literal,
        )
        for row in pool.map(work, range(int(first), int(last or first) + 1)):
            rows.append(row)
            print("  ".join(f"{k}={v:.3f}" if isinstance(v, float) else f"{k}={v}" for k, v in row.items()), flush=True)
    print("\n".join(summary(rows)))
    if arguments.csv:
        with arguments.csv.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, sorted({k for row in rows for k in row}))
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    sys.exit(main())
