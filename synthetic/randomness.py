"""Random numbers that depend on the seed and on what they are for, never on the order of the work."""

from enum import IntEnum

import numpy as np
from numpy.random import Generator, SeedSequence
from scipy import fft

from endoct.stitching.arrays import Image


class Stage(IntEnum):
    """What a stream of random numbers is for."""

    DRAW = 0
    WALL = 1
    OCT = 2
    ENDOSCOPE = 3
    BORE = 4


def generator(seed: int, stage: Stage, index: int = 0) -> Generator:
    """Return the generator of one slice, one frame or one map."""
    return np.random.default_rng(SeedSequence(seed, spawn_key=(int(stage), index)))


def smooth_field(rng: Generator, shape: tuple[int, int], sigma_rows: float, sigma_columns: float) -> Image:
    """Return a Gaussian random field, float32, mean 0, rms 1, cyclic along both axes.

    It is white noise blurred by a Gaussian of the given sigmas in samples.
    """
    spectrum = fft.rfft2(rng.standard_normal(shape, dtype=np.float32))
    rows = 2 * np.pi * fft.fftfreq(shape[0])[:, None]
    columns = 2 * np.pi * fft.rfftfreq(shape[1])[None, :]
    spectrum *= np.exp(-0.5 * ((sigma_rows * rows) ** 2 + (sigma_columns * columns) ** 2)).astype(np.float32)
    spectrum[0, 0] = 0
    field: Image = fft.irfft2(spectrum, s=shape).astype(np.float32)
    field /= np.sqrt(np.mean(np.square(field, dtype=np.float64)))
    return field
