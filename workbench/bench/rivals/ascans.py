"""How the catheter turned, from which A-scans of neighbouring slices look alike.

After van Soest, Bosch and van der Steen (2008), "Azimuthal registration of image sequences affected by nonuniform
rotation distortion", IEEE Trans. Inf. Technol. Biomed. 12, 348. Every A-scan is correlated with those of the slice
before. Dynamic programming then finds the likeliest continuous course through these correlations. It cannot see what
all slices have in common. Slices of a bore are far apart, so only the capillary, the sheath and large cells look alike
in them.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.contract import FrameStream
from endoct.modalities.oct.bscan import logarithmic, sector_means
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals.turned import nominal_rad, unrolled_as_turned

MOST_ASCANS = 512
BLUR = 1.5
"""Slices are blurred by so many A-scans and rows of depth before every second row is compared."""
REACH_RAD = 0.25
"""A course may lie off the turn that fits the slice as a whole by this angle."""
STEP_COST = 1.0
"""A step by one A-scan more or less than an even turn costs so much, as a correlation."""
SMOOTH_RAD = 0.1


def ascan_correlation(recording: Path) -> Panorama:
    """Unroll a pullback with every slice warped onto the one before by which A-scans are alike."""
    return unrolled_as_turned(recording, warped_errors_rad)


def warped_errors_rad(stream: FrameStream) -> Coordinates:
    """Return by how much A-scans are off those of the first slice, float64 (n_slices, n_ascans), in recording order.

    The mean of each slice, where its turn starts, is left out: our own start angles are better.
    """
    n_ascans = len(stream[0].samples)
    shifts = [np.zeros(min(n_ascans, MOST_ASCANS))]
    before = _features(stream, 0)
    for i in range(1, len(stream)):
        here = _features(stream, i)
        shifts.append(_course(before, here))
        before = _warped(here, shifts[-1])
    turn, columns = nominal_rad(n_ascans), nominal_rad(shifts[0].size)
    errors = [np.interp(turn, columns, shift, period=2 * np.pi) for shift in shifts]
    within = np.asarray(errors) - np.mean(errors, axis=1, keepdims=True)
    return np.asarray(within * (2 * np.pi / columns.size))


def _features(stream: FrameStream, index: int) -> Image:
    """Return a slice's A-scans, float32 (at most MOST_ASCANS, depth), each of mean 0 and length 1."""
    samples = stream[index].samples
    few = sector_means(samples, min(len(samples), MOST_ASCANS))
    intensity = str(stream.acquisition.model_dump()["intensity"])
    level = np.asarray(logarithmic(few, intensity), np.float32)
    level = gaussian_filter(level, BLUR, mode=("wrap", "nearest"))[:, ::2]
    level -= level.mean(axis=0)  # what is the same all around says nothing
    level -= level.mean(axis=1, keepdims=True)
    return np.asarray(level / np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-9), np.float32)


def _course(before: Image, here: Image) -> Coordinates:
    """Return by how many A-scans each of ``here`` lies behind the one of ``before`` that it shows, float64 (n,)."""
    n = len(here)
    spectra = np.fft.rfft(before, axis=0) * np.conj(np.fft.rfft(here, axis=0))
    whole = int(np.argmax(np.fft.irfft(spectra.sum(axis=1), n=n)))
    reach = max(1, round(REACH_RAD / (2 * np.pi) * n))
    offsets = whole + np.arange(-reach, reach + 1)
    alike = np.stack([np.sum(np.roll(before, -offset, axis=0) * here, axis=1) for offset in offsets], axis=1)
    twice = _likeliest(np.concatenate([alike, alike]))  # twice around, so that the course closes
    chosen = twice[n // 2 : n // 2 + n]
    course = np.roll(offsets[chosen], n // 2).astype(np.float64)
    course = gaussian_filter1d(course, SMOOTH_RAD / (2 * np.pi) * n, mode="wrap")
    return np.asarray(course - n if whole > n // 2 else course)


def _likeliest(alike: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the column in each row of the path with the largest sum, which moves by one column at most, intp (n,)."""
    n, width = alike.shape
    came = np.zeros((n, width), np.intp)
    total = alike[0].astype(np.float64)
    columns = np.arange(width)
    for row in range(1, n):
        ways = np.full((3, width), -np.inf)
        ways[0, 1:], ways[1], ways[2, :-1] = total[:-1] - STEP_COST, total, total[1:] - STEP_COST
        best = np.argmax(ways, axis=0)
        came[row] = columns + best - 1
        total = ways[best, columns] + alike[row]
    path = np.empty(n, np.intp)
    path[-1] = int(np.argmax(total))
    for row in range(n - 1, 0, -1):
        path[row - 1] = came[row, path[row]]
    return path


def _warped(here: Image, shift: Coordinates) -> Image:
    """Return the A-scans of a slice where those of the slice before lie."""
    n = len(here)
    at = np.mod(np.arange(n) + shift, n)
    order = np.argsort(at, kind="stable")
    nearest = np.searchsorted(at[order], np.arange(n) - 0.5) % n
    return here[order[nearest]]
