"""Draws figures of the documentation from results of `endoct bench`, and prints the tables that go with them.

    endoct bench oct --seeds 1000-1015 -o DIR
    python benchmarks/bench_figures.py rotation DIR/results.csv -o docs/figures/rotation.png
    endoct bench stitching --seeds 1000-1029 -o DIR
    python benchmarks/bench_figures.py stitching DIR/results.csv -o docs/figures/stitching.png
    python benchmarks/bench_figures.py sweeps DIR1/results.csv DIR2/results.csv -o docs/figures/stitching_sweeps.png

Each file of ``sweeps`` is of a run with `--sweep CONDITION`; it becomes a panel over that condition.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

N_BINS = 4
ERRORS = {"feed_error_mm": "feed, mm", "roll_error_deg": "roll, °", "place_error_mm": "places, mm"}
PLACED = ("endoct", "opencv-ecc-prepared", "cross-correlation-prepared", "ashlar", "phase-correlation")
STITCHING = {"texture": "texture contrast", "dropped": "share of frames lost", "pattern": "probe-fixed pattern"}
UNROLLED = ("endoct", "even", "sine", "sine-even", "no-rotation", "no-turn-length", "no-start-angle", "no-lost-ascans")
ROTATION = {
    "off_axis": "off axis, share of the gap",
    "rotation_error_deg": "rotation error, peak, °",
    "turn_jitter": "jitter of the turns' length",
}


def rotation(results: pd.DataFrame) -> Figure:
    """Print medians of all scores; draw Jaccard index and error of the beams' angles against three conditions."""
    of_methods = results[results["method"].isin(UNROLLED) & (results["status"] == "ok")].groupby("method", sort=False)
    print(of_methods[[f"score.{name}" for name in ("jaccard", "beam_deg", "rim_deg", "valid")]].median().round(3))
    print(of_methods["score.jaccard"].agg(["min", "max", "count"]).round(3))
    figure = Figure(figsize=(4.5 * len(ROTATION), 7.5), layout="constrained")
    panels = figure.subplots(2, len(ROTATION))
    for column, (condition, label) in zip(panels.T, ROTATION.items(), strict=True):
        for k, (method, own) in enumerate(of_methods):
            for start, marker in (("free", "o"), ("triggered", "x")):
                some = own[own["condition.start"] == start]
                for panel, score in zip(column, ("jaccard", "beam_deg"), strict=True):
                    at, values = some[f"condition.{condition}"], some[f"score.{score}"]
                    panel.plot(at, values, marker, ms=4, color=f"C{k}", label=f"{method}, {start} start")
        column[0].set_ylabel("Jaccard index")
        column[1].set(xlabel=label, ylabel="error of the beams' angles, ° (same for sine)", yscale="log")
        for panel in column:
            panel.xaxis.set_major_locator(MaxNLocator(5))
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside lower center", ncols=len(of_methods))
    return figure


def stitching(results: pd.DataFrame) -> Figure:
    """Print shares and errors of each method; draw the share of pairs not right against three conditions."""
    shares = [f"score.{name}" for name in ("right", "wrong")]
    results[shares] = results[shares].fillna(0.0)
    print(f"| method | success | right | wrong | unknown | {' | '.join(ERRORS.values())} |")
    print("|---" * 8 + "|")
    for method, own in results.groupby("method", sort=False):
        right, wrong = own[shares].mean()
        errors = own[[f"score.{name}" for name in ERRORS]].median()
        texts = " | ".join("–" if np.isnan(error) else f"{error:.2g}" for error in errors)
        success = int(own["score.success"].sum())
        print(f"| {method} | {success}/{len(own)} | {right:.1%} | {wrong:.1%} | {1 - right - wrong:.1%} | {texts} |")
    figure = Figure(figsize=(9, 2.6), layout="tight")
    panels = figure.subplots(1, len(STITCHING), sharey=True)
    for panel, (condition, label) in zip(panels, STITCHING.items(), strict=True):
        for method in PLACED:
            own = results[results["method"] == method]
            panel.plot(own[f"condition.{condition}"], 1 - own["score.right"], "o", ms=3, alpha=0.7, label=method)
        panel.set_xlabel(label)
    panels[0].set_ylabel("share of pairs not right")
    panels[-1].legend(fontsize=6)
    return figure


def sweeps(results: list[pd.DataFrame]) -> Figure:
    """Draw the share of pairs not right, and dashed the share wrong, over the one condition that each run varies."""
    figure = Figure(figsize=(4 * len(results), 3), layout="tight")
    panels = figure.subplots(1, len(results), sharey=True, squeeze=False)[0]
    for panel, frame in zip(panels, results, strict=True):
        _sweep(panel, frame)
    panels[0].set_ylabel("pairs not right (dashed: wrong)", fontsize=8)
    panels[0].legend(fontsize=7)
    return figure


def _sweep(panel: Axes, frame: pd.DataFrame) -> None:
    conditions = [name for name in frame if name.startswith("condition.") and name != "condition.recipe"]
    swept = max(conditions, key=lambda name: frame[name].nunique())
    edges = np.quantile(frame[swept], np.linspace(0, 1, N_BINS + 1))
    frame = frame.fillna({"score.right": 0.0, "score.wrong": 0.0})
    frame["bin"] = np.clip(np.searchsorted(edges, frame[swept], side="right") - 1, 0, N_BINS - 1)
    for k, (method, own) in enumerate(frame.groupby("method", sort=False)):
        means = own.groupby("bin")[[swept, "score.right", "score.wrong"]].mean()
        panel.plot(means[swept], 1 - means["score.right"], "o-", ms=4, color=f"C{k}", label=method)
        panel.plot(means[swept], means["score.wrong"], "--", ms=4, color=f"C{k}")
    panel.set_xlabel(STITCHING.get(swept.removeprefix("condition."), swept))


def main() -> None:
    """Draw the figure asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("figure", choices=("rotation", "stitching", "sweeps"))
    parser.add_argument("results", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    frames = [pd.read_csv(path) for path in arguments.results]
    draw = {"rotation": rotation, "stitching": stitching}.get(arguments.figure)
    figure = sweeps(frames) if draw is None else draw(frames[0])
    figure.savefig(arguments.output, dpi=80)


if __name__ == "__main__":
    main()
