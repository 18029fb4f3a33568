"""How well poses are found in bone, recordings and CTs of another origin than our simulator's.

    python -m benchmarks.second_origin found --sparse 2200:2214 --real LT143_256 RT147_256 --of 2200:2208
    python -m benchmarks.second_origin impossible --real LT143_256 RT147_256 --of 2200:2205

``--sparse``, ``--made``: seeds of bores in bone of ellipsoids, in the former on a third of the bore only. ``--real``:
folders of slices of a segmented bone, bone where the last channel is not 0 (LCSR-SICKKIDS/volumetric_drilling,
``resources/volumes``), and ``--of``: seeds of the bores in each. A row a case and a choice of sides; 35 s of one core
a bore, 40 s more for impossible pairs.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
import torch

from benchmarks.pose import Row, impossible, judged
from benchmarks.second_origin.bores import BoneBore, made, real
from endoct.workbench.bench.cases.bores import PoseCase


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=("found", "impossible"))
    parser.add_argument("--sparse", type=_seeds, default=range(0))
    parser.add_argument("--made", type=_seeds, default=range(0))
    parser.add_argument("--real", type=Path, nargs="*", default=())
    parser.add_argument("--of", type=_seeds, default=range(0))
    parser.add_argument("--csv", type=Path)
    given = parser.parse_args()
    torch.set_num_threads(1)
    cases = (_case(bore) for bore in _bores(given))
    rows: list[Row] = []
    found = impossible(list(cases)) if given.kind == "impossible" else _judged(cases)
    for row in found:
        rows.append(row)
        words = [f"{key}={value:.4g}" if isinstance(value, float) else f"{key}={value}" for key, value in row.items()]
        print(*words, flush=True)
        if given.csv:
            pd.DataFrame(rows).to_csv(given.csv, index=False)


def _bores(given: argparse.Namespace) -> Iterator[BoneBore]:
    yield from (made(seed, sparse=True) for seed in given.sparse)
    yield from (made(seed, sparse=False) for seed in given.made)
    yield from (real(folder, seed) for folder in given.real for seed in given.of)


def _case(bore: BoneBore) -> PoseCase:
    with TemporaryDirectory() as scratch:
        return bore.case(Path(scratch) / "pair")


def _judged(cases: Iterator[PoseCase]) -> Iterator[Row]:
    for case in cases:
        yield from judged(case, {"case": case.name})


def _seeds(text: str) -> range:
    first, last = text.split(":")
    return range(int(first), int(last))


if __name__ == "__main__":
    main()
