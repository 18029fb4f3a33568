"""The catheter's own sheath as a landmark that does not turn with the optics.

The sheath is drawn from off its axis: lines and bands of speckle whose depth wavers once a turn, by some pixels. Where
it does so stays put while the catheter is pulled, so that in a turn that starts later it is seen earlier. All that is
bright before the capillary makes one pattern over angle and depth; each slice is turned so that its points are
likeliest in the pattern of all. Lines that cross, fade or run into the speckle behind them need not be told apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from endoct.modalities.oct.face.circle import Circle
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.glass import GLASS_INDEX, Glass
from endoct.modalities.oct.face.lines import Lines
from endoct.modalities.oct.face.neighbours import LEAST_OFFSET_MM
from endoct.modalities.oct.face.outer_line import SAME_LINE_MM, line_depths_mm
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.stitching.arrays import Coordinates
from endoct.stitching.circle import wrap_rad
from endoct.stitching.compiled import compiled
from endoct.stitching.robust import robust_sigma

LEAST_PRESENCE = 0.6
FEWEST_LINES = 2  # one alone may be anything
CLEAR_MM = 0.04  # before the capillary's inner face
N_ANGLES, BIN_MM = 256, 0.003
BLURS = ((0.012, 0.2), (0.008, 0.15), (0.005, 0.1), (0.004, 0.08), (0.003, 0.05))
"""Of the pattern, round by round: standard deviations along depth, mm, and around the turn, rad."""
STRAY_RATE = 0.02  # points in a column and bin, of any pattern
SECTORS = 16  # taken by turns for one half and for the other, each of which says where the turn starts
RIGID_RAD = 0.08
Field = NDArray[np.float64]
Spectra = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Mark:
    """Direction (n,) of a landmark in each slice's own frame, NaN where it is not seen, with its standard deviation."""

    direction_rad: Coordinates
    sigma_rad: Coordinates


def sheath_mark(slices: Sequence[SliceFeatures], faces: Faces, glass: Glass, mm_per_px: float) -> Mark | None:
    """Return the direction of the sheath's pattern, or None where fewer than two lines or no clear pattern are seen.

    Its standard deviation is by how much two halves of a slice, in sectors by turns, differ.
    """
    if _n_lines(slices, faces, mm_per_px) < FEWEST_LINES:
        return None
    reach_mm = faces.typical_axis_mm + faces.capillary.radius_mm
    clear_mm = glass.thickness_mm * GLASS_INDEX / glass.medium_index + CLEAR_MM
    depth_mm = np.arange(0, reach_mm - clear_mm, BIN_MM)
    middle, n = len(slices) // 2, len(slices)

    def seen(i: int) -> _Sight:
        return _seen(slices[i], faces.capillary.circle(i), depth_mm, clear_mm)

    direction = np.zeros((3, n))
    pattern = _Pattern.of(depth_mm.size)
    pattern.add(seen(middle), 0.0)
    for blur in BLURS:
        likelihood = _Likelihood.of(pattern.rate(*blur))
        pattern = _Pattern.of(depth_mm.size)
        for i in range(n):
            sight = seen(i)
            direction[:, i] = likelihood.turned(sight)
            pattern.add(sight, direction[0, i])
    apart = wrap_rad(direction[1] - direction[2]) / 2
    usual = robust_sigma(apart)
    return Mark(wrap_rad(direction[0]), np.hypot(usual, apart) / np.sqrt(2)) if usual < RIGID_RAD else None


def _n_lines(slices: Sequence[SliceFeatures], faces: Faces, mm_per_px: float) -> int:
    """How many lines are seen off the axis before the outer face that do not move along with it, as the inner does."""
    lines = [features.lines for features in slices]
    depths = line_depths_mm(Lines.together(lines), mm_per_px)
    count = 0
    for depth in depths[depths < faces.typical_axis_mm - SAME_LINE_MM]:
        found = [of_slice.strongest_near(float(depth), SAME_LINE_MM) for of_slice in lines]
        offset = np.array([complex(np.nan, np.nan) if one is None else complex(one.x_mm, one.y_mm) for one in found])
        seen = np.isfinite(offset)
        if np.mean(seen) < LEAST_PRESENCE or np.median(np.abs(offset[seen])) <= LEAST_OFFSET_MM:
            continue
        along = offset[seen] - (faces.capillary.x_mm + 1j * faces.capillary.y_mm)[seen]
        count += bool(np.median(np.abs(along)) > SAME_LINE_MM)
    return count


@dataclass(frozen=True, eq=False)
class _Sight:
    """A slice's points over angle and depth, and where there might be any: spectra over the angle, of either half.

    complex128 (2, N_ANGLES // 2 + 1, n_depth), the sectors of one half and of the other.
    """

    points: Spectra
    covered: Spectra


