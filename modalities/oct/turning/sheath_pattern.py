"""The pattern that points of all slices make over angle and depth, and how far one slice is turned against it.

Turns are those of spectra over the angle, so that no pattern is interpolated. A slice has points at a quarter of all
depths: others have no spectra. Which bins were seen at all is a number a direction, that of the bins before the
capillary; it is never drawn as an image.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from endoct.stitching.arrays import Coordinates
from endoct.stitching.compiled import compiled

N_ANGLES, BIN_MM = 256, 0.003
STRAY_RATE = 0.02  # points in a column and bin, of any pattern
SECTORS = 16  # taken by turns for one half and for the other, each of which says where the turn starts
Field = NDArray[np.float64]
Spectra = NDArray[np.complex128]
_WAVES = np.arange(N_ANGLES // 2 + 1)
_OF_ANGLES: Spectra = np.exp(-2j * np.pi * np.arange(N_ANGLES)[:, None] * _WAVES / N_ANGLES)
"""The spectra of a one at every single angle, (N_ANGLES, waves)."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What a slice shows before the capillary: points, and where there might be any.

    Attributes: ``column`` (0 to N_ANGLES, in its own frame), ``row`` (in bins of depth) and ``strength`` of the points,
    float64 (n,); ``n_covered`` intp (N_ANGLES,), bins of depth before the capillary.
    """

    column: Coordinates
    row: Coordinates
    strength: Coordinates
    n_covered: NDArray[np.intp]

    def halves(self, n_depth: int) -> "Halves":
        """Return the points as spectra over the angle."""
        rows, density = _density(self.column, self.row, self.strength, n_depth)
        return Halves(rows, np.fft.rfft(density))


class Halves(NamedTuple):
    """A slice's points as spectra over the angle, (2, n, waves), at the n ``rows`` that have any.

    The first half is of every other sector, the second of the rest.
    """

    rows: NDArray[np.intp]
    spectra: Spectra


@dataclass(frozen=True, eq=False)
class Pattern:
    """Sums over slices, in the landmark's frame, as spectra over the angle.

    Attributes: ``points`` (n_depth, waves); ``ends`` (n_depth + 1, waves), of the directions in which as many bins were
    seen.
    """

    points: Spectra
    ends: Spectra

    @classmethod
    def of(cls, n_depth: int) -> "Pattern":
        """Return the pattern of no slice."""
        return cls(*(np.zeros((rows, _WAVES.size), np.complex128) for rows in (n_depth, n_depth + 1)))

    def add(self, sight: Sight, halves: Halves, direction_rad: float) -> None:
        """Add a slice with its ``halves``, in whose own frame the landmark is seen at ``direction_rad``, in place."""
        turn = np.exp(1j * _WAVES * direction_rad)
        _add_turned(self.points, self.ends, halves, sight.n_covered, _OF_ANGLES, turn)

    def rate(self, along_mm: float, around_rad: float) -> Field:
        """Return how many points there are in a column and bin, blurred, float64 (n_depth, N_ANGLES)."""
        covered = np.cumsum(self.ends[::-1], axis=0)[-2::-1]  # a bin was seen where more than those before it were
        blur = np.exp(-0.5 * (_WAVES * around_rad) ** 2)
        points, seen = (
            np.maximum(gaussian_filter1d(np.fft.irfft(total * blur, n=N_ANGLES), along_mm / BIN_MM, axis=0), 0)
            for total in (self.points, covered)
        )
        return np.asarray(points / np.maximum(seen, 0.05 * seen.max()))


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Of a pattern.

    Attributes: ``logarithm`` (n_depth, waves), spectra over the angle of the logarithm of its rate; ``expected``
    float64 (n_depth + 1, N_ANGLES), how many points the first bins hold.
    """

    logarithm: Spectra
    expected: Field

    @classmethod
    def of(cls, rate: Field) -> "Likelihood":
        """Return that of a :meth:`Pattern.rate`."""
        return cls(np.fft.rfft(np.log(rate + STRAY_RATE)), np.pad(np.cumsum(rate, axis=0), ((1, 0), (0, 0))))

    def turned(self, sight: Sight, halves: Halves) -> list[float]:
        """Return where a slice most likely sees the landmark, rad: by all of it, and by either half."""
        of_points = np.fft.irfft(_correlated(halves, self.logarithm), n=N_ANGLES)
        likelihoods = of_points - _expected(self.expected, sight.n_covered)
        found = []
        for likelihood in (likelihoods[0] + likelihoods[1], *likelihoods):
            k = int(np.argmax(likelihood))
            before, here, after = likelihood[[k - 1, k, (k + 1) % N_ANGLES]]
            sub = 0.5 * (before - after) / min(before - 2 * here + after, -1e-12)
            found.append(-(k + sub) * 2 * np.pi / N_ANGLES)
        return found


