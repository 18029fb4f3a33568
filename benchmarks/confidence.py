"""Does an alignment know when it does not know? True pairs, wrong pairs, featureless ones, and less and less overlap.

    endoct simulate … -o DIR/quick-1000 --preset quick --seed 1000          and so on
    endoct simulate … -o BLANK/quick-1000 --preset quick --seed 1000 --vary bore.cell_fraction=0..0
    python benchmarks/confidence.py DIR --featureless BLANK [--cache CACHE] [--csv FILE] [--plot FILE.png]

DIR and BLANK hold simulated specimens, named PRESET-SEED; seeds 0–99 are for tuning, from 1000 on for reporting.
Every recording is unrolled once, into CACHE. Then are aligned, endoscope against OCT, as `endoct compare` does it:

- ``true``: the two recordings of one bore. ``right`` counts those of which orientation, turn (to 5°) and shift along
  z (to 0.2 mm) are right as well.
- ``wrong``: the endoscope of one bore against the OCT of another of the same preset, whose diameter is taken to be the
  same (`endoct compare` would refuse some for it).
- ``featureless``: both recordings of a wall without cells: speckle, texture and light alone; and of two such walls.
- ``overlap``: true pairs cut along z, so that they share that part of the length of either.

A recording that cannot be unrolled counts as not aligned. Intervals are Clopper and Pearson's, 95 %.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
from panoramas import unroll_both, unrolled
from scipy.stats import binomtest

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import wrap_rad
from endoct.fusion.evidence.evidence import Evidence, prepare
from endoct.fusion.registration.align import BELIEVABLE, LIKELY_CHANCE, Alignment, align, orientations_of
from endoct.stitching.panorama import Panorama
from endoct.workbench.pipeline.truth import TrueMap, TruePose, load_truth, true_pose

SHARES = tuple(tenth / 10 for tenth in range(1, 11))
RIGHT_RAD, RIGHT_MM = np.deg2rad(5), 0.2
Row = dict[str, str | float | bool]


@dataclass(frozen=True)
class Pairing:
    """One pair to align: the endoscope of specimen ``a`` and the OCT of ``b``; ``share`` to cut them to, or None."""

    kind: str
    a: Path
    b: Path
    share: float | None = None


@cache
def _side(specimen: Path, side: str, cache_folder: Path) -> tuple[Panorama, Evidence]:
    panorama = unrolled(specimen, side, cache_folder)
    return panorama, prepare(panorama)


def aligned(pairing: Pairing, cache_folder: Path) -> Row:
    """Align one pair and say what came of it."""
    row: Row = {"kind": pairing.kind, "a": pairing.a.name, "b": pairing.b.name, "share": pairing.share or ""}
    row |= {"aligned": False, "right": False}
    try:
        panorama_a, a = _side(pairing.a, "endoscope", cache_folder)
        panorama_b, b = _side(pairing.b, "oct", cache_folder)
    except EndoctError as error:
        return row | {"reason": str(error)}
    poses = true_pose(panorama_a, load_truth(pairing.a)), true_pose(panorama_b, load_truth(pairing.b))
    if pairing.share is not None:
        a, b = _cut(a, b, poses, pairing.share)
    orientations = orientations_of(panorama_a, panorama_b)
    answer = align(a, replace(b, radius_mm=a.radius_mm), orientations=orientations)
    best = answer if isinstance(answer, Alignment) else answer.best
    row |= {"aligned": isinstance(answer, Alignment), "reason": "" if isinstance(answer, Alignment) else answer.reason}
    if best is None:
        return row
    names = "confidence", "chance", "correlation", "ratio", "overlap_mm2"
    row |= {name: getattr(best, name) for name in names}
    return row | {"right": pairing.a == pairing.b and _is_right(best, TrueMap(a.z_mm, *poses), b.z_mm)}


def _cut(a: Evidence, b: Evidence, poses: tuple[TruePose, TruePose], share: float) -> tuple[Evidence, Evidence]:
    """Return both cut along z to one length, as large as can be, of which they share ``share``."""
    z = poses[0].z_bore(a.z_mm), poses[1].z_bore(b.z_mm)
    low, high = max(z[0].min(), z[1].min()), min(z[0].max(), z[1].max())
    middle = (low + high) / 2

    def shared_mm(first: Coordinates, second: Coordinates) -> float:
        room = min(middle - first.min(), second.max() - middle)
        return float(min(room / (1 / share - 0.5), high - low))

    a_first, b_first = shared_mm(*z), shared_mm(*z[::-1])
    shared = max(a_first, b_first)
    length = shared / share
    reaches = (middle + shared / 2 - length, middle + shared / 2), (middle - shared / 2, middle - shared / 2 + length)
    if b_first > a_first:
        reaches = reaches[::-1]
    return _rows(a, z[0], reaches[0]), _rows(b, z[1], reaches[1])


def _rows(evidence: Evidence, z_mm: Coordinates, reach: tuple[float, float]) -> Evidence:
    inside = np.flatnonzero((z_mm >= reach[0] - 1e-9) & (z_mm <= reach[1] + 1e-9))
    rows = slice(inside[0], inside[-1] + 1)
    return replace(evidence, values=evidence.values[rows], valid=evidence.valid[rows], z_mm=evidence.z_mm[rows])


def _is_right(alignment: Alignment, true: TrueMap, z_b_mm: Coordinates) -> bool:
    theta_rad = np.linspace(0, 2 * np.pi, 32)
    off_mm = alignment.z_to_a(z_b_mm) - true.z_to_a(z_b_mm)
    turned_rad = alignment.theta_to_a(theta_rad, z_b_mm[:, None])
    return bool(
        alignment.mirrored == true.mirrored
        and alignment.z_reversed == true.z_reversed(z_b_mm)
        and abs(np.median(wrap_rad(turned_rad - true.theta_to_a(theta_rad)))) < RIGHT_RAD
        and abs(np.nanmedian(off_mm)) < RIGHT_MM
    )


def _groups(folder: Path | None) -> dict[str, list[Path]]:
    """Return the specimens in a folder by preset, in order of their seeds."""
    found: dict[str, list[Path]] = {}
    for path in sorted(folder.glob("*-*/truth")) if folder else ():
        found.setdefault(path.parent.name.rsplit("-", 1)[0], []).append(path.parent)
    return {k: sorted(v, key=lambda path: int(path.name.rsplit("-", 1)[1])) for k, v in sorted(found.items())}


def _deranged(kind: str, specimens: Sequence[Path], wanted: int) -> Iterator[Pairing]:
    """Yield up to ``wanted`` pairs of different specimens: each with the next, then with the one after that …"""
    n = len(specimens)
    pairs = ((i, (i + by) % n) for by in range(1, n) for i in range(n))
    for (i, j), _ in zip(pairs, range(wanted), strict=False):
        yield Pairing(kind, specimens[i], specimens[j])


def pairings(folder: Path, featureless: Path | None, wanted: int, curve: int) -> Iterator[Pairing]:
    """Yield all pairs to align."""
    for preset, specimens in _groups(folder).items():
        yield from (Pairing(f"true {preset}", one, one) for one in specimens)
        yield from _deranged(f"wrong {preset}", specimens, wanted)
        for share in SHARES:
            yield from (Pairing(f"overlap {preset}", one, one, share) for one in specimens[:curve])
    for preset, specimens in _groups(featureless).items():
        own = [Pairing(f"featureless {preset}", one, one) for one in specimens]
        yield from own
        yield from _deranged(f"featureless {preset}", specimens, wanted // 2 - len(own))


def interval(count: int, n: int) -> tuple[float, float]:
    """Return Clopper and Pearson's interval, 95 %, of a share."""
    exact = binomtest(count, n).proportion_ci(method="exact")
    return float(exact.low), float(exact.high)


