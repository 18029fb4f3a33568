"""How far the probe is off the bore's axis, from how the centres of circles of constant z drift with their radius.

With the bore's axis off the probe's by e, the wall at image angle θ is seen at z + m·e·cos(θ − φ) and lies at
θ + e/R·sin(θ − φ), with m = cot(2a − ψ) of the ray. So the circle of constant z at radius r is centred m·e/(dz/dr)
away from the mirror's axis, opposite to the bore's. A tilt of the probe moves all centres alike, as a mirror's edge
that is not quite round does: it is not distinguished from that, and not corrected.
"""

from dataclasses import dataclass

import numpy as np

from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.optics import ConeOptics
from endoct.stitching.arrays import Coordinates

LARGEST = 0.1
"""Of the bore's radius: more is not a probe off its axis but a drift that was measured wrongly."""


@dataclass(frozen=True)
class BoreAxis:
    """The bore's axis in the probe's frame, ``x_mm`` and ``y_mm`` along the image's columns and rows.

    ``shift_px`` (x, y): by how much the circle of constant z at the outer rim lies off that rim.
    """

    x_mm: float
    y_mm: float
    shift_px: tuple[float, float]

    def sway_rad(self, roll_rad: float, radius_mm: float) -> Coordinates:
        """Return by what θ of the wall differs from image angle + roll, as parts of cos and sin of their sum, (2,)."""
        cos, sin = np.cos(roll_rad), np.sin(roll_rad)
        x, y = self.x_mm * cos - self.y_mm * sin, self.x_mm * sin + self.y_mm * cos
        return np.array([-y, x]) / radius_mm


ON_AXIS = BoreAxis(0.0, 0.0, (0.0, 0.0))


def bore_axis(drift_px: tuple[float, float], annulus: Annulus, optics: ConeOptics, radius_mm: float) -> BoreAxis | None:
    """Return where the bore's axis lies by the drift of the centres from outer to inner rim, or None if unknown.

    It is not known where the drift speaks of more than a tenth of the radius.
    """
    inner, outer = optics.centre_shift_px_per_mm(np.array([annulus.inner_px, annulus.outer_px]))
    x_mm, y_mm = (float(drift / (outer - inner)) for drift in drift_px)
    if np.hypot(x_mm, y_mm) > LARGEST * radius_mm:
        return None
    return BoreAxis(x_mm, y_mm, (float(-outer * x_mm), float(-outer * y_mm)))


def probe_offsets(axis: BoreAxis | None, sway_rad: Coordinates, radius_mm: float) -> dict[str, Coordinates]:
    """Return how far the probe was off the bore's axis, towards θ = 0 and θ = π/2; NaN where that is not known."""
    known = 1.0 if axis is not None else np.nan
    return {
        "probe_offset_x_mm": -known * radius_mm * sway_rad[:, 1],
        "probe_offset_y_mm": known * radius_mm * sway_rad[:, 0],
    }
