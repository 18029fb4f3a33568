"""Speckle of real recordings: what a logarithm that is cut at 0 makes of it.

``axsun-oct`` holds u8 B-scans of a swept-source system after processing that is not known. Fully developed speckle
has an exponential intensity; its logarithm, scaled and cut at 0 by the recorder, is counts =
max(0, s·(10·log10 I + m)), and how far m lies over the cut decides skew and spread. One s is fitted for all
regions, one m for each.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.optimize import least_squares

from endoct.base.arrays import Coordinates

# rows, columns: homogeneous along the rows, few enough rows that depth changes nothing, away from lines and mirrors
REGIONS = {
    "PDMS_thick_rel_001.bin": {
        "bulk, near": (slice(590, 600), slice(700, 1400)),
        "bulk": (slice(640, 650), slice(700, 1400)),
        "bulk, deeper": (slice(700, 710), slice(900, 1500)),
        "bulk, deepest": (slice(760, 770), slice(900, 1300)),
        "air": (slice(380, 384), slice(300, 2200)),
        "below": (slice(930, 990), slice(2350, 2480)),
    },
    "Thumb_relaxed_276.bin": {
        "skin, near": (slice(620, 630), slice(400, 800)),
        "skin": (slice(640, 650), slice(400, 800)),
        "skin, deeper": (slice(700, 710), slice(400, 800)),
        "skin, deepest": (slice(730, 740), slice(400, 800)),
        "air": (slice(400, 404), slice(300, 900)),
        "below": (slice(960, 1010), slice(300, 900)),
    },
}


@dataclass(frozen=True)
class Region:
    """One region: mean and standard deviation in counts, skew, and share at 0; ``model_skew`` of what was fitted.

    ``contrast`` of the intensity that the fitted scale makes of the counts; ``misfit`` rms of the quantiles, counts.
    """

    name: str
    mean: float
    sigma: float
    skew: float
    cut: float
    model_skew: float
    contrast: float
    misfit: float


def skew_of(values: Coordinates) -> float:
    """Return the skew of ``values``."""
    centred = values - values.mean()
    return float(np.mean(centred**3) / np.mean(centred**2) ** 1.5)


def bscan(path: Path) -> NDArray[np.uint8]:
    """Return one B-scan of ``axsun-oct``, (depth, A-scan)."""
    return np.fromfile(path, np.uint8).reshape(-1, 1024).T


def swept_source(folder: Path) -> tuple[list[Region], float]:
    """Return the regions of both files, and the dB a count stands for if they are fully developed speckle."""
    values = {
        f"{name.split('_')[0]}, {what}": bscan(folder / name)[place].astype(np.float64).ravel()
        for name, places in REGIONS.items()
        for what, place in places.items()
    }
    share = (np.arange(400) + 0.5) / 400
    ideal_db = 10 * np.log10(-np.log(1 - share))
    quantiles = {name: np.quantile(of, share, method="hazen") for name, of in values.items()}

    def model(scale: float, level: float) -> Coordinates:
        return np.clip(scale * (ideal_db + level), 0, 255)

    def misfit(free: Coordinates) -> Coordinates:
        return np.concatenate([model(free[0], m) - q for m, q in zip(free[1:], quantiles.values(), strict=True)])

    fit = least_squares(misfit, np.r_[5.0, [of.mean() / 5 + 2 for of in values.values()]])
    scale = float(fit.x[0])
    regions = []
    for (name, of), m in zip(values.items(), fit.x[1:], strict=True):
        intensity = 10 ** (of / scale / 10)
        regions.append(
            Region(
                name=name,
                mean=float(of.mean()),
                sigma=float(of.std()),
                skew=skew_of(of),
                cut=float(np.mean(of == 0)),
                model_skew=skew_of(model(scale, m)),
                contrast=float(intensity.std() / intensity.mean()),
                misfit=float(np.sqrt(np.mean((model(scale, m) - quantiles[name]) ** 2))),
            )
        )
    return regions, 1 / scale


def coronary(folder: Path) -> tuple[float, float, float]:
    """Return mean, standard deviation and skew, in counts, of tissue 20–40 px behind the wall, less its local mean."""
    volume = tifffile.imread(folder / "pullback.tif")[::3].astype(np.float64)
    behind = np.arange(volume.shape[1])[None, :, None] - np.load(folder / "lumen_px.npy")[::3, None, :]
    trend = np.stack([uniform_filter(page, (15, 25), mode=("nearest", "wrap")) for page in volume])
    use = (behind > 20) & (behind < 40) & (trend > 90)  # a wire's shadow is dark
    left = (volume - trend)[use]
    return float(volume[use].mean()), float(left.std()), skew_of(left)
