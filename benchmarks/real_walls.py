"""What walls of real drilled holes show that simulated ones do not: texture, thin dark lines, uneven noise, stripes.

    python -m benchmarks.real_walls TELEVIEWER_FOLDER PAIRS

Beside four images of real holes stand the endoscope's and the OCT's walls of pickled pairs of panoramas, as medians.
Light counts as −log of the intensity over its median, distance as it is, less the sine of each turn; both over their
standard deviation. Lengths are shares of the bore's radius.
"""

import argparse
import pickle
from collections import defaultdict
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image as Picture
from scipy import ndimage

from endoct.base.numeric.least_squares import harmonics
from endoct.base.numeric.ranks import SIGMA_PER_MEDIAN, robust_sigma
from endoct.fusion.evidence.evidence import FAINTEST

RADIUS_MM = 48.0
REAL = {"optical.png": 3000 / 1427, "optical-folded.png": 3000 / 1086, "acoustic-amplitude.tif": 6.0,
        "acoustic-travel-time.tif": 6.0}  # fmt: skip
A_SET = 8
LONGEST, SHORTEST = 1.0, 0.25
"""Wavelengths over which the slope of a spectrum is fitted: all walls resolve them along the hole."""
THICKEST, DARKER = 0.5, 3.0
COLUMNS = ("slope around", "slope along", "lines, %", "row noise", "column noise", "stripes, %")

Wall = NDArray[np.float64]


def as_light(image: NDArray[np.generic]) -> Wall:
    """Return darkness of an intensity image, NaN where it has none."""
    values = np.asarray(image, np.float64)
    return -np.log(np.maximum(values / np.nanmedian(values), FAINTEST))


def as_distance(image: NDArray[np.generic]) -> Wall:
    """Return a distance less the first harmonic of every turn."""
    values = np.asarray(image, np.float64)
    theta = 2 * np.pi * np.arange(values.shape[1]) / values.shape[1]
    for _ in range(2):
        for wave in (np.ones_like(theta), np.cos(theta), np.sin(theta)):
            values = values - np.nanmean(values * wave, axis=1, keepdims=True) / np.mean(wave**2) * wave
    return values


def slope(wall: Wall, step: float, axis: int) -> float:
    """Return the exponent of the power spectrum along an axis whose samples lie ``step`` radii apart."""
    n = wall.shape[axis]
    power = np.mean(np.abs(np.fft.rfft(wall * (np.hanning(n)[:, None] if axis == 0 else 1), axis=axis)) ** 2, 1 - axis)
    per_radius = np.fft.rfftfreq(n, step)
    there = (per_radius >= 1 / LONGEST) & (per_radius <= min(1 / SHORTEST, 0.5 / step)) & (power > 0)
    return float(np.polyfit(np.log(per_radius[there]), np.log(power[there]), 1)[0]) if there.sum() > 2 else np.nan


def uneven(noise: Wall) -> float:
    """Return how many times as noisy the noisiest tenth is as the quietest."""
    low, high = np.nanquantile(noise, (0.1, 0.9))
    return float(high / low) if low > 0 else np.nan


def measured(wall: Wall, dz: float) -> list[float]:
    """Return the values of ``COLUMNS`` of a wall whose rows lie ``dz`` radii apart."""
    wall = wall[np.isfinite(wall).mean(axis=1) > 0.5]
    known = np.isfinite(wall)
    wall = np.where(known, wall, np.nanmedian(wall, axis=1, keepdims=True))
    n = wall.shape[1]
    around = wall - (np.roll(wall, 1, axis=1) + np.roll(wall, -1, axis=1)) / 2
    off = np.where(known, np.abs(around) * SIGMA_PER_MEDIAN / np.sqrt(1.5), np.nan)
    rows = max(3, 2 * round(THICKEST / 2 / dz) + 1)
    above = wall - ndimage.grey_opening(wall, size=(rows, 1))
    sigma = SIGMA_PER_MEDIAN * np.median(np.abs(wall - np.median(wall)))
    flat = wall - ndimage.gaussian_filter1d(wall, n / 24, axis=1, mode="wrap")
    return [
        slope(wall, 2 * np.pi / n, 1),
        slope(wall, dz, 0),
        100 * float(np.mean(above > DARKER * sigma)),
        uneven(np.nanmedian(off, axis=1)),
        uneven(np.nanmedian(off, axis=0)),
        100 * float(np.var(np.median(flat, axis=0)) / np.var(flat)),
    ]


def harmonics_left(counts: Wall) -> None:
    """Print what one sine a turn leaves of a travel time, and what more harmonics do, over the noise of its beams."""
    theta = 2 * np.pi * np.arange(counts.shape[1]) / counts.shape[1]
    off = counts - (np.roll(counts, 1, axis=1) + np.roll(counts, -1, axis=1)) / 2
    noise = float(np.median([robust_sigma(turn) for turn in off]) / np.sqrt(1.5))
    for most in (1, 2, 3):
        basis = np.column_stack([np.ones_like(theta), harmonics(theta, range(1, most + 1))])
        left, highest = [], []
        for turn in counts:
            own = np.ones(theta.size, np.bool_)
            for _ in range(12):
                factors = np.linalg.lstsq(basis[own], turn[own])[0]
                off_turn = turn - basis @ factors
                own = np.abs(off_turn) <= max(4 * robust_sigma(off_turn), 1.0)
            left.append(robust_sigma(off_turn))
            highest.append(np.hypot(*factors[-2:]))
        print(
            f"{most} harmonics leave {np.median(left):.2f} counts of {noise:.2f}; the last has {np.median(highest):.2f}"
        )


def main() -> None:
    """Print a line of the table for each wall of a real hole, and for each set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("televiewer", type=Path)
    parser.add_argument("pairs", type=Path)
    asked = parser.parse_args()
    rows: dict[str, list[list[float]]] = defaultdict(list)
    for name, dz_mm in REAL.items():
        path = asked.televiewer / name
        green = (
            np.asarray(Picture.open(path).convert("RGB"))[..., 1] if path.suffix == ".png" else tifffile.imread(path)
        )
        if "time" in name:
            harmonics_left(np.asarray(green, np.float64))
        wall = as_distance(green) if "time" in name else as_light(green)
        rows[name].append(measured(wall, dz_mm / RADIUS_MM))
    by_set = defaultdict(list)
    for path in sorted(asked.pairs.glob("*.pkl")):
        by_set[path.name.split("-")[0]].append(path)
    for name, paths in by_set.items():
        for path in paths[:A_SET]:
            pair = pickle.loads(path.read_bytes())
            light, oct_ = pair["a"], pair["b"]
            seen = as_light(np.where(light.valid, light.intensity, np.nan))
            rows[f"{name}, endoscope"].append(measured(seen, light.grid.dz_mm / light.grid.radius_mm))
            far = as_distance(np.where(oct_.valid, oct_.depth_mm, np.nan))
            rows[f"{name}, OCT's depth"].append(measured(far, oct_.grid.dz_mm / oct_.grid.radius_mm))
    print("| wall |", " | ".join(COLUMNS), "|\n|---|" + "---|" * len(COLUMNS))
    for name, values in rows.items():
        print(f"| {name}, {len(values)} |", " | ".join(f"{value:.3g}" for value in np.nanmedian(values, axis=0)), "|")


if __name__ == "__main__":
    main()
