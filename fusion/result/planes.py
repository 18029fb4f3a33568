"""A plane that cuts a bore, such as a fracture, as ``result.json`` has it."""

import math

import numpy as np
from numpy.typing import ArrayLike

from endoct.base.arrays import Coordinates
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.result.scores import Number, Part


class CuttingPlane(Part):
    """A plane through a bore, with standard errors.

    Attributes
    ----------
    z_mm: where it cuts the bore's axis.
    dip_rad: the angle of its normal with that axis: 0 where it lies across the bore.
    azimuth_rad: the direction θ in which it goes inward.
    support: the share of directions in which it shows.
    radius_mm: of the bore.
    """

    z_mm: Number
    dip_rad: Number
    azimuth_rad: Number
    z_error_mm: Number
    dip_error_rad: Number
    azimuth_error_rad: Number
    support: Number
    radius_mm: Number

    def z_at(self, theta_rad: ArrayLike) -> Coordinates:
        """Return where it meets the wall in these directions (any shape), mm."""
        height_mm = self.radius_mm * math.tan(self.dip_rad)
        return np.asarray(self.z_mm + height_mm * np.cos(np.asarray(theta_rad) - self.azimuth_rad))

    def scaled(self, factor: float) -> "CuttingPlane":
        """Return the plane with every length times ``factor``."""
        names = "z_mm", "z_error_mm", "radius_mm"
        return self.model_copy(update={name: factor * getattr(self, name) for name in names})

    def moved(self, alignment: Alignment) -> "CuttingPlane":
        """Return a plane of side B as it lies in A's frame, by the rigid part of ``alignment``."""
        rigid, scale, slope = alignment.rigid, alignment.z_scale, math.tan(self.dip_rad)
        turn = math.pi if rigid.z_reversed else 0.0
        moved = {
            "z_mm": float(rigid.z_to_a(self.z_mm)),
            "dip_rad": math.atan(scale * slope),
            "azimuth_rad": float(rigid.theta_to_a(self.azimuth_rad + turn)),
            "z_error_mm": scale * self.z_error_mm,
            "dip_error_rad": self.dip_error_rad * scale * (1 + slope**2) / (1 + (scale * slope) ** 2),
        }
        return self.model_copy(update=moved)
