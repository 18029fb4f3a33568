"""What `endoct bench` came to on the specimens of a published set, by generator and side, as lines of a table.

    python -m benchmarks.published -o FULL --full --workers 2
    endoct bench wall -o RESULTS/wall --data FULL/s*[13579] --methods endoct,union          # and the other tasks
    python -m benchmarks.full_set RESULTS/wall …

Odd numbers are the test split, and what begins with "s" has no CT. Methods run within one process here, on the set as
it lies: that is no submission. A rival leads in a case where it alone succeeds or, where both or neither do, its main
score is better. p is of the sign test.
"""

import csv
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from endoct.workbench.bench.published.definition import ScoredTask, load_definition
from endoct.workbench.bench.published.submitted import OURS

SET = "endoct-bench-2"
Scores = Mapping[str, tuple[bool, float]]
"""By case, whether a method succeeds, and its main score, NaN where it has none."""


def lines(results: Path) -> Iterator[str]:
    """Yield, for each generator and side of the results of a task, endoct's line and those of its rivals."""
    task = load_definition(SET).tasks[results.name]
    with (results / "results.csv").open(encoding="utf-8") as file:
        rows = [*csv.DictReader(file)]
    for group in dict.fromkeys(_group(row["case"], results.name) for row in rows):
        scores: dict[str, dict[str, tuple[bool, float]]] = {}
        for row in rows:
            if _group(row["case"], results.name) == group:
                score = float(row[f"score.{task.score}"] or "nan") if row["status"] == "ok" else math.nan
                success = row["status"] == "ok" and float(row["score.success"] or 0) > 0.5
                scores.setdefault(row["method"], {})[row["case"]] = success, score
        ours = scores.pop(OURS)
        rivals = "; ".join(f"`{name}` {spread(of, task)}, {against(ours, of, task)}" for name, of in scores.items())
        yield f"| `{results.name}`, {task.score} | {', '.join(group)} | {spread(ours, task)} | {rivals} |"


def _group(case: str, task: str) -> Sequence[str]:
    specimen, *case_of = case.removeprefix("pose-").split("/")
    return (specimen.split("-")[0], *(case_of[:1] if task == "segmentation" else ()))


def spread(scores: Scores, task: ScoredTask) -> str:
    """Return how often a method succeeds, its median, its worst and best, and its mean over what it answered."""
    known = np.array([score for _, score in scores.values() if math.isfinite(score)])
    won = sum(success for success, _ in scores.values())
    if not known.size:
        return f"{won} of {len(scores)}"
    worst, best = (known.min(), known.max()) if task.better == "higher" else (known.max(), known.min())
    return f"{won} of {len(scores)}, {np.median(known):.3g} ({worst:.3g}–{best:.3g}; {known.mean():.3g})"


def against(ours: Scores, theirs: Scores, task: ScoredTask) -> str:
    """Return in how many cases a rival leads, in how many endoct does, and how likely chance comes to as much."""
    sign = 1 if task.better == "higher" else -1
    leads = [0, 0]
    for case, (success, score) in theirs.items():
        won, own = ours[case]
        lead = float(success) - float(won) or (sign * (score - own) if math.isfinite(score + own) else 0.0)
        if lead:
            leads[lead < 0] += 1
    p = binomtest(leads[0], sum(leads)).pvalue if sum(leads) else 1.0
    return f"ahead in {leads[0]}, behind in {leads[1]}, p = {p:.2g}"


if __name__ == "__main__":
    for folder in sys.argv[1:]:
        print("\n".join(lines(Path(folder))))
