"""How far off the cells of a specimen are, as a comparison bounds it, held against the truth.

    python -m benchmarks.bounds make quick:9600:9612 sound:9600:9612 … --into FOLDER [--workers 2]
    python -m benchmarks.bounds pack --specimens FOLDER      into fusion/wall/bounds.json, what endoct calibrates by
    python -m benchmarks.bounds judge --specimens OTHER [--by FOLDER] [--sets quick hard mastoid]
    python -m benchmarks.bounds drawn --specimens FOLDER [--known 9]

``make`` compares both sides of each specimen as `endoct compare` does, and keeps what is expected of it with the truth:
about 15 s of one core each. ``judge`` says how often bounds hold, how wide they are beside constant ones, how unlike
specimens are told, and how expected and true figures rank. It calibrates by what endoct brings along, or by --by, and
of that by --sets alone. ``drawn`` has simulated raters draw a few specimens of a set, bounds up to twenty others of it
by their drawings, and does so again for many random choices.
"""

import argparse
import json
import os
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from benchmarks.pairs import recorded, seeds_of
from endoct.base.arrays import Coordinates, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import gaussian
from endoct.base.numeric.distance import signed_distance
from endoct.base.numeric.regions import label
from endoct.fusion.comparison import place_sides, score_placed
from endoct.fusion.evidence.side import two_sides
from endoct.fusion.geometry.placement import IN_PLACE, Placement
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.result import Bounds
from endoct.fusion.scoring.overlap import jaccard
from endoct.fusion.wall.bounds import (
    FIGURES,
    LEVEL,
    ORDER,
    THRESHOLDS,
    Calibration,
    Known,
    bounded,
    expected_of,
    packaged,
    share_needed,
    shares_above,
    threshold_at,
)
from endoct.fusion.wall.cells import join
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

Row = dict[str, Any]
PACKAGED = Path("fusion/wall/bounds.json")
RATERS = {"careful": (0.0, 0.015, 0.02), "generous": (0.03, 0.03, 0.05), "sparing": (-0.03, 0.03, 0.05)}
"""How raters draw: outlines farther out by so many mm, unsteady by so many, and every other cell below so many mm²
missed."""
UNSTEADY_MM = 0.1
"""Over such a length a hand errs alike."""
CHOICES, JUDGED, FEWEST_JUDGED = 100, 20, 10


def row_of(a: Panorama, b: Panorama, cell: Mask, name: str, seed: int) -> Row:
    """Return what a comparison expects of a specimen, and what is true of it by ``cell`` on the samples of ``a``."""
    row: Row = {"set": name, "seed": seed}
    parameters = CompareParameters()
    try:
        placed = place_sides(*two_sides(a, b), parameters)
    except EndoctError as error:
        return row | {"without": str(error)}
    joined = join(placed)
    expected = None if joined is None else expected_of(placed, joined, score_placed(placed, parameters).result)
    if joined is None or expected is None:
        return row | {"without": "not aligned"}
    both = placed.sides[0].valid & placed.sides[1].valid
    true, _ = placed.samplings[0].onto(placed.grid).mask(cell, np.ones(cell.shape, np.bool_))
    of = {side.name: side.mask for side in placed.sides} | {"wall": joined.wall.cells}
    indices = FIGURES[:3]
    truth = {name: jaccard(of[getattr(expected, name).of] & both, true & both, both) or 0.0 for name in indices}
    truth["area_mm2"] = int(np.count_nonzero(true & both)) * placed.grid.dz_mm * placed.grid.dtheta_mm
    rng = np.random.default_rng([zlib.crc32(name.encode()), seed])
    known = both & np.isfinite(joined.wall.probability)
    probability = joined.wall.probability[known]
    stated, shown = (shares_above(probability, of) for of in (probability, true[known]))
    truth |= {name: share_needed(name, stated[name], shown[name]) for name in ORDER}
    onto, drawings = Placement.averaging(a.grid, IN_PLACE, placed.grid), {}
    for rater in RATERS:
        mask, seen = onto.mask(drawing(cell, a.grid, rater, rng), np.ones(cell.shape, np.bool_))
        by_name = {side.name: jaccard(side.mask, mask, side.valid & seen) or 0.0 for side in placed.sides}
        drawings[rater] = {figure: by_name[getattr(expected, figure).of] for figure in FIGURES[:2]}
    return row | {
        "expected": expected.model_dump(exclude_unset=True),
        "truth": truth,
        "drawn": drawings,
        "shares": {name: of.tolist() for name, of in stated.items()},
    }


