"""The catheter off its axis and turning unevenly: what each correction brings, sine against circle.

    python benchmarks/rotation.py --seeds 1000-1019 [--rivals] [-o DIR]

Cases and judge are those of `endoct bench oct`: 16 slices of 512 A-scans, catheter off axis by 0–80 % of the gap, free
or triggered starts, rotation error of 0–8° peak, 1–3 % of turn jitter, blocks of A-scans lost. Prints a table by
method, the same by ranges of each condition, and draws both scores against each condition into DIR/rotation.png.
"""

import argparse
import csv
from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import MaxNLocator

from endoct.workbench.bench.case_selection import parse_seeds
from endoct.workbench.bench.runner import Plan, Row, run_source
from endoct.workbench.bench.tasks.oct import RANGES

VARIANTS = ("endoct", "even", "sine", "sine-even", "no-rotation", "no-turn-length", "no-start-angle", "no-lost-ascans")
RIVALS = ("literal", "brightest-wall", "ransac-circle", "phase-correlation", "blockwise-correlation")
SCORES = ("jaccard", "beam_deg", "rim_deg", "valid")
N_BINS = 3
LABELS = {
    "off_axis": "off axis, share of the gap",
    "rotation_error_deg": "rotation error, peak, °",
    "turn_jitter": "jitter of the turns' length",
}


def table(title: str, rows: list[Row], methods: tuple[str, ...]) -> None:
    """Print the median of every score and the range of the Jaccard index, a line a method."""
    n = len({row.case for row in rows})
    print(f"\n{title}, n = {n}\n{'method':22s}" + "".join(f"{name:>10s}" for name in SCORES) + "    Jaccard min … max")
    for method in methods:
        of = [row.scores for row in rows if row.method == method and row.status == "ok"]
        if not of:
            print(f"{method:22s} failed")
            continue
        values = {name: np.array([scores[name] for scores in of]) for name in SCORES}
        middle = "".join(f"{np.nanmedian(v):10.3f}" if np.isfinite(v).any() else f"{'–':>10s}" for v in values.values())
        print(f"{method:22s}{middle}    {values['jaccard'].min():.3f} … {values['jaccard'].max():.3f}")


def by_condition(rows: list[Row], methods: tuple[str, ...]) -> None:
    """Print the same tables for ranges of each condition."""
    for name, range_ in RANGES.items():
        if isinstance(range_[0], str):
            for word in range_:
                some = [row for row in rows if row.conditions[name] == word]
                if some:
                    table(f"{name} {word}", some, methods)
            continue
        edges = np.linspace(float(range_[0]), float(range_[1]), N_BINS + 1)
        for low, high in pairwise(edges):
            some = [row for row in rows if low <= float(row.conditions[name]) < high]
            if some:
                table(f"{name} {low:.3g}–{high:.3g}", some, methods)


def draw(rows: list[Row], methods: tuple[str, ...], path: Path) -> None:
    """Draw Jaccard index and error of the beams' angles against the conditions."""
    figure, axes = plt.subplots(2, len(LABELS), figsize=(4.5 * len(LABELS), 7.5), squeeze=False, layout="constrained")
    for column, (name, label) in enumerate(LABELS.items()):
        for method in methods:
            of = [row for row in rows if row.method == method and row.status == "ok"]
            x = np.array([float(row.conditions[name]) for row in of])
            free = np.array([row.conditions["start"] == "free" for row in of], bool)
            for axis, score in zip(axes[:, column], ("jaccard", "beam_deg"), strict=True):
                y = np.array([row.scores[score] for row in of])
                (shown,) = axis.plot(x[free], y[free], "o", ms=4, label=f"{method}, free start")
                axis.plot(x[~free], y[~free], "x", ms=5, color=shown.get_color(), label=f"{method}, triggered")
        axes[0, column].set_ylabel("Jaccard index")
        axes[1, column].set(xlabel=label, ylabel="error of the beams' angles, ° (same for sine)", yscale="log")
        for axis in axes[:, column]:
            axis.xaxis.set_major_locator(MaxNLocator(5))
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside lower center", ncols=len(methods))
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    """Run the cases asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1000-1019")
    parser.add_argument("--rivals", action="store_true", help="other people's ways as well")
    parser.add_argument("-o", "--output", type=Path, default=Path("out"))
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    methods = VARIANTS + (RIVALS if arguments.rivals else ())
    plan = Plan("oct", methods, parse_seeds(arguments.seeds), 1, RANGES)
    rows: list[Row] = []
    with (arguments.output / "rotation.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["case", "method", "status", "reason", *RANGES, *SCORES, "cpu_seconds"])
        for source in plan.sources:
            for row in run_source(plan, source):
                rows.append(row)
                scores = [row.scores.get(name, "") for name in SCORES]
                writer.writerow(
                    [row.case, row.method, row.status, row.reason, *row.conditions.values(), *scores, row.cpu_seconds]
                )
            file.flush()
    table("all", rows, methods)
    by_condition(rows, methods)
    draw(rows, ("endoct", "even", "sine", "sine-even"), arguments.output / "rotation.png")


if __name__ == "__main__":
    main()