@compiled
def _density(
    column: Coordinates, row: Coordinates, strength: Coordinates, n_depth: int
) -> tuple[NDArray[np.intp], Field]:
    """Rows that have points, and these, each shared among the four bins around it, float64 (2, n, N_ANGLES)."""
    filled = np.zeros(n_depth, np.bool_)
    for i in range(row.size):
        if 0 <= row[i] < n_depth - 1:
            filled[int(row[i]) : int(row[i]) + 2] = True
    rows = np.flatnonzero(filled)
    place = np.cumsum(filled) - 1
    density = np.zeros((2, rows.size, N_ANGLES))
    for i in range(row.size):
        if 0 <= row[i] < n_depth - 1:
            first, top = int(column[i]), int(row[i])
            across, down, at = column[i] - first, row[i] - top, place[top]
            for to, share in ((first % N_ANGLES, 1 - across), ((first + 1) % N_ANGLES, across)):
                half = to * SECTORS // N_ANGLES % 2
                density[half, at, to] += strength[i] * share * (1 - down)
                density[half, at + 1, to] += strength[i] * share * down
    return rows, density


@compiled
def _add_turned(
    points: Spectra, ends: Spectra, halves: Halves, n_covered: NDArray[np.intp], of_angles: Spectra, turn: Spectra
) -> None:
    """Add both ``halves`` of a slice's points, and where it ends, turned by ``turn`` (waves,)."""
    for k in range(halves.rows.size):
        for wave in range(turn.size):
            points[halves.rows[k], wave] += (halves.spectra[0, k, wave] + halves.spectra[1, k, wave]) * turn[wave]
    for angle in range(n_covered.size):
        for wave in range(turn.size):
            ends[n_covered[angle], wave] += of_angles[angle, wave] * turn[wave]


@compiled
def _correlated(halves: Halves, pattern: Spectra) -> Spectra:
    """Spectra over the angle of the correlation of both ``halves`` with ``pattern``, summed over depth: (2, waves)."""
    spectra = halves.spectra
    correlated = np.zeros((2, spectra.shape[2]), np.complex128)
    for half in range(2):
        for k in range(halves.rows.size):
            row = halves.rows[k]
            for wave in range(spectra.shape[2]):
                correlated[half, wave] += np.conj(spectra[half, k, wave]) * pattern[row, wave]
    return correlated


@compiled
def _expected(within: Field, n_covered: NDArray[np.intp]) -> Field:
    """How many points the pattern expects in what either half shows, float64 (2, N_ANGLES), by how far it is turned."""
    expected = np.zeros((2, N_ANGLES))
    for angle in range(N_ANGLES):
        half, row = angle * SECTORS // N_ANGLES % 2, n_covered[angle]
        for turned in range(N_ANGLES - angle):
            expected[half, turned] += within[row, angle + turned]
        for turned in range(N_ANGLES - angle, N_ANGLES):
            expected[half, turned] += within[row, angle + turned - N_ANGLES]
    return expected
