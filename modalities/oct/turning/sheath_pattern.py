"""The catheter's own sheath as a landmark that does not turn with the optics, and its pattern in all slices.

The sheath is drawn from off its axis: lines and bands of speckle whose depth wavers once a turn, by some pixels.
Where it does so stays put while the catheter is pulled, so that in a turn that starts later it is seen earlier. All
that is bright before the capillary makes one pattern over angle and depth. Each slice is turned so that its points
are likeliest in the pattern of all. Lines that cross, fade or run into the speckle behind them need not be
separated.

Turns are those of spectra over the angle, so that no pattern is interpolated. A slice has points at a quarter of
all depths: others have no spectra. Which bins were seen at all is a number a direction, that of the bins before the
capillary; it is never drawn as an image.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from endoct.base.arrays import Coordinates
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Kept
from endoct.base.numeric.circle import wrap_rad
from endoct.base.numeric.least_squares import vertex
from endoct.base.numeric.ranks import robust_sigma
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.face.faces import LEAST_OFFSET_MM, SAME_LINE_MM, Faces, line_depths_mm
from endoct.modalities.oct.face.glass import GLASS_INDEX, Glass
from endoct.modalities.oct.face.lines import Lines
from endoct.modalities.oct.face.slices import SliceFeatures

N_ANGLES, BIN_MM = 256, 0.003
STRAY_RATE = 0.02
"""Whatever the pattern, so many points stray into a column and bin."""
SECTORS = 16
"""They are taken by turns for one half and for the other, each of which says where the turn starts."""
Field = NDArray[np.float64]
Spectra = NDArray[np.complex128]
_WAVES = np.arange(N_ANGLES // 2 + 1)
_OF_ANGLES: Spectra = np.exp(-2j * np.pi * np.arange(N_ANGLES)[:, None] * _WAVES / N_ANGLES)
"""The spectra of a one at every single angle, (N_ANGLES, waves)."""
LEAST_PRESENCE = 0.6
FEWEST_LINES = 2  # one alone may be anything
CLEAR_MM = 0.04  # before the capillary's inner face
BLURS = ((0.012, 0.2), (0.008, 0.15), (0.005, 0.1), (0.004, 0.08), (0.003, 0.05))
"""The pattern is blurred round by round by these standard deviations: along depth, mm, and around the turn, rad."""
RIGID_RAD = 0.08


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
            sub = float(vertex(*likelihood[[k - 1, k, (k + 1) % N_ANGLES]]))
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
            filled[int(row[i])] = filled[int(row[i]) + 1] = True
    rows, place = np.empty(n_depth, np.intp), np.empty(n_depth, np.intp)
    n_filled = 0
    for k in range(n_depth):
        if filled[k]:
            rows[n_filled], place[k] = k, n_filled
            n_filled += 1
    density = np.zeros((2, n_filled, N_ANGLES))
    for i in range(row.size):
        if 0 <= row[i] < n_depth - 1:
            first, top = int(column[i]), int(row[i])
            across, down, at = column[i] - first, row[i] - top, place[top]
            for to, share in ((first % N_ANGLES, 1 - across), ((first + 1) % N_ANGLES, across)):
                half = to * SECTORS // N_ANGLES % 2
                density[half, at, to] += strength[i] * share * (1 - down)
                density[half, at + 1, to] += strength[i] * share * down
    return rows[:n_filled], density


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
    direction = np.zeros((3, len(slices)))
    with Kept[Sight]() as sights:
        for i, features in enumerate(slices):
            sights.append(_sight(features, faces.capillary.circle(i), depth_mm, clear_mm))
        pattern = Pattern.of(depth_mm.size)
        middle = sights[len(sights) // 2]
        pattern.add(middle, middle.halves(depth_mm.size), 0.0)
        for blur in BLURS:
            likelihood = Likelihood.of(pattern.rate(*blur))
            pattern = Pattern.of(depth_mm.size)
            for i, sight in enumerate(sights):
                halves = sight.halves(depth_mm.size)
                direction[:, i] = likelihood.turned(sight, halves)
                pattern.add(sight, halves, direction[0, i])
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


def _sight(features: SliceFeatures, face: Circle, depth_mm: Coordinates, clear_mm: float) -> Sight:
    """What is seen before the capillary's inner face."""
    points = features.points.where(features.points.beyond_mm(face) < -clear_mm)
    angle = 2 * np.pi * np.arange(N_ANGLES) / N_ANGLES
    return Sight(
        column=np.mod(points.angle_rad, 2 * np.pi) * (N_ANGLES / (2 * np.pi)),
        row=points.depth_mm / BIN_MM,
        strength=points.strength,
        n_covered=np.searchsorted(depth_mm, face.depth_mm(angle) - clear_mm),
    )