def drawing(cell: Mask, grid: SurfaceGrid, rater: str, rng: np.random.Generator) -> Mask:
    """Return the true ``cell`` on ``grid`` as one of :data:`RATERS` draws it."""
    farther_mm, unsteady_mm, missed_mm2 = RATERS[rater]
    labels, n = label(cell)
    area_mm2 = np.bincount(labels.ravel(), minlength=n + 1) * grid.dz_mm * grid.dtheta_mm
    missed = (area_mm2 < missed_mm2) & (rng.random(n + 1) < 0.5)
    inside_mm = signed_distance(cell & ~missed[labels], (grid.dz_mm, grid.dtheta_mm), 0.5)
    noise = gaussian(
        rng.standard_normal(cell.shape).astype(np.float32), UNSTEADY_MM / grid.dz_mm, UNSTEADY_MM / grid.dtheta_mm
    )
    return inside_mm + farther_mm + noise * (unsteady_mm / noise.std()) > 0


def made(into: Path, case: tuple[str, int]) -> str:
    """Make, compare and keep a specimen; say how that ended."""
    path = into / f"{case[0]}-{case[1]}.json"
    if not path.exists():
        pair = recorded(*case)
        path.write_text(json.dumps(row_of(pair.a, pair.b, pair.cell, *case)))
    row = json.loads(path.read_text())
    return f"{path.stem}: {row.get('without') or row['truth']}"


def kept(folder: Path) -> list[Row]:
    """Return the specimens in ``folder`` that were aligned."""
    rows = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
    return [row for row in rows if "without" not in row]


def known_of(rows: Sequence[Row]) -> list[Known]:
    """Return kept specimens as bounds know them."""
    return [Known(Bounds.model_validate(row["expected"]), row["truth"]) for row in rows]


def _short(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _short(inner) for key, inner in value.items()}
    return float(f"{value:.4g}") if isinstance(value, float) else value


def pack(folder: Path, into: Path) -> None:
    """Write the specimens in ``folder`` as what comparisons are calibrated by."""
    rows = [{key: row[key] for key in ("set", "seed", "expected", "truth")} for row in kept(folder)]
    by = "simulated specimens of two generators"
    lines = ",\n".join(json.dumps(_short(row)) for row in rows)
    into.write_text(f'{{"by": {json.dumps(by)}, "made": "{date.today()}", "specimens": [\n{lines}\n]}}\n')


def table(rows: Sequence[Row], by: Calibration) -> Iterator[str]:
    """Yield by figure and set how often bounds hold where they are promised, and their width over that of constants."""
    found = [bounded(known.expected, by) for known in known_of(rows)]
    alike = np.array([each.light.low is not None for each in found])
    sets = np.array([row["set"] for row in rows])
    parts = {name: sets == name for name in dict.fromkeys(sets.tolist())}
    told = ", ".join(f"{name} {(part & ~alike).sum()} of {part.sum()}" for name, part in parts.items())
    yield f"{len(rows)} specimens by {len(by.known)} known ones; told to be unlike: {told}"
    for figure in FIGURES:
        of = [getattr(each, figure) for each in found]
        true, expected = np.array([row["truth"][figure] for row in rows]), np.array([each.expected for each in of])
        low, high = np.array([(each.low, each.high) for each in of], np.float64).T
        scale = expected if figure == "area_mm2" else np.ones(len(rows))
        off, held, width = np.abs(true - expected) / scale, (low <= true) & (true <= high), (high - low) / scale
        constant = _constant(figure, by)
        ranks = spearmanr(expected, true).statistic, spearmanr([each.spread for each in found], off).statistic
        yield (
            f"{figure}: {held[alike].mean():.0%} held, width {width[alike].mean():.3f}, constant {constant:.3f}, ratio "
            f"{width[alike].mean() / constant:.2f}; Spearman of expected and true {ranks[0]:.2f}, of stated and true "
            f"error {ranks[1]:.2f}; error {np.median(off):.3f}, nine in ten {np.quantile(off, 0.9):.3f}"
        )
        for name, part in parts.items():
            some = part & alike
            if some.any():
                yield f"    {name}: {held[some].sum()} of {some.sum()} held, width {width[some].mean():.3f}"
    for name in ORDER:
        at = np.array([threshold_at(name, np.array(row["shares"][name]), by) for row in rows], np.float64)
        given = alike & np.isfinite(at)
        known = np.searchsorted(THRESHOLDS, np.nan_to_num(at) - 1e-9).tolist()
        held = np.array([row["shares"][name][k] >= row["truth"][name] for row, k in zip(rows, known, strict=True)])
        each = ", ".join(f"{of} {held[part & given].sum()} of {(part & given).sum()}" for of, part in parts.items())
        yield f"{name}_from: {held[given].mean():.0%} held, at {np.median(at[given]):.2f} in the median ({each})"


