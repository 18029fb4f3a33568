"""The file ``tube.toml``: what is known of a printed tube, and where its marks lie.

In the tube's frame z grows inward from the mouth, and θ clockwise as seen looking in. An axial groove runs along θ = 0,
a helical one along θ = ``helix_theta_rad`` + 2π·z/``helix_lead_mm``, both over the whole length and inked. Two rings,
a narrow one and then a wide one, lie farther from the axis than the bore, all around. Depths of ring and groove add up.
The helix tells the sense of θ for a known direction of z; the rings, one after the other, tell that direction.
"""

import math
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from endoct.base.arrays import Coordinates, Mask
from endoct.modalities.acquisition import read_toml, validate

Width = Annotated[float, Field(ge=0.05, le=20)]
Along = Annotated[float, Field(gt=0, le=200)]
Sigma = Annotated[float, Field(ge=0, le=1)]


class TubeErrors(BaseModel):
    """Standard errors of a tube's dimensions: how well it was measured, or else how well it was printed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    bore_diameter_mm: Sigma = Field(default=0.01, description="of the bore's diameter; 0.002 by a pin gauge")
    depth_mm: Sigma = Field(default=0.01, description="of the depths of grooves and rings, one error for all")
    z_mm: Sigma = Field(default=0.02, description="of the distance of the two rings")
    ink_depth_mm: Sigma = Field(default=0.02, description="of the depth at which ink begins")


class Target(BaseModel):
    """A printed tube to calibrate by, as its file has it."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    bore_diameter_mm: float = Field(ge=0.5, le=20, description="inner diameter where there is no mark")
    outer_diameter_mm: float = Field(ge=1, le=40, description="outer diameter")
    length_mm: float = Field(ge=2, le=200, description="from the mouth to the other end")
    groove_width_mm: Width = Field(description="of the axial groove at θ = 0, along the circumference")
    helix_width_mm: Width = Field(description="of the helical groove, along the circumference")
    groove_depth_mm: Width = Field(description="of both grooves")
    helix_theta_rad: float = Field(ge=-10, le=10, description="θ of the helical groove at the mouth")
    helix_lead_mm: float = Field(ge=1, le=100, description="length over which it goes once around; θ grows inward")
    ring_z_mm: tuple[Along, Along] = Field(description="from the mouth to the middle of the narrow and the wide ring")
    ring_width_mm: tuple[Width, Width] = Field(description="of the narrow ring and of the wide one, along z")
    ring_depth_mm: Width = Field(description="of both rings")
    ink_depth_mm: float = Field(
        default=0.015, ge=0, le=1, description="from the bore to where the ink in the grooves begins"
    )
    standard_errors: TubeErrors = Field(default=TubeErrors(), description="of the dimensions, mm")

    @property
    def radius_mm(self) -> float:
        """Radius of the bore."""
        return self.bore_diameter_mm / 2

    @property
    def ring_edges_mm(self) -> Coordinates:
        """z of the edges of the rings, float64 (4,), ascending."""
        middle, width = np.array(self.ring_z_mm)[:, None], np.array(self.ring_width_mm)[:, None]
        return np.asarray(middle + width * [-0.5, 0.5]).ravel()

    @property
    def stretch_sigma(self) -> float:
        """Standard error of all lengths along z, relative."""
        return self.standard_errors.z_mm / (self.ring_z_mm[1] - self.ring_z_mm[0])

    def helix_rad(self, z_mm: Coordinates) -> Coordinates:
        """Return θ of the middle of the helical groove."""
        return np.asarray(self.helix_theta_rad + 2 * math.pi * z_mm / self.helix_lead_mm)

    def ring_inside_mm(self, z_mm: Coordinates) -> Coordinates:
        """Return how far inside a ring places are along z; negative outside."""
        edges = self.ring_edges_mm
        within = [np.minimum(z_mm - low, high - z_mm) for low, high in ((edges[0], edges[1]), (edges[2], edges[3]))]
        return np.asarray(np.maximum(*within))

    def groove_inside_mm(self, z_mm: Coordinates, theta_rad: Coordinates) -> Coordinates:
        """Return how far inside a groove places are along the circumference; negative outside. Shapes broadcast."""
        axial, helical = self.from_grooves_mm(z_mm, theta_rad)
        return np.asarray(
            np.maximum(self.groove_width_mm / 2 - np.abs(axial), self.helix_width_mm / 2 - np.abs(helical))
        )

    def from_grooves_mm(self, z_mm: Coordinates, theta_rad: Coordinates) -> tuple[Coordinates, Coordinates]:
        """Return the way along the bore's circumference from the middles of the axial and of the helical groove."""
        from endoct.base.numeric.circle import wrap_rad  # which loads OpenCV; manifests do without

        axial, helical = wrap_rad(theta_rad + 0 * z_mm), wrap_rad(theta_rad - self.helix_rad(z_mm))
        return self.radius_mm * axial, self.radius_mm * helical

    def relief_mm(self, z_mm: Coordinates, theta_rad: Coordinates) -> Coordinates:
        """Return how much farther from the axis than the bore the wall lies, float64. Shapes broadcast."""
        return np.asarray(
            self.ring_depth_mm * (self.ring_inside_mm(z_mm) > 0) + self.groove_depth_mm * self.inked(z_mm, theta_rad)
        )

    def inked(self, z_mm: Coordinates, theta_rad: Coordinates) -> Mask:
        """Return which places lie in a groove. Shapes broadcast."""
        return np.asarray(self.groove_inside_mm(z_mm, theta_rad) > 0)

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        edges = self.ring_edges_mm
        if not (edges[0] > 0 and edges[1] < edges[2] and edges[3] < self.length_mm):
            raise ValueError("two rings one after the other, both within the tube")
        if self.ring_width_mm[1] < 1.5 * self.ring_width_mm[0]:
            raise ValueError("a second ring that is at least 1.5 times as wide as the first")
        if max(self.groove_width_mm, self.helix_width_mm) > self.radius_mm:
            raise ValueError("grooves narrower than the bore's radius")
        if 2 * (self.radius_mm + self.ring_depth_mm + self.groove_depth_mm) >= self.outer_diameter_mm:
            raise ValueError("an outer_diameter_mm that leaves a wall behind rings and grooves")
        return self


def read_target(path: Path) -> Target:
    """Return the tube that a ``tube.toml`` describes. Raises :class:`EndoctError` where it cannot be used."""
    return validate(Target, read_toml(path), str(path))
