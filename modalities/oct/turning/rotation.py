"""How the catheter really turned while a B-scan was recorded.

A-scans are counted evenly, the optics do not turn evenly. A beam recorded at the nominal angle a = 2πk/n points, in
the frame of its slice, at

    α(a) = a + stretch·(a − π) + Σ_h [c_h cos(h a) + s_h sin(h a)] + lost·(a ≥ lost_at)

and at start + α(a) in the frame that all slices share: ``start``, where the turn starts; ``stretch``, the turn's length
less one; the sum, the smooth error that friction makes; ``lost``, the angle of a block of A-scans never written.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.least_squares import harmonics

HARMONICS = 4
N_SMOOTH = 2 * HARMONICS
TABLE = 2048


@dataclass(frozen=True, eq=False)
class Rotation:
    """The rotation of every slice, in recording order; n = number of slices, angles in rad.

    Attributes
    ----------
    start_rad: float64 (n,), where turns start, up to one angle common to all.
    stretch: float64 (n,), length of the recorded turn over 2π, less one.
    smooth_rad: float64 (n, 2·HARMONICS), c_1, s_1, c_2, s_2, …
    lost_at_rad, lost_rad: float64 (n,), nominal angle at which A-scans are missing (NaN where none are) and how many.
    shape_known, start_known: bool (n,), whether they could be measured; where not, the correction is 0.
    shape_sigma_rad: float64 (n,), standard deviation of α(a), root mean square over the turn; NaN where not known.
    start_sigma_rad: float64 (n,), standard deviation of the start relative to the other slices. It grows along z where
        only neighbours can be compared. NaN where not known.
    """

    start_rad: Coordinates
    stretch: Coordinates
    smooth_rad: Coordinates
    lost_at_rad: Coordinates
    lost_rad: Coordinates
    shape_known: Mask
    start_known: Mask
    shape_sigma_rad: Coordinates
    start_sigma_rad: Coordinates

    def beam_rad(self, index: int, nominal_rad: Coordinates) -> Coordinates:
        """Return α at nominal angles within the turn, rad; ascending with them but for errors of the estimate."""
        error = self.error_rad(index, nominal_rad)
        return np.asarray(nominal_rad + error)

    def error_rad(self, index: int, nominal_rad: Coordinates) -> Coordinates:
        """Return α(a) − a at nominal angles, rad, of their shape."""
        lost_at = self.lost_at_rad[index]
        nominal = np.asarray(nominal_rad, np.float64)
        error = _error(nominal.ravel(), self.stretch[index], self.smooth_rad[index], lost_at, self.lost_rad[index])
        return error.reshape(nominal.shape)

    def nominal_rad(self, index: int, beam_rad: Coordinates, n_ascans: int) -> tuple[Coordinates, Mask]:
        """Return the nominal angle in [−π/n, 2π − π/n) at which beams α were recorded, and whether they were.

        A long turn records a direction twice, at its start and at its end. It is taken from where it lies farther from
        the turn's ends. One never recorded, in the gap of a short turn or of a lost block, gets the nearest angle and
        ``False``. Gaps narrower than one A-scan do not count.
        """
        if self._even(index):
            return np.mod(beam_rad, 2 * np.pi), np.ones(beam_rad.shape, bool)
        half = np.pi / n_ascans
        at = np.linspace(-half, 2 * np.pi - half, TABLE + 1)
        if np.isfinite(self.lost_at_rad[index]):
            at = np.sort(np.append(at, [self.lost_at_rad[index] - 1e-9, self.lost_at_rad[index]]))
        reached = np.maximum.accumulate(self.beam_rad(index, at))
        wanted = np.mod(beam_rad - reached[0], 2 * np.pi) + reached[0]
        nominal = np.interp(wanted, reached, at)
        again = wanted + 2 * np.pi <= reached[-1]
        second = np.interp(wanted + 2 * np.pi, reached, at)
        nominal = np.where(again & (np.abs(second - np.pi) < np.abs(nominal - np.pi)), second, nominal)
        missing = wanted - reached[-1]
        recorded = missing < 2 * half
        before_start = (reached[0] + 2 * np.pi - wanted) < missing
        nominal = np.where(~recorded & before_start, at[0], nominal)
        if np.isfinite(self.lost_at_rad[index]):
            beyond = float(self.beam_rad(index, np.array([self.lost_at_rad[index]]))[0])
            gap = beyond - wanted
            recorded &= ~((gap > 2 * half) & (gap < self.lost_rad[index]))
        return nominal, recorded

    def reordered(self, order: NDArray[np.intp]) -> "Rotation":
        """Return the same rotation with slice ``order[i]`` in place i."""
        return Rotation(**{name: values[order] for name, values in vars(self).items()})

    def peak_rad(self) -> Coordinates:
        """Return the largest departure of α(a) from a over each slice's turn, its mean taken off, float64 (n,)."""
        at = np.linspace(0, 2 * np.pi, 180, endpoint=False)
        errors = np.array([self.error_rad(i, at) for i in range(self.stretch.size)])
        return np.asarray(np.abs(errors - errors.mean(axis=1, keepdims=True)).max(axis=1))

    def _even(self, index: int) -> bool:
        return (
            self.stretch[index] == 0 and not self.smooth_rad[index].any() and not np.isfinite(self.lost_at_rad[index])
        )


@compiled
def _error(
    nominal_rad: Coordinates, stretch: float, smooth_rad: Coordinates, lost_at_rad: float, lost_rad: float
) -> Coordinates:
    error = np.empty(nominal_rad.size)
    for i in range(nominal_rad.size):
        angle = nominal_rad[i]
        error[i] = stretch * (angle - math.pi)
        cos, sin = math.cos(angle), math.sin(angle)
        re, im = 1.0, 0.0
        for h in range(HARMONICS):
            re, im = re * cos - im * sin, re * sin + im * cos
            error[i] += smooth_rad[2 * h] * re + smooth_rad[2 * h + 1] * im
        if angle >= lost_at_rad:  # never where it is NaN
            error[i] += lost_rad
    return error


def even_rotation(n_slices: int) -> Rotation:
    """Return the rotation that corrects nothing: turns that are even, complete and start at one angle."""
    zeros, unknown, nan = np.zeros(n_slices), np.zeros(n_slices, bool), np.full(n_slices, np.nan)
    return Rotation(zeros, zeros, np.zeros((n_slices, N_SMOOTH)), nan, zeros, unknown, unknown, nan, nan)


def smooth_basis(nominal_rad: Coordinates) -> Coordinates:
    """Return what ``stretch`` and then ``smooth_rad`` are the factors of, float64 (n, 1 + N_SMOOTH)."""
    return np.concatenate([nominal_rad[:, None] - np.pi, harmonics(nominal_rad, range(1, HARMONICS + 1))], axis=1)
