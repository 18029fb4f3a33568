"""Draw docs/figures/stitching.png and print a table from results of `endoct bench stitching -o DIR`.

python benchmarks/stitching_figure.py DIR/results.csv docs/figures/stitching.png

With more than one, each of a sweep (`--sweep CONDITION`), draw a curve over that condition each:

python benchmarks/stitching_figure.py DIR1/results.csv DIR2/results.csv docs/figures/stitching_sweeps.png
"""

import csv
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

SHOWN = ("endoct", "opencv-ecc-prepared", "cross-correlation-prepared", "ashlar", "phase-correlation")
AGAINST = {"texture": "texture contrast", "dropped": "share of frames lost", "pattern": "probe-fixed pattern"}


N_BINS = 4


def sweeps(results: list[Path], picture: Path) -> None:
    """Draw the share of pairs not right, and dashed the share wrong, over the one condition that each file varies."""
    figure, panels = plt.subplots(1, len(results), figsize=(4 * len(results), 3), sharey=True)
    for panel, path in zip(np.atleast_1d(panels), results, strict=True):
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        conditions = [key for key in rows[0] if key.startswith("condition.") and key != "condition.recipe"]
        swept = max(conditions, key=lambda key: len({row[key] for row in rows}))
        edges = np.quantile([float(row[swept]) for row in rows], np.linspace(0, 1, N_BINS + 1))
        for k, method in enumerate(dict.fromkeys(row["method"] for row in rows)):
            own = [row for row in rows if row["method"] == method]
            at, right, wrong = (
                np.nan_to_num([float(row[key] or "nan") for row in own])
                for key in (swept, "score.right", "score.wrong")
            )
            bins = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, N_BINS - 1)
            middles = [at[bins == b].mean() for b in range(N_BINS)]
            for share, style in ((1 - right, "o-"), (wrong, "--")):
                means = [share[bins == b].mean() for b in range(N_BINS)]
                panel.plot(middles, means, style, ms=4, color=f"C{k}", label=method if style == "o-" else None)
        panel.set_xlabel(AGAINST.get(swept.removeprefix("condition."), swept))
    np.atleast_1d(panels)[0].set_ylabel("pairs not right (dashed: wrong)", fontsize=8)
    np.atleast_1d(panels)[0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(picture, dpi=80)


def main(results: Path, picture: Path) -> None:
    """Print shares and errors of each method; draw the share of pairs not right against three conditions."""
    with results.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    methods = list(dict.fromkeys(row["method"] for row in rows))

    def values(method: str, name: str) -> np.ndarray:
        return np.array([float(r[f"score.{name}"] or "nan") for r in rows if r["method"] == method])

    print("| method | success | right | wrong | unknown | feed, mm | roll, ° | places, mm |")
    print("|---" * 8 + "|")
    for method in methods:
        n = len(values(method, "right"))
        right, wrong = (np.nan_to_num(values(method, key)).mean() for key in ("right", "wrong"))
        errors = [np.nanmedian(v) if np.isfinite(v := values(method, key)).any() else np.nan
                  for key in ("feed_error_mm", "roll_error_deg", "place_error_mm")]  # fmt: skip
        success = int(np.nan_to_num(values(method, "success")).sum())
        shown = " | ".join("–" if np.isnan(e) else f"{e:.2g}" for e in errors)
        print(f"| {method} | {success}/{n} | {right:.1%} | {wrong:.1%} | {1 - right - wrong:.1%} | {shown} |")
    figure, panels = plt.subplots(1, len(AGAINST), figsize=(9, 2.6), sharey=True)
    for panel, (key, label) in zip(panels, AGAINST.items(), strict=True):
        for method in (m for m in SHOWN if m in methods):
            at = np.array([float(r[f"condition.{key}"]) for r in rows if r["method"] == method])
            panel.plot(at, 1 - np.nan_to_num(values(method, "right")), "o", ms=3, alpha=0.7, label=method)
        panel.set_xlabel(label)
    panels[0].set_ylabel("share of pairs not right")
    panels[-1].legend(fontsize=6)
    figure.tight_layout()
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    *csvs, out = (Path(argument) for argument in sys.argv[1:])
    if len(csvs) > 1:
        sweeps(csvs, out)
    else:
        main(csvs[0], out)
