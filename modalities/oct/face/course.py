"""What the outer face's course through the turn says of the capillary's size, whatever size was stated.

From off the axis by e, a beam meets a circle of radius R at a distance whose second harmonic is κe²/4, with κ = 1/R.
Where glass of thickness t and relative index n lies before it, κ = (1 − 1/n)/(R − t) + 1/(nR).
The first harmonic gives e, so the second gives R. An uneven turn moves the second harmonic too, to either side alike.
At right angles to the offset a circle has none: what is measured there says by how much.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from endoct.base.numeric.least_squares import harmonics
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.glass import GLASS_INDEX, Glass
from endoct.modalities.oct.face.points import Points, tukey_weight
from endoct.modalities.oct.face.slices import SliceFeatures

REACH_MM = 0.015, 0.009, 0.009
"""Points count up to this distance from the face, in each round of the fit."""
LEAST_COLUMNS = 60
UNEVEN_RAD = 0.01
"""All slices share a departure from even rotation, whose first harmonic usually is this large."""
LINE_MM = 0.0003
"""A line's places are bent by as much (both: `learning`, `quick`, seeds 0–5, and independent recordings)."""
UNKNOWN_GLASS = 1.05, 0.05
"""κR where the glass is not known, and its standard error: glass of 0 to 0.3 mm."""
LEAST_CERTAIN = 0.25
"""Nothing is concluded where the standard error of κ is larger."""
SURE_SIGMAS = 3.0


@dataclass(frozen=True)
class Course:
    """What the outer face's course says of it: κ with its standard error; ``glass`` is that before it, as stated."""

    kappa_per_mm: float
    sigma_per_mm: float
    glass: Glass

    @property
    def diameter_mm(self) -> float:
        """Diameter of the outer face."""
        return 2 * _radius_mm(self.kappa_per_mm, self.glass)

    @property
    def range_mm(self) -> tuple[float, float]:
        """Its least and its largest diameter within one standard error."""
        kappa, sigma = self.kappa_per_mm, self.sigma_per_mm
        return 2 * _radius_mm(kappa + sigma, self.glass), 2 * _radius_mm(kappa - sigma, self.glass)

    def contradicts(self, diameter_mm: float) -> bool:
        """Return whether the face cannot have that diameter."""
        if diameter_mm <= 2 * self.glass.thickness_mm:
            return True
        return abs(_kappa(diameter_mm / 2, self.glass) - self.kappa_per_mm) > SURE_SIGMAS * self.sigma_per_mm


def measure_course(slices: Sequence[SliceFeatures], faces: Faces, glass: Glass) -> Course | None:
    """Return what the face's course says of its diameter; None where the catheter is too near the axis to tell.

    ``slices``, in the order of ``faces``, with nominal angles: those corrected by the face hold the stated diameter.
    """
    shown = np.flatnonzero(~faces.bridged)
    waves = (_second_harmonic(slices[i].points, faces.capillary.circle(i)) for i in map(int, shown))
    known = [each for each in waves if each]
    of_circle, seen = [unit for unit, _ in known], [wave for _, wave in known]
    if not seen:
        return None
    unit, wave = np.array(of_circle), np.array(seen)
    weight = float((unit**2).sum())
    kappa = complex((unit * wave).sum() / weight)
    scatter = float(np.sqrt((unit**2 * (wave.real - kappa.real * unit) ** 2).sum())) / weight
    typical = math.sqrt(weight / unit.size)  # e²/4
    uneven = UNEVEN_RAD / math.sqrt(typical)
    sigma = math.hypot(scatter, kappa.imag, uneven, LINE_MM / typical)
    stated = _kappa(glass.outer_radius_mm, glass)
    if sigma > LEAST_CERTAIN * min(kappa.real, stated):
        return None
    if not glass.thickness_mm:
        sigma = math.hypot(sigma, UNKNOWN_GLASS[1] * kappa.real)
    return Course(kappa.real, sigma, glass)


def _second_harmonic(points: Points, circle: Circle) -> tuple[float, complex] | None:
    """Return e²/4 of one slice, mm², and the face's second harmonic, mm, its real part along the offset; or None."""
    waves = harmonics(points.angle_rad, (1, 2))
    basis = np.concatenate([np.ones((len(points), 1)), waves], axis=1)
    residual = points.beyond_mm(circle)
    beyond, fit = residual, np.zeros(5)
    for reach_mm in REACH_MM:
        weight = tukey_weight(beyond, reach_mm) * points.strength
        if np.unique(points.angle_rad[weight > 0]).size < LEAST_COLUMNS:
            return None
        normal = basis.T @ (weight[:, None] * basis) + 1e-9 * np.eye(5)
        fit = np.linalg.solve(normal, basis.T @ (weight * residual))
        beyond = residual - basis @ fit
    offset = complex(circle.x_mm - fit[1], circle.y_mm - fit[2])
    unit = abs(offset) ** 2 / 4
    # the circle's own, to the fourth order of e
    higher = 1 + unit / circle.radius_mm**2
    own = complex(circle.x_mm, circle.y_mm) ** 2 / (4 * circle.radius_mm) * higher
    whole = own + complex(fit[3], fit[4])
    return unit, complex(whole * (offset.conjugate() / abs(offset)) ** 2 / higher)


def _kappa(radius_mm: float, glass: Glass) -> float:
    if not glass.thickness_mm:
        return UNKNOWN_GLASS[0] / radius_mm
    n = GLASS_INDEX / glass.medium_index
    return (1 - 1 / n) / (radius_mm - glass.thickness_mm) + 1 / (n * radius_mm)


def _radius_mm(kappa: float, glass: Glass) -> float:
    """The radius of the outer face that has this κ: the inverse of :func:`_kappa`."""
    if not glass.thickness_mm:
        return UNKNOWN_GLASS[0] / kappa
    n, t = GLASS_INDEX / glass.medium_index, glass.thickness_mm
    half = n * (kappa * t + 1) / 2
    return (half + math.sqrt(half**2 - kappa * n * t)) / (kappa * n)