def _seen(features: SliceFeatures, face: Circle, depth_mm: Coordinates, clear_mm: float) -> _Sight:
    """What is seen before the capillary's inner face."""
    points = features.points.where(features.points.beyond_mm(face) < -clear_mm)
    column = np.mod(points.angle_rad, 2 * np.pi) * (N_ANGLES / (2 * np.pi))
    density = _density(column, points.depth_mm / BIN_MM, points.strength, depth_mm.size)
    angle = 2 * np.pi * np.arange(N_ANGLES) / N_ANGLES
    covered = _covered(np.searchsorted(depth_mm, face.depth_mm(angle) - clear_mm), depth_mm.size)
    return _Sight(np.fft.rfft(density, axis=1), np.fft.rfft(covered, axis=1))


@compiled
def _density(column: Coordinates, row: Coordinates, strength: Coordinates, n_depth: int) -> Field:
    """Points over angle and depth, float64 (2, N_ANGLES, n_depth), each shared among the four bins around it."""
    density = np.zeros((2, N_ANGLES, n_depth))
    for i in range(row.size):
        if 0 <= row[i] < n_depth - 1:
            first, top = int(column[i]), int(row[i])
            across, down = column[i] - first, row[i] - top
            for to, share in ((first % N_ANGLES, 1 - across), ((first + 1) % N_ANGLES, across)):
                half = to * SECTORS // N_ANGLES % 2
                density[half, to, top] += strength[i] * share * (1 - down)
                density[half, to, top + 1] += strength[i] * share * down
    return density


@compiled
def _covered(n_before: NDArray[np.intp], n_depth: int) -> Field:
    """1 in the first ``n_before`` (N_ANGLES,) bins of every angle, 0 behind, float64 (2, N_ANGLES, n_depth)."""
    covered = np.zeros((2, N_ANGLES, n_depth))
    for angle in range(N_ANGLES):
        covered[angle * SECTORS // N_ANGLES % 2, angle, : n_before[angle]] = 1
    return covered


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Sums over slices, in the landmark's frame: spectra, over the angle, of ``points`` and of where they were seen."""

    points: NDArray[np.complex128]
    covered: NDArray[np.complex128]

    @classmethod
    def of(cls, n_depth: int) -> "_Pattern":
        shape = (N_ANGLES // 2 + 1, n_depth)
        return cls(np.zeros(shape, np.complex128), np.zeros(shape, np.complex128))

    def add(self, sight: _Sight, direction_rad: float) -> None:
        """Add a slice in whose own frame the landmark is seen at ``direction_rad``, in place."""
        turn = np.exp(1j * np.arange(len(self.points)) * direction_rad)[:, None]
        for total, halves in ((self.points, sight.points), (self.covered, sight.covered)):
            total += (halves[0] + halves[1]) * turn

    def rate(self, along_mm: float, around_rad: float) -> Field:
        """Return how many points there are in a column and bin, blurred, float64 (N_ANGLES, n_depth)."""
        blur = np.exp(-0.5 * (np.arange(len(self.points)) * around_rad) ** 2)[:, None]
        points, covered = (
            np.maximum(gaussian_filter1d(np.fft.irfft(total * blur, n=N_ANGLES, axis=0), along_mm / BIN_MM, axis=1), 0)
            for total in (self.points, self.covered)
        )
        return np.asarray(points / np.maximum(covered, 0.05 * covered.max()))


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Of a pattern: spectra over the angle of the logarithm of its rate, and of the rate itself."""

    logarithm: NDArray[np.complex128]
    rate: NDArray[np.complex128]

    @classmethod
    def of(cls, rate: Field) -> "_Likelihood":
        return cls(np.fft.rfft(np.log(rate + STRAY_RATE), axis=0), np.fft.rfft(rate, axis=0))

    def turned(self, sight: _Sight) -> list[float]:
        """Where a slice sees the landmark, rad: by all of it, and by either half; likeliest, if points are Poisson."""
        halves = _correlated(sight.points, self.logarithm) - _correlated(sight.covered, self.rate)
        found = []
        for spectrum in (halves[0] + halves[1], *halves):
            likelihood = np.fft.irfft(spectrum, n=N_ANGLES)
            k = int(np.argmax(likelihood))
            before, here, after = likelihood[[k - 1, k, (k + 1) % N_ANGLES]]
            sub = 0.5 * (before - after) / min(before - 2 * here + after, -1e-12)
            found.append(-(k + sub) * 2 * np.pi / N_ANGLES)
        return found


@compiled
def _correlated(halves: Spectra, pattern: Spectra) -> Spectra:
    """Spectra over the angle of the correlation of both ``halves`` with ``pattern``, summed over depth: (2, n)."""
    correlated = np.zeros(halves.shape[:2], np.complex128)
    for half in range(halves.shape[0]):
        for wave in range(halves.shape[1]):
            for row in range(halves.shape[2]):
                correlated[half, wave] += np.conj(halves[half, wave, row]) * pattern[wave, row]
    return correlated
