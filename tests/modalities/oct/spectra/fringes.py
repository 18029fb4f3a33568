"""Spectra of single reflectors, by their formula."""

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, ZERO_DB
from endoct.modalities.oct.spectra.reconstruction import Reconstruction, reconstruction, sample_places, taps, window

Array = NDArray[np.float64]
DARK, AMPLITUDE = 30000.0, 10000.0


def quadratic_chirp(n: int, bend: float = 0.2) -> Array:
    """Places that rise from 0 to n − 1, by 1 + ``bend`` a sample at first and by 1 − ``bend`` at last."""
    u = np.linspace(0, 1, n)
    return (n - 1) * (u + bend * u * (1 - u))


def chain(places: Array, interpolation: str = "cubic", shape: str = "hann", **options: object) -> Reconstruction:
    return reconstruction(taps(places, interpolation), window(shape, places), **options)


def chirped(chirp: Array, interpolation: str = "cubic", shape: str = "hann") -> Reconstruction:
    return chain(sample_places(chirp, "wavenumber"), interpolation, shape)


def mirror(at: Array, depth_px: float, phase_rad: Array | float = 0.0, n_ascans: int = 64) -> NDArray[np.uint16]:
    """Counts of a mirror ``depth_px`` deep on samples at the even wavenumbers ``at``, in A-scans of even phases."""
    ascan = np.arange(n_ascans)[:, None] * 2 * np.pi / n_ascans
    wave = np.cos(2 * np.pi * at * depth_px / at.size + phase_rad + ascan)
    return np.round(DARK + AMPLITUDE * wave).astype(np.uint16)


def levels_db(bscan: NDArray[np.uint16]) -> Array:
    return bscan / COUNTS_PER_DB + ZERO_DB


def peak_px(level_db: Array) -> float:
    """Where the level of one A-scan peaks: the parabola through its three highest samples."""
    k = int(np.argmax(level_db))
    before, at, after = level_db[k - 1 : k + 2]
    return float(k + (before - after) / (2 * (before - 2 * at + after)))
