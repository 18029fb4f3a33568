"""How well poses are found in bone, recordings and CTs of another origin than our simulator's.

    python -m benchmarks.second_origin found --sparse 2300:2320 --made 2300:2340 --csv found.csv
    python -m benchmarks.second_origin impossible --real LT143_256 RT147_256 --of 2300:2305
    python -m benchmarks.second_origin rivals --real LT143_256 RT147_256 --of 2300:2310
    python -m benchmarks.second_origin table --csv found.csv

``--sparse``, ``--made``: seeds of bores in bone of ellipsoids, in the former on a third of the bore only. ``--real``:
folders of slices of a segmented bone, bone where the last channel is not 0 (LCSR-SICKKIDS/volumetric_drilling,
``resources/volumes``), and ``--of``: seeds of the bores in each. Kinds take turns: one sparse, two made, one real. A
row a case and a choice of sides; 35 s of one core a bore, 40 s more for impossible pairs. ``rivals``: existing
libraries, by OCT. ``table``: of rows that ``found`` wrote.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
import torch

from benchmarks.pose import Row, impossible, judged
from benchmarks.second_origin.bores import BoneBore, made, real
from benchmarks.second_origin.volumes import simpleitk_matching
from endoct.workbench.bench.cases.bores import PoseCase
from endoct.workbench.bench.rivals.pose import matched_by, open3d, small_gicp
from endoct.workbench.bench.task import Declined
from endoct.workbench.bench.tasks.pose import judge

RIVALS = {"small-gicp": small_gicp, "open3d": open3d, "simpleitk": matched_by(simpleitk_matching)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=("found", "impossible", "rivals", "table"))
    parser.add_argument("--sparse", type=_seeds, default=range(0))
    parser.add_argument("--made", type=_seeds, default=range(0))
    parser.add_argument("--real", type=Path, nargs="*", default=())
    parser.add_argument("--of", type=_seeds, default=range(0))
    parser.add_argument("--csv", type=Path)
    given = parser.parse_args()
    if given.kind == "table":
        print(table(pd.read_csv(given.csv)).to_string())
        return
    torch.set_num_threads(1)
    cases = (_case(bore) for bore in _bores(given))
    rows: list[Row] = []
    kinds = {"found": _judged, "rivals": _by_rivals, "impossible": lambda some: impossible(list(some))}
    for row in kinds[given.kind](cases):
        rows.append(row)
        words = [f"{key}={value:.4g}" if isinstance(value, float) else f"{key}={value}" for key, value in row.items()]
        print(*words, flush=True)
        if given.csv:
            pd.DataFrame(rows).to_csv(given.csv, index=False)


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return errors of the target, mm, and what held, by kind of bone and sides, of what was told."""
    bone = rows["case"].str.partition("-")[0]
    groups = {(kind, sides): of for (kind, sides), of in rows.groupby([bone, "sides"])}
    return pd.DataFrame({group: _line(of) for group, of in groups.items()}).T


def _line(rows: pd.DataFrame) -> pd.Series:
    told = rows[rows["told"]]
    error = told["target_mm"]
    return pd.Series(
        {
            "told": f"{len(told)} of {len(rows)}",
            **{name: f"{error.quantile(q):.3f}" for name, q in (("median", 0.5), ("90th", 0.9), ("95th", 0.95))},
            "worst": f"{error.max():.3f}",
            "mean": f"{error.mean():.3f}",
            "worst undoubted": f"{error[told['doubts'] == 0].max():.3f}",
            "ellipses hold": f"{told['inside_95'].sum():.0f}",
            "chi square": f"{told['chi_square'].mean():.2f} (median {told['chi_square'].median():.2f})",
            "depth holds": f"{told['depth_inside_95'].sum():.0f} of {told['depth_ends'].sum():.0f}",
        }
    )


def _bores(given: argparse.Namespace) -> Iterator[BoneBore]:
    sparse = (made(seed, sparse=True) for seed in given.sparse)
    plain = (made(seed, sparse=False) for seed in given.made)
    in_bone = (real(folder, seed) for seed in given.of for folder in given.real)
    for turn in zip_longest(sparse, plain, plain, in_bone):
        yield from (bore for bore in turn if bore is not None)


def _case(bore: BoneBore) -> PoseCase:
    with TemporaryDirectory() as scratch:
        return bore.case(Path(scratch) / "pair")


def _judged(cases: Iterator[PoseCase]) -> Iterator[Row]:
    for case in cases:
        yield from judged(case, {"case": case.name})


def _by_rivals(cases: Iterator[PoseCase]) -> Iterator[Row]:
    for case in cases:
        (oct_, _), ct, plan = case.given
        alone = replace(case, given=((oct_,), ct, plan), truth=replace(case.truth, sides=case.truth.sides[:1]))
        for name, rival in RIVALS.items():
            about: Row = {"case": case.name, "sides": "oct", "method": name}
            try:
                yield {**about, "told": True, **judge(alone, rival(*alone.given))}
            except Declined as declined:
                yield {**about, "told": False, "reason": str(declined)}


def _seeds(text: str) -> range:
    first, last = text.split(":")
    return range(int(first), int(last))


if __name__ == "__main__":
    main()
