"""Where the capillary's outer face departs from a circle: harmonics of the beam's angle.

Uneven rotation and oblique glass bend the face by a few micrometres. Offset and depth of the axis take up the orders 0
and 1.
"""

import numpy as np
from numpy.typing import ArrayLike

from endoct.base.arrays import Coordinates
from endoct.base.numeric.harmonics import harmonics
from endoct.modalities.oct.face.circle import Circle
from endoct.modalities.oct.face.points import Points, tukey_weight

RIPPLE_HARMONICS = 6
N_RIPPLE = 2 * (RIPPLE_HARMONICS - 1)
DAMPING = 0.05  # of the points' weight: a face seen in part does not swing where it is not seen


def ripple_basis(angle_rad: ArrayLike) -> Coordinates:
    """Return cosines, then sines of harmonics 2 to ``RIPPLE_HARMONICS`` of the angles (n,), float64 (n, N_RIPPLE)."""
    waves = harmonics(angle_rad, range(2, RIPPLE_HARMONICS + 1))
    return np.concatenate([waves[:, 0::2], waves[:, 1::2]], axis=1)


def fit_ripple(points: Points, circle: Circle, tolerance_mm: float) -> Coordinates:
    """Return the factors of :func:`ripple_basis`, float64 (N_RIPPLE,), mm, from ``points`` near ``circle``."""
    residual = points.beyond_mm(circle)
    weight = tukey_weight(residual, 2 * tolerance_mm) * points.strength
    basis = ripple_basis(points.angle_rad)
    normal = basis.T @ (weight[:, None] * basis) + DAMPING * max(float(weight.sum()), 1.0) * np.eye(N_RIPPLE)
    return np.asarray(np.linalg.solve(normal, basis.T @ (weight * residual)))
