"""What a survey of a pullback found: everything that unrolling one B-scan needs beside it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.face.sine import Sine
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning.rotation import Rotation
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.grid import SurfaceGrid


@dataclass(frozen=True, eq=False)
class Background:
    """Levels of a recording, in its (logarithmic) samples.

    Attributes: ``noise`` and ``noise_sigma`` of the dark space between capillary and wall; ``wall``, the typical
    level just below the wall's surface; ``line_excess``, float32 (n_depth,), how far the
    detector's fixed lines stand out of the darkness, 0 where there are none; ``noise_power``, the mean power of noise
    over its median power, 1 / ln 2 unless it was processed.
    """

    noise: float
    noise_sigma: float
    wall: float
    line_excess: Image
    noise_power: float = 1 / math.log(2)


@dataclass(frozen=True, eq=False)
class OctCalibration:
    """The calibration of the contract, with where the outer face lies in every slice.

    Attributes
    ----------
    grid, row_z_mm, per_frame, notes, handedness_known, travel_known: as the contract says.
    acquisition, parameters: what it was made with.
    n_ascans, n_depth: the size of a B-scan.
    slice_z_mm: float64 (n_slices,), in recording order.
    rotation: how the catheter turned, in recording order.
    offset_x_mm, offset_y_mm, axis_depth_mm: float64 (n_slices,): the catheter's offset in the frame of each slice, in
        which ``rotation`` gives the directions of beams (A-scan 0 near angle 0), and the depth, from sample 0 and in
        the medium, at which ρ = 0.
    ripple_mm: float64 (n_slices, 10): harmonics of where the face departs from the circle (uneven rotation, oblique
        glass). The wall is delayed by the same, so it is taken off depths, not off angles.
    glass_mm: thickness of the capillary's wall, mm; 0 where its inner face is not seen.
    sines: the paper's fit, one a slice. ``bridged``: bool (n_slices,).
    background: levels of the recording.
    """

    grid: SurfaceGrid
    row_z_mm: Coordinates
    per_frame: Mapping[str, NDArray[Any]]
    notes: tuple[str, ...]
    acquisition: OctAcquisition
    parameters: OctParameters
    n_ascans: int
    n_depth: int
    slice_z_mm: Coordinates
    rotation: Rotation
    offset_x_mm: Coordinates
    offset_y_mm: Coordinates
    axis_depth_mm: Coordinates
    ripple_mm: Coordinates
    glass_mm: float
    sines: tuple[Sine, ...]
    bridged: Mask
    background: Background

    @property
    def handedness_known(self) -> bool:
        """Whether the sidecar says how A-scans run against θ."""
        return self.acquisition.handedness != "unknown"

    @property
    def travel_known(self) -> bool:
        """Whether the sidecar says which way the catheter moved."""
        return self.acquisition.travel != "unknown"

    @property
    def mm_per_px(self) -> float:
        """Distance of two depth samples in the medium, mm."""
        return self.acquisition.mm_per_px

    @property
    def sense(self) -> int:
        """+1 where A-scans run with the panorama's θ, −1 where against it."""
        return -1 if self.acquisition.handedness == "mirrored" else 1

    @property
    def capillary_radius_mm(self) -> float:
        """Outer radius of the capillary, mm."""
        return self.acquisition.capillary_outer_diameter_mm / 2

    def rotation_of_theta(self, theta_rad: Coordinates) -> Coordinates:
        """Return the angle of a panorama's θ in the frame that slices share, A-scan 0 of even turns at 0; [0, 2π)."""
        return np.asarray(np.mod(self.sense * (theta_rad - self.acquisition.theta_origin_rad), 2 * np.pi))
