"""The columns of one slice on the ring they were taken on, and what changes smoothly around it."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.random import Generator
from scipy import fft

from endoct.stitching.arrays import Coordinates, Image

AROUND = 1024  # places around a turn at which what changes smoothly is drawn


@dataclass(frozen=True, eq=False)
class Turn:
    """The columns of one slice, around the ring they were taken on.

    ``n_ring``: columns to a full turn, after which a beam meets the same bone again. ``first``: place on that ring
    of the first column, negative where it lies before the slice's first A-scan.
    """

    n_ring: int
    first: int
    n: int


def around(rng: Generator, turn: Turn, sigma_turns: float) -> Coordinates:
    """Return a smooth random course around the ring, rms 1, at every column."""
    spectrum = fft.rfft(rng.standard_normal(AROUND, dtype=np.float32))
    spectrum *= _smoothing(sigma_turns)
    course = fft.irfft(spectrum)
    course /= np.sqrt(np.mean(np.square(course, dtype=np.float64)))
    place = np.mod((turn.first + np.arange(turn.n)) * (AROUND / turn.n_ring), AROUND)
    values: Coordinates = np.interp(place, np.arange(AROUND + 1), np.append(course, course[0]))
    return values


@lru_cache(maxsize=16)
def _smoothing(sigma_turns: float) -> Image:
    """Return what a Gaussian leaves of each frequency around the ring, and nothing of the mean."""
    left = np.exp(-0.5 * (2 * np.pi * sigma_turns * np.arange(AROUND // 2 + 1)) ** 2).astype(np.float32)
    left[0] = 0
    left.flags.writeable = False
    return np.asarray(left)
