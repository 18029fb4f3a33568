"""What the survey of an endoscope's recording measured."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.endoscope.flatfield import FlatField
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.optics import ConeOptics
from endoct.stitching.arrays import Coordinates
from endoct.stitching.doubt import Doubt
from endoct.stitching.grid import SurfaceGrid


@dataclass(frozen=True, eq=False)
class EndoscopeCalibration:
    """What a survey measured; everything that unrolling a frame needs besides the frame.

    ``annuli``, one a frame, in pixels of the files; ``drift_px`` (x, y): by how much the centre of the circles of
    constant z drifts from the outer rim to the inner, and ``shift_px`` by how much it lies off the outer rim;
    ``z_mm`` of every frame's band centre. θ of the wall is
    image angle + ``roll_rad`` (n,) + ``sway_rad`` (n, 2) · (cos, sin) of their sum. ``strip_z_mm``: rows of the flat
    field from the band's centre; ``exposure`` (n,): logarithm of what each frame is brighter than its light says.
    ``doubts``: what questions where everything lies; ``notes``: what concerns some frames.
    """

    grid: SurfaceGrid
    row_z_mm: Coordinates
    per_frame: Mapping[str, NDArray[Any]]
    notes: tuple[str, ...]
    handedness_known: bool
    travel_known: bool
    annuli: tuple[Annulus, ...]
    drift_px: tuple[float, float]
    shift_px: tuple[float, float]
    z_mm: Coordinates
    roll_rad: Coordinates
    sway_rad: Coordinates
    optics: ConeOptics
    flat: FlatField
    exposure: Coordinates
    strip_z_mm: Coordinates
    full_scale: float
    oversample: tuple[int, int]
    taper: float
    doubts: tuple[Doubt, ...] = ()

    def image_angle(self, index: int, theta_rad: Coordinates) -> Coordinates:
        """Return the angle in frame ``index`` at which the wall's ``theta_rad`` (any shape) is seen."""
        cos, sin = self.sway_rad[index]
        sway = cos * np.cos(theta_rad) + sin * np.sin(theta_rad)
        ray = theta_rad - sway
        sway = cos * np.cos(ray) + sin * np.sin(ray)
        return np.asarray(theta_rad - sway - self.roll_rad[index])
