"""From samples at uneven wavenumbers to even ones: which samples are read, and with which weights."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates

Interpolation = Literal["sinc", "cubic", "linear"]
N_TAPS = {"sinc": 8, "cubic": 4, "linear": 4}
KAISER_BETA = 5.0
"""The window over a sinc of 8 samples has this β. It ends where waves of 0.7 of the depth range are still whole."""
COSINES = {"hann": (0.5, 0.5), "hamming": (0.54, 0.46), "blackman": (0.42, 0.5, 0.08), "flat": (1.0,)}
"""A window is a₀ − a₁·cos 2πu + a₂·cos 4πu, u from 0 to 1 (Harris 1978)."""


@dataclass(frozen=True, eq=False)
class Taps:
    """How n even wavenumbers are read: k is the sum of ``weights[k]`` × samples ``first[k]``, ``first[k]`` + 1, ….

    Attributes: ``first``, int32 (n,), from 0 to n less the taps; ``weights``, float64 (n, taps), zero where k was not
    recorded.
    """

    first: NDArray[np.int32]
    weights: Coordinates


def sample_places(chirp: Coordinates, gives: Literal["wavenumber", "sample"]) -> Coordinates:
    """Return where each even wavenumber 0, 1, … n − 1 lies among the n samples, float64 (n,); NaN: beyond them.

    ``chirp``, float64 (n,), rises. The inverse of one that gives wavenumbers is interpolated by monotone cubics
    (Fritsch and Butland 1984).
    """
    even = np.arange(chirp.size, dtype=np.float64)
    if gives == "sample":
        return np.where((chirp >= 0) & (chirp <= chirp.size - 1), chirp, np.nan)
    from scipy.interpolate import PchipInterpolator  # takes a while to load, and other chirps do without

    return np.asarray(PchipInterpolator(chirp, even, extrapolate=False)(even), dtype=np.float64)


def taps(places: Coordinates, interpolation: Interpolation) -> Taps:
    """Return the taps that read n samples at ``places``, float64 (n,), NaN where there is nothing to read.

    Cubic: the polynomial through the four nearest samples (Lagrange). Sinc: the eight nearest, by a sinc in a Kaiser
    window, whose weights are made to sum to one. At the ends those four or eight that there are.
    """
    n, n_taps = places.size, N_TAPS[interpolation]
    recorded = np.isfinite(places)
    at = np.where(recorded, places, 0.0)
    first = np.clip(np.floor(at).astype(np.int32) - n_taps // 2 + 1, 0, n - n_taps)
    part = at - first
    nodes = np.arange(n_taps)
    if interpolation == "linear":
        weights = np.maximum(0.0, 1 - np.abs(part[:, None] - nodes))
    elif interpolation == "sinc":
        apart = part[:, None] - nodes
        weights = np.sinc(apart) * np.i0(KAISER_BETA * np.sqrt(np.clip(1 - (2 * apart / n_taps) ** 2, 0, 1)))
        weights /= weights.sum(axis=1, keepdims=True)
    else:
        weights = np.ones((n, n_taps))
        for node in nodes:
            for other in nodes[nodes != node]:
                weights[:, node] *= (part - other) / (node - other)
    return Taps(first, np.where(recorded[:, None], weights, 0.0))


def window(name: str, places: Coordinates) -> Coordinates:
    """Return the window over the even wavenumbers that were recorded, float64 (n,), zero over the others."""
    recorded = np.flatnonzero(np.isfinite(places))
    u = (np.arange(places.size) - recorded[0]) / max(1, recorded[-1] - recorded[0])
    shape = sum((-1) ** i * a * np.cos(2 * np.pi * i * u) for i, a in enumerate(COSINES[name]))
    return np.where(np.isfinite(places), shape, 0.0)


def dispersion_phase(n: int, coefficients_rad: Sequence[float]) -> Coordinates:
    """Return a·x² + b·x³ + … over n even wavenumbers, x from −1 to 1, rad, float64 (n,)."""
    return np.asarray(np.polynomial.Polynomial([0, 0, *coefficients_rad])(np.linspace(-1, 1, n)), dtype=np.float64)
