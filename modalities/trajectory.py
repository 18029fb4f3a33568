"""A straight way through a patient, and the bore's coordinates along it."""

from dataclasses import dataclass

import numpy as np

from endoct.stitching.arrays import Coordinates
from endoct.stitching.errors import EndoctError

Point = tuple[float, float, float]
LEAST_LENGTH_MM = 1.0
NEARLY_ALONG = np.cos(np.radians(10))


@dataclass(frozen=True)
class Trajectory:
    """From ``entry_mm`` to ``target_mm``, both LPS. Raises :class:`EndoctError` where these are the same place."""

    entry_mm: Point
    target_mm: Point

    def __post_init__(self) -> None:
        if not self.length_mm >= LEAST_LENGTH_MM:
            raise EndoctError("entry and target are the same place", found=f"{self.length_mm:.3g} mm apart")

    @property
    def length_mm(self) -> float:
        """Distance from entry to target."""
        return float(np.linalg.norm(np.subtract(self.target_mm, self.entry_mm)))

    @property
    def to_lps(self) -> Coordinates:
        """The transform (4, 4) of the bore frame at the entry, z towards the target, to LPS."""
        return axes_at(np.array(self.entry_mm), np.subtract(self.target_mm, self.entry_mm))


def as_point(place: Coordinates) -> Point:
    """Return x, y and z of an array (3,) as numbers of Python."""
    x, y, z = (float(value) for value in place)
    return x, y, z


def axes_at(origin_mm: Coordinates, inward: Coordinates) -> Coordinates:
    """Return the transform (4, 4) of a bore frame at ``origin_mm`` whose z runs ``inward``, in LPS.

    θ = 0 is towards the head; where the bore runs within 10° of that, to the front.
    """
    z = inward / max(float(np.linalg.norm(inward)), 1e-12)
    towards = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < NEARLY_ALONG else np.array([0.0, -1.0, 0.0])
    x = towards - (towards @ z) * z
    x /= np.linalg.norm(x)
    to_world = np.eye(4)
    to_world[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    to_world[:3, 3] = origin_mm
    return to_world