def _constant(figure: str, by: Calibration) -> float:
    """Return the width of bounds that are the same for every specimen: around the median, or the wall's own area."""
    true = np.array([known.truth[figure] for known in by.known])
    stated = np.array([getattr(known.expected, figure).expected for known in by.known])
    off = np.abs(true / stated - 1) if figure == "area_mm2" else np.abs(true - np.median(true))
    reach = np.sort(off)[int(np.ceil((off.size + 1) * LEVEL - 1e-9)) - 1]
    return float(2 * reach if figure == "area_mm2" else min(np.median(true) + reach, 1) - (np.median(true) - reach))


def by_drawings(rows: Sequence[Row], n: int) -> Iterator[str]:
    """Yield by set whom ``n`` of it tell to be unlike, and by rater how often bounds by drawings of these hold.

    They are to hold for the truth, and for what the same rater would draw.
    """
    known, sets = known_of(rows), np.array([row["set"] for row in rows])
    truth = [row["truth"] for row in rows]
    names = list(dict.fromkeys(sets.tolist()))
    for name in names:
        own, rng = np.flatnonzero(sets == name), np.random.default_rng(0)
        if own.size < n + FEWEST_JUDGED:
            continue
        choices = [rng.permutation(own)[: n + JUDGED] for _ in range(CHOICES)]
        refused: dict[str, list[bool]] = {of: [] for of in names}
        for chosen in choices:
            by = Calibration("", [known[k] for k in chosen[:n]])
            for k in (*chosen[n:], *(rng.choice(np.flatnonzero(sets == other)) for other in names if other != name)):
                refused[sets[k]].append(bounded(known[k].expected, by).light.low is None)
        unlike = ", ".join(f"{of} {np.mean(each):.0%}" for of, each in refused.items())
        yield f"{name}, {n} of {own.size}; told to be unlike: {unlike}"
        for rater in ("truth", *RATERS):
            of = [row["truth"] if rater == "truth" else row["drawn"][rater] for row in rows]
            for figure in FIGURES[:2]:
                rates: list[Coordinates] = []
                width: list[float] = []
                for chosen in choices:
                    by = Calibration("", [Known(known[k].expected, of[k]) for k in chosen[:n]])
                    bounds = [(k, getattr(bounded(known[k].expected, by), figure)) for k in chosen[n:]]
                    given = [(k, each.low, each.high) for k, each in bounds if each.low is not None]
                    width += [high - low for _, low, high in given]
                    if given:
                        inside = [[low <= at[k][figure] <= high for at in (truth, of)] for k, low, high in given]
                        rates.append(np.mean(inside, axis=0))
                true, drawn = np.mean(rates, axis=0)
                lowest = np.quantile(rates, 0.1, axis=0)
                yield (
                    f"    {rater}, {figure}: held for the truth {true:.0%} (of one choice in ten {lowest[0]:.0%}), "
                    f"for drawings {drawn:.0%} ({lowest[1]:.0%}), width {np.mean(width):.3f}"
                )


def main() -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bounds", description=__doc__)
    parser.add_argument("act", choices=("make", "pack", "judge", "drawn"))
    parser.add_argument("cases", nargs="*", help="SET:FIRST:LAST")
    parser.add_argument("--into", type=Path)
    parser.add_argument("--specimens", type=Path)
    parser.add_argument("--by", type=Path)
    parser.add_argument("--sets", nargs="+")
    parser.add_argument("--known", type=int, default=9)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.act == "make":
        options.into.mkdir(exist_ok=True)
        with ProcessPoolExecutor(options.workers) as pool:
            for said in pool.map(partial(made, options.into), seeds_of(options.cases)):
                print(said, flush=True)
    elif options.act == "pack":
        pack(options.specimens, options.into or PACKAGED)
    elif options.act == "drawn":
        print("\n".join(by_drawings(kept(options.specimens), options.known)))
    else:
        rows = kept(options.by) if options.by else json.loads(PACKAGED.read_text())["specimens"]
        by = [row for row in rows if not options.sets or row["set"] in options.sets]
        calibration = Calibration("", known_of(by)) if options.by or options.sets else packaged()
        print("\n".join(table(kept(options.specimens), calibration)))


if __name__ == "__main__":
    main()
