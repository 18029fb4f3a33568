"""Cavities that an expert picked in an acoustic image of a drilled hole: which methods find, and what else they mark.

    python -m benchmarks.picks TELEVIEWER_FOLDER [--pairs PAIRS]

Where the picks lie in the image is not stated. All placements count at which they are nearly as dark as at the best, in
both directions around: medians over these, and what they lie between. ``--pairs``: how many cells, and other regions,
are left of simulated walls that are sampled as coarsely, at each least size of a region.
"""

import argparse
import csv
import pickle
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy import ndimage, stats

from benchmarks.planes import RADIUS_MM, side_of
from endoct.base.arrays import Mask
from endoct.base.numeric.regions import label, looked_up
from endoct.fusion.evidence.side import Side
from endoct.fusion.segmentation.li_alone import above_li
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.side_cells import segment_side
from endoct.workbench.bench.rivals.learned_segmentation import random_forest
from endoct.workbench.bench.rivals.segmentation import chan_vese_prepared

ROW_MM, FIRST_M, TURN_DEG, ALIKE = 6.0, (106.40, 107.0), 3, 0.01
N_COLUMNS = 144
SIZES = 1, 2, 3, 4, 6, 8, 12
ALONG_RADII = 4.0
PARAMETERS = SegmentParameters()
Box = tuple[NDArray[np.intp], NDArray[np.intp]]


def of_size(mask: Mask, least: int) -> Mask:
    """Return a mask without regions of fewer samples."""
    labels, n = label(mask)
    size = np.bincount(labels.ravel(), minlength=n + 1)
    return mask & looked_up(size >= least, labels)


def against_its_column(side: Side) -> Mask:
    """Return what Li's threshold separates once each column's local median along the hole is off, so no stripe is."""
    dark = side.contrast("dark")
    rows = 2 * round(ALONG_RADII / 2 * dark.radius_mm / dark.dz_mm) + 1
    level = ndimage.median_filter(dark.values, size=(rows, 1), mode="nearest")
    return above_li(replace(dark, values=dark.values - level), PARAMETERS).mask


METHODS: dict[str, Callable[[Side], Mask]] = {
    "endoct": lambda side: segment_side(side, PARAMETERS, "dark").mask,
    "Li": lambda side: above_li(side.contrast("dark"), PARAMETERS).mask,
    "Chan–Vese": lambda side: chan_vese_prepared(side.panorama),
    "random forest": lambda side: random_forest(side.panorama),
    "Li against each column": against_its_column,
}


def placements(folder: Path, dark: NDArray[np.float32]) -> list[list[Box]]:
    """Return rows and columns of all picks, for every placement at which they are nearly as dark as at the best."""
    with (folder / "acoustic-amplitude-picks.csv").open(encoding="utf-8") as file:
        picks = [tuple(float(value) for value in row.values()) for row in csv.DictReader(file)]
    rank = stats.rankdata(dark).reshape(dark.shape) / dark.size

    def laid(first_m: float, sense: int, turn_deg: float) -> list[Box]:
        boxes = []
        for depth_m, azimuth, opening in picks:
            row, half = round((depth_m - first_m) * 1000 / ROW_MM), opening / 2 * N_COLUMNS / 360
            middle = (sense * azimuth + turn_deg) * N_COLUMNS / 360
            columns = np.arange(round(middle - half), round(middle + half) + 1) % N_COLUMNS
            boxes.append((np.clip(np.arange(row - 1, row + 2), 0, len(dark) - 1), columns))
        return boxes

    tried = [laid(*at) for at in product(np.arange(*FIRST_M, ROW_MM / 1000), (1, -1), range(0, 360, TURN_DEG))]
    scores = [np.mean([rank[np.ix_(*box)].mean() for box in boxes]) for boxes in tried]
    alike = [boxes for boxes, score in zip(tried, scores, strict=True) if score >= max(scores) - ALIKE]
    print(f"darker than {max(scores):.0%} of the image at best; {len(alike)} placements of {len(tried)} are as good")
    return alike


def counted(mask: Mask, places: list[Box]) -> tuple[int, float]:
    """Return how many picks a mask meets, and its other regions a metre."""
    labels, n = label(mask)
    near = np.zeros(mask.shape, np.bool_)
    for box in places:
        near[np.ix_(*box)] = True
    others = n - np.unique(labels[near & mask]).size
    return sum(bool(mask[np.ix_(*box)].any()) for box in places), others / (len(mask) * ROW_MM / 1000)


def on_pairs(folder: Path) -> None:
    """Print, by least size, the share of true cells met and the regions a bore that meet none."""
    met, others, true = dict.fromkeys(SIZES, 0), dict.fromkeys(SIZES, 0), 0
    paths = sorted(folder.glob("*.pkl"))[::6]
    for path in paths:
        pair = pickle.loads(path.read_bytes())
        wall, cells = pair["a"], pair["cell_a"]
        down = max(1, round(ROW_MM / RADIUS_MM * wall.grid.radius_mm / wall.grid.dz_mm))
        n_rows = len(cells) // down
        coarse = [np.asarray(image[: n_rows * down], np.float32).reshape(n_rows, down, N_COLUMNS, -1).mean((1, 3))
                  for image in (wall.intensity[:, : cells.shape[1] // N_COLUMNS * N_COLUMNS],
                                cells[:, : cells.shape[1] // N_COLUMNS * N_COLUMNS])]  # fmt: skip
        side = side_of(coarse[0], down * wall.grid.dz_mm, wall.grid.radius_mm)
        mask = METHODS["Li"](side)
        of_truth, n = label(coarse[1] >= 0.5)
        true += n
        for least in SIZES:
            labels, k = label(of_size(mask, least))
            met[least] += np.unique(of_truth[(labels > 0) & (of_truth > 0)]).size
            others[least] += k - np.unique(labels[(labels > 0) & (of_truth > 0)]).size
    for least in SIZES:
        share, beside = met[least] / true, others[least] / len(paths)
        print(f"at least {least} samples: {share:.3f} of {true} cells, {beside:.2f} others a bore")


def main() -> None:
    """Print picks met and other regions a metre, of each method and with each least size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("televiewer", type=Path)
    parser.add_argument("--pairs", type=Path)
    asked = parser.parse_args()
    if asked.pairs:
        on_pairs(asked.pairs)
    side = side_of(tifffile.imread(asked.televiewer / "acoustic-amplitude.tif").astype(np.float32), ROW_MM, RADIUS_MM)
    alike = placements(asked.televiewer, side.contrast("dark").values)
    for name, method in METHODS.items():
        mask = method(side)
        for least in SIZES:
            met, others = np.transpose([counted(of_size(mask, least), places) for places in alike])
            low, middle, high = np.quantile(met, (0, 0.5, 1))
            print(
                f"{name}, at least {least} samples: {middle:g} ({low:g} to {high:g}) of {len(alike[0])} picks,", end=" "
            )
            print(f"{np.median(others):.0f} others a metre")


if __name__ == "__main__":
    main()