def _summary(rows: Sequence[Row]) -> Iterator[str]:
    for kind, share in dict.fromkeys((row["kind"], row["share"]) for row in rows):
        of = [row for row in rows if (row["kind"], row["share"]) == (kind, share)]
        n, count, right = len(of), sum(row["aligned"] for row in of), sum(row["aligned"] and row["right"] for row in of)
        low, high = interval(count, n)
        said = f"{kind:18s} {share:4} {count:4d} of {n:4d} aligned ({count / n:.1%}, {low:.1%} to {high:.1%})"
        if kind.split()[0] in ("true", "overlap"):
            said += f", {right} rightly"
        if stated := [row["confidence"] for row in of if "confidence" in row]:
            chances = [row["chance"] for row in of if "chance" in row]
            said += (
                f"; confidence {min(stated):.3f} to {max(stated):.3f}, chance {min(chances):.1e} to {max(chances):.1e}"
            )
        yield said


def plot(rows: Sequence[Row], path: Path) -> None:
    """Draw how far true, wrong and featureless pairs stand out, and the share aligned over the overlap."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    markers = {"true": ("o", "#1b6ca8"), "wrong": ("x", "#c0392b"), "featureless": ("+", "#7f7f7f")}
    for kind in dict.fromkeys(row["kind"] for row in rows):
        word, preset = kind.split()
        of = [row for row in rows if row["kind"] == kind and "confidence" in row]
        if word == "overlap":
            continue
        marker, colour = markers[word]
        chance = [max(row["chance"], 1e-30) for row in of]
        shade = {"alpha": 0.9 if preset == "quick" else 0.5}
        left.plot(chance, [row["confidence"] for row in of], marker, color=colour, ms=5, label=kind, **shade)
    left.axhline(BELIEVABLE, color="k", lw=0.8, ls="--")
    left.axvline(LIKELY_CHANCE, color="k", lw=0.8, ls="--")
    left.set(xscale="log", xlabel="chance", ylabel="confidence", title="believed: above and left of the lines")
    left.legend(fontsize=7)
    for shift, kind in enumerate(dict.fromkeys(row["kind"] for row in rows if row["kind"].startswith("overlap"))):
        points = []
        for share in SHARES:
            of = [row for row in rows if row["kind"] == kind and row["share"] == share]
            count = sum(row["aligned"] and row["right"] for row in of)
            points.append((share, count / len(of), *interval(count, len(of))))
        x, middle, low, high = 100 * np.array(points).T
        right.errorbar(
            x + shift, middle, np.stack([middle - low, high - middle]), fmt="o-", capsize=2, label=kind.split()[1]
        )
    if right.containers:
        right.legend()
    right.set(xlabel="overlap, % of the length", ylabel="rightly aligned, %", ylim=(-3, 103))
    figure.savefig(path, dpi=130)


def main() -> None:
    """Align everything and print, per kind of pair, how many were believed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--featureless", type=Path)
    parser.add_argument("--cache", type=Path, help="keep panoramas here, and reuse them")
    parser.add_argument("--wrong", type=int, default=100, help="wrong pairs a preset; featureless ones: half as many")
    parser.add_argument("--curve", type=int, default=30, help="specimens a preset for the curve over overlap")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    work = arguments.cache or Path(tempfile.mkdtemp(prefix="endoct-confidence-"))
    todo = list(pairings(arguments.folder, arguments.featureless, arguments.wrong, arguments.curve))
    specimens = sorted({path for pairing in todo for path in (pairing.a, pairing.b)})
    with ProcessPoolExecutor(arguments.workers) as pool:
        list(pool.map(partial(unroll_both, cache=work), specimens))
        rows = list(pool.map(partial(aligned, cache_folder=work), todo, chunksize=4))
    _print(_summary(rows))
    if arguments.csv:
        pd.DataFrame(rows).to_csv(arguments.csv, index=False)
    if arguments.plot:
        plot(rows, arguments.plot)


def _print(lines: Iterable[str]) -> None:
    for line in lines:
        print(line)


if __name__ == "__main__":
    sys.exit(main())
