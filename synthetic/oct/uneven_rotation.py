"""How the catheter turns: unevenly, sticking and slipping; and the blocks of A-scans that the recorder drops."""

import numpy as np
from numpy.random import Generator

from endoct.base.arrays import Coordinates
from endoct.synthetic.sample.oct_parameters import LostAscans
from endoct.synthetic.sample.parameter_fields import Harmonic
from endoct.synthetic.sample.presets import Preset
from endoct.synthetic.sample.randomness import drift

TURN_SAMPLES = 360  # of a course over a turn
STICK_ORDERS = 24  # harmonics of a turn that sticks and slips
SLIP_RAD = 0.1  # over which it catches up


def rotation_error(rng: Generator, n: int, peak_rad: float, stick_slip: float) -> tuple[tuple[Harmonic, ...], ...]:
    """Return the harmonics of every slice's error: the pattern of a bent, rubbing catheter changes slowly.

    The first few bend it; those of a share ``stick_slip`` of the peak let it stick and slip.
    """
    orders = np.arange(1, 5)
    pattern = rng.normal(size=(orders.size, 2))
    courses = np.stack([drift(rng, n) for _ in range(2 * orders.size)], axis=1).reshape(n, orders.size, 2)
    bending = (pattern + 0.35 * courses + 0.06 * rng.normal(size=courses.shape)) / orders[:, None]
    sticking = _stick_slip(rng, n)
    error = (1 - stick_slip) * np.pad(bending / _peak(bending), ((0, 0), (0, STICK_ORDERS - orders.size), (0, 0)))
    error += stick_slip * sticking / _peak(sticking)
    error *= peak_rad / _peak(error)
    return tuple(tuple((float(cos), float(sin)) for cos, sin in of_slice) for of_slice in error)


def _stick_slip(rng: Generator, n: int) -> Coordinates:
    """Return the harmonics (n, order, 2) of a catheter that sticks at one to three places a turn and slips on.

    From slice to slice the places move a little, and so does how long it sticks.
    """
    turn = 2 * np.pi * np.arange(TURN_SAMPLES) / TURN_SAMPLES
    lag = np.zeros((n, TURN_SAMPLES))
    for _ in range(int(rng.integers(1, 4))):
        begins = rng.uniform(0, 2 * np.pi) + 0.2 * drift(rng, n) + 0.02 * rng.normal(size=n)
        lasts = rng.uniform(0.4, 1.0) * (1 + 0.2 * drift(rng, n))
        depth = rng.uniform(0.5, 1) * (1 + 0.3 * drift(rng, n))
        since = np.mod(turn - begins[:, None], 2 * np.pi)
        behind = np.clip(since / lasts[:, None], 0, 1) - np.clip((since - lasts[:, None]) / SLIP_RAD, 0, 1)
        lag -= depth[:, None] * behind
    spectrum = np.fft.rfft(lag, axis=1)[:, 1 : STICK_ORDERS + 1] * (2 / TURN_SAMPLES)
    spectrum *= np.exp(-0.5 * (2 * np.arange(1, STICK_ORDERS + 1) / STICK_ORDERS) ** 2)
    return np.stack([spectrum.real, -spectrum.imag], axis=2)


def _peak(harmonics: Coordinates) -> float:
    """Return the largest value of all courses (n, order, 2)."""
    orders, turn = np.arange(1, harmonics.shape[1] + 1), np.linspace(0, 2 * np.pi, TURN_SAMPLES, endpoint=False)
    waves = np.stack([np.cos(np.outer(orders, turn)), np.sin(np.outer(orders, turn))], axis=1)
    return float(np.abs(np.einsum("nkc,kct->nt", harmonics, waves)).max())


def lost_ascans(rng: Generator, size: Preset, mean: float) -> tuple[LostAscans, ...]:
    """Return the blocks that the recorder dropped, 0.2–1 % of a turn each, at most one a slice."""
    slices = rng.permutation(size.n_slices)[: min(size.n_slices, int(rng.poisson(mean)))]
    return tuple(
        LostAscans(
            slice_index=int(k),
            ascan=int(rng.integers(1, size.n_ascans)),
            count=max(1, round(rng.uniform(0.002, 0.01) * size.n_ascans)),
        )
        for k in sorted(slices)
    )
