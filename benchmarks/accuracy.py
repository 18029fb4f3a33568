"""How close a comparison comes to the truth of simulated specimens.

    python benchmarks/accuracy.py --seeds 1000-1029 [--preset quick] [--method main|literal] [--csv FILE]

Cases, methods and scores are those of the task "ablate" of `endoct bench`, with the parts of the agreement budget, of
1 − Jaccard on the grid, in addition (``lost_…``). Seeds 0–99 are for tuning, from 1000 on for reporting. A row a
specimen, then for each score the median with its 95 % interval, bootstrapped over specimens.
:func:`endoct.workbench.pipeline.truth.held_against` says what the scores mean.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.stats import bootstrap

from endoct.workbench.bench.results.result_tables import write_csv
from endoct.workbench.bench.results.score_summary import SCORE, columns_of, frame_of
from endoct.workbench.bench.runner import MethodResult, parse_seeds, run_method
from endoct.workbench.bench.tasks import ablate
from endoct.workbench.bench.tasks.comparison import ComparedPair, ComparisonCase, judge
from endoct.workbench.running.scheduler import one_blas_thread


def judge_with_budget(case: ComparisonCase, answer: ComparedPair) -> Mapping[str, float]:
    """Return the scores of the task, and the parts of the budget that are known."""
    budget = answer.comparison.result.budget
    parts = budget.parts.by_cause() if budget else {}
    return {**judge(case, answer), **{f"lost_{cause}": part.share for cause, part in parts.items()}}


@one_blas_thread()
def evaluate(seed: int, preset: str, method: str) -> MethodResult:
    """Simulate a specimen, and compare its recordings."""
    task = replace(ablate.TASK, judge=judge_with_budget)
    case = task.cases(seed, 0, {"preset": (preset,)})
    try:
        return run_method(task, method, case)
    finally:
        if case.scratch is not None:
            case.scratch.cleanup()


def summary(rows: Sequence[MethodResult]) -> list[str]:
    """Return a line a score: median, its interval, extremes."""
    frame = frame_of(rows)
    lines = []
    for name in columns_of(frame, SCORE):
        values = frame[name].dropna().to_numpy()
        low, high = values.min(), values.max()
        if values.size > 1 and low < high:
            interval = bootstrap((values,), np.median, method="percentile", rng=np.random.default_rng(0))
            low, high = interval.confidence_interval
        lines.append(
            f"{name.removeprefix(SCORE):18s} median {np.median(values):.3f} ({low:.3f} to {high:.3f})  "
            f"min {values.min():.3f}  max {values.max():.3f}  n {values.size}"
        )
    return lines


def main() -> None:
    """Evaluate the seeds asked for and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--method", default=ablate.MAIN, choices=list(ablate.STEPS), help="a method of the task")
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    rows: list[MethodResult] = []
    with ProcessPoolExecutor(arguments.workers) as pool:
        work = partial(evaluate, preset=arguments.preset, method=arguments.method)
        for row in pool.map(work, parse_seeds(arguments.seeds)):
            rows.append(row)
            scores = "  ".join(f"{name}={value:.3f}" for name, value in row.scores.items())
            print(f"{row.case}  {row.status}  {scores}  {row.reason}", flush=True)
    print("\n".join(summary(rows)))
    if arguments.csv:
        write_csv(rows, ablate.TASK, arguments.csv)


if __name__ == "__main__":
    sys.exit(main())
