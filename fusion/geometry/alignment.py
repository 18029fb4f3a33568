"""How one side lies in the other's frame."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from endoct.base.arrays import Coordinates

Covariance = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Alignment:
    """Maps side B into side A's frame: θ_A = θ_shift ± θ_B, z_A = z_shift + z_scale·(±z_B).

    θ_B counts negative if ``mirrored``, z_B if ``z_reversed``. ``correlation`` is that of the two sides' evidence
    for cells in place (its sign says whether they agree or are each other's negative), ``ratio`` how its score
    compares with the runner-up's anywhere else, ``confidence`` |correlation|·(1 − 1/ratio), ``chance`` how likely a
    bore that does not match would reach that score (:mod:`endoct.fusion.registration.search`), ``overlap_mm2`` the
    wall that both have observed. ``uneven_rad`` is the largest smooth departure from a rigid turn, which is estimated
    but left uncorrected: what uneven rotation and an off-axis probe leave in θ; ``twist_rad_per_mm`` a turn along A's
    z, likewise. ``covariance`` is that of the error of (theta_shift_rad, z_shift_mm, z_scale), 3 × 3 in their units;
    None where it was not estimated.
    """

    theta_shift_rad: float
    z_shift_mm: float
    z_scale: float = 1.0
    mirrored: bool = False
    z_reversed: bool = False
    confidence: float = 0.0
    correlation: float = 0.0
    ratio: float = 1.0
    chance: float = 1.0
    overlap_mm2: float = 0.0
    uneven_rad: float = 0.0
    twist_rad_per_mm: float = 0.0
    covariance: Covariance | None = None

    def __repr__(self) -> str:
        flips = "".join([", mirrored"] * self.mirrored + [", z reversed"] * self.z_reversed)
        return (
            f"<Alignment: θ shift {np.degrees(self.theta_shift_rad):.2f}°, z shift {self.z_shift_mm:.3f} mm, "
            f"z scale {self.z_scale:.4f}{flips}, confidence {self.confidence:.2f}>"
        )

    def theta_to_a(self, theta_b_rad: ArrayLike) -> Coordinates:
        """Return θ in A's frame, in [0, 2π), of θ in B's (any shape)."""
        sense = -1.0 if self.mirrored else 1.0
        return np.mod(self.theta_shift_rad + sense * np.asarray(theta_b_rad, dtype=np.float64), 2 * np.pi)

    def theta_to_b(self, theta_a_rad: ArrayLike) -> Coordinates:
        """Return θ in B's frame, in [0, 2π), of θ in A's (any shape)."""
        sense = -1.0 if self.mirrored else 1.0
        return np.mod(sense * (np.asarray(theta_a_rad, dtype=np.float64) - self.theta_shift_rad), 2 * np.pi)

    def z_to_a(self, z_b_mm: ArrayLike) -> Coordinates:
        """Return z in A's frame, mm, of z in B's (any shape)."""
        direction = -1.0 if self.z_reversed else 1.0
        return np.asarray(self.z_shift_mm + self.z_scale * direction * np.asarray(z_b_mm, dtype=np.float64))

    def z_to_b(self, z_a_mm: ArrayLike) -> Coordinates:
        """Return z in B's frame, mm, of z in A's (any shape)."""
        direction = -1.0 if self.z_reversed else 1.0
        return np.asarray(direction * (np.asarray(z_a_mm, dtype=np.float64) - self.z_shift_mm) / self.z_scale)

    def inverse(self) -> "Alignment":
        """Return the alignment that maps A into B's frame."""
        direction = -1.0 if self.z_reversed else 1.0
        sense = -1.0 if self.mirrored else 1.0
        scale = self.z_scale
        by_shift_and_scale = -direction / scale, direction * self.z_shift_mm / scale**2
        jacobian = np.array([[-sense, 0, 0], [0, *by_shift_and_scale], [0, 0, -1 / scale**2]])
        return replace(
            self,
            theta_shift_rad=float(np.mod(-sense * self.theta_shift_rad, 2 * np.pi)),
            z_shift_mm=-direction * self.z_shift_mm / scale,
            z_scale=1 / scale,
            twist_rad_per_mm=-sense * direction * self.twist_rad_per_mm,
            covariance=self.covariance and as_covariance(jacobian @ np.array(self.covariance) @ jacobian.T),
        )

    def z_error_mm(self, z_b_mm: ArrayLike) -> Coordinates:
        """Return the standard error of :meth:`z_to_a` at z in B's frame (any shape), mm, 0 where it is unknown."""
        along = (-1.0 if self.z_reversed else 1.0) * np.asarray(z_b_mm, dtype=np.float64)
        (_, (_, of_shift, common), (_, _, of_scale)) = self.covariance or as_covariance(np.zeros((3, 3)))
        return np.sqrt(np.maximum(of_shift + 2 * along * common + along**2 * of_scale, 0))


def as_covariance(matrix: Coordinates) -> Covariance:
    """Return a 3 × 3 array as nested tuples of floats, made symmetric to the last bit."""
    (a, b, c), (_, d, e), (_, _, f) = ((matrix + matrix.T) / 2).tolist()
    return (a, b, c), (b, d, e), (c, e, f)


@dataclass(frozen=True)
class NotAligned:
    """No place stood out: why, in a full sentence, and the best there was."""

    reason: str
    best: Alignment | None = None


Orientation = tuple[bool, bool]
"""(mirrored, z_reversed)"""

ALL_ORIENTATIONS: tuple[Orientation, ...] = ((False, False), (True, False), (False, True), (True, True))
