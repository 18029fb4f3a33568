"""Draw docs/figures/stitching.png and print a table from results of `endoct bench stitching -o DIR`.

python benchmarks/stitching_figure.py DIR/results.csv docs/figures/stitching.png
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
    main(Path(sys.argv[1]), Path(sys.argv[2]))
