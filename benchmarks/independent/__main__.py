"""Make a set of pairs, compare them, judge them.

    python -m benchmarks.independent --set few --count 20 [--seed 0] [--oct] [-o DIR] [--workers 2]

Prints a line for each pair and what it comes to; with --oct of the pullbacks alone; with -o writes SET.csv there.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import pandas as pd

from benchmarks.independent.run import judged, judged_oct
from benchmarks.independent.sets import SETS
from benchmarks.independent.table import line, summary


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.independent", description=__doc__)
    parser.add_argument("--set", choices=SETS, default="few")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--oct", action="store_true", help="the pullbacks alone")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    seeds = range(options.seed, options.seed + options.count)
    rows = []
    with ProcessPoolExecutor(options.workers) as pool:
        for of_pair in pool.map(partial(judged_oct if options.oct else judged, options.set), seeds):
            for row in of_pair:
                rows.append(row)
                print(line(row), flush=True)
    table = pd.DataFrame(rows)
    print(summary(table))
    if options.output:
        options.output.mkdir(parents=True, exist_ok=True)
        table.to_csv(options.output / f"{options.set}.csv", index=False)


if __name__ == "__main__":
    main()
