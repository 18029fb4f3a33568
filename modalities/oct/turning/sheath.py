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
    direction = np.zeros((3, n))
    pattern = _Pattern.of(depth_mm.size)
    pattern.add(*_seen(slices[middle], faces.capillary.circle(middle), depth_mm, clear_mm), 0.0)
    for blur in BLURS:
        rate = pattern.rate(*blur)
        pattern = _Pattern.of(depth_mm.size)
        for i in range(n):
            points, covered = _seen(slices[i], faces.capillary.circle(i), depth_mm, clear_mm)
            direction[:, i] = _turned(points, covered, rate)
            pattern.add(points, covered, direction[0, i])
    apart = wrap_rad(direction[1] - direction[2]) / 2
    usual = robust_sigma(apart)
    return Mark(wrap_rad(direction[0]), np.hypot(usual, apart) / np.sqrt(2)) if usual < RIGID_RAD else None


def _n_lines(slices: Sequence[SliceFeatures], faces: Faces, mm_per_px: float) -> int:
    """How many lines are seen off the axis before the outer face that do not move along with it, as the inner does."""
    depths = line_depths_mm(Lines.together([features.lines for features in slices]), mm_per_px)
    count = 0
    for depth in depths[depths < faces.typical_axis_mm - SAME_LINE_MM]:
        found = [features.lines.strongest_near(float(depth), SAME_LINE_MM) for features in slices]
        offset = np.array([complex(np.nan, np.nan) if one is None else complex(one.x_mm, one.y_mm) for one in found])
        seen = np.isfinite(offset)
        if np.mean(seen) < LEAST_PRESENCE or np.median(np.abs(offset[seen])) <= LEAST_OFFSET_MM:
            continue
        along = offset[seen] - (faces.capillary.x_mm + 1j * faces.capillary.y_mm)[seen]
        count += bool(np.median(np.abs(along)) > SAME_LINE_MM)
    return count


def _seen(features: SliceFeatures, face: Circle, depth_mm: Coordinates, clear_mm: float) -> tuple[Field, Field]:
    """The points over angle and depth, and where there might be any: before the capillary's inner face."""
    points = features.points.where(features.points.beyond_mm(face) < -clear_mm)
    column = np.mod(points.angle_rad, 2 * np.pi) * (N_ANGLES / (2 * np.pi))
    row = points.depth_mm / BIN_MM
    inside = (row >= 0) & (row < depth_mm.size - 1)
    column, row, strength = column[inside], row[inside], points.strength[inside]
    first, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
    density = np.zeros((N_ANGLES, depth_mm.size))
    for across, share in ((0, 1 - column + first), (1, column - first)):
        for down, part in ((0, 1 - row + top), (1, row - top)):
            np.add.at(density, ((first + across) % N_ANGLES, top + down), strength * share * part)
    angle = 2 * np.pi * np.arange(N_ANGLES) / N_ANGLES
    return density, (depth_mm < face.depth_mm(angle)[:, None] - clear_mm).astype(np.float64)


@dataclass(frozen=True, eq=False)
class _Pattern:
    """Sums over slices, in the landmark's frame: spectra, over the angle, of ``points`` and of where they were seen."""

    points: NDArray[np.complex128]
    covered: NDArray[np.complex128]

    @classmethod
    def of(cls, n_depth: int) -> "_Pattern":
        shape = (N_ANGLES // 2 + 1, n_depth)
        return cls(np.zeros(shape, np.complex128), np.zeros(shape, np.complex128))

    def add(self, points: Field, covered: Field, direction_rad: float) -> None:
        """Add a slice in whose own frame the landmark is seen at ``direction_rad``, in place."""
        turn = np.exp(1j * np.arange(len(self.points)) * direction_rad)[:, None]
        for total, part in ((self.points, points), (self.covered, covered)):
            total += np.fft.rfft(part, axis=0) * turn

    def rate(self, along_mm: float, around_rad: float) -> Field:
        """Return how many points there are in a column and bin, blurred, float64 (N_ANGLES, n_depth)."""
        blur = np.exp(-0.5 * (np.arange(len(self.points)) * around_rad) ** 2)[:, None]
        points, covered = (
            np.maximum(gaussian_filter1d(np.fft.irfft(total * blur, n=N_ANGLES, axis=0), along_mm / BIN_MM, axis=1), 0)
            for total in (self.points, self.covered)
        )
        return np.asarray(points / np.maximum(covered, 0.05 * covered.max()))


def _turned(points: Field, covered: Field, rate: Field) -> tuple[float, float, float]:
    """Where a slice sees the landmark, rad: by all of it, and by either half. The likeliest, if points are Poisson."""
    likely = np.log(rate + STRAY_RATE)
    log_spectrum, rate_spectrum = np.fft.rfft(likely, axis=0), np.fft.rfft(rate, axis=0)
    half = np.arange(N_ANGLES) * SECTORS // N_ANGLES % 2 == 0
    found = []
    for part in (np.ones(N_ANGLES, np.bool_), half, ~half):
        seen = np.fft.rfft(points * part[:, None], axis=0), np.fft.rfft(covered * part[:, None], axis=0)
        spectrum = np.sum(np.conj(seen[0]) * log_spectrum - np.conj(seen[1]) * rate_spectrum, axis=1)
        likelihood = np.fft.irfft(spectrum, n=N_ANGLES)
        k = int(np.argmax(likelihood))
        before, here, after = likelihood[[k - 1, k, (k + 1) % N_ANGLES]]
        sub = 0.5 * (before - after) / min(before - 2 * here + after, -1e-12)
        found.append(-(k + sub) * 2 * np.pi / N_ANGLES)
    return found[0], found[1], found[2]
