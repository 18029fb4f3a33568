"""What the survey reports of every slice, under the names that it is stored by."""

from collections.abc import Sequence

import numpy as np

from endoct.base.arrays import Coordinates, Mask
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.face.sine import Sine
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.turning.rotation import Rotation


def per_slice_values(
    z_mm: Coordinates,
    faces: Faces,
    sines: Sequence[Sine],
    rotation: Rotation,
    glass: Glass,
    acquisition: OctAcquisition,
) -> dict[str, Coordinates | Mask]:
    """Return the geometry of every slice, its quality and its rotation by name, each (n_slices, …)."""
    capillary = faces.capillary
    turned_rad = acquisition.sense * (capillary.direction_rad + rotation.start_rad)
    return {
        "z_mm": z_mm,
        "sine_amplitude_mm": np.array([sine.amplitude_mm for sine in sines]),
        "sine_omega": np.array([sine.omega for sine in sines]),
        "sine_phase_rad": np.array([sine.phase_rad for sine in sines]),
        "sine_offset_mm": np.array([sine.offset_mm for sine in sines]),
        "offset_mm": capillary.offset_mm,
        "offset_direction_rad": np.mod(acquisition.theta_origin_rad + turned_rad, 2 * np.pi),
        "glass_mm": np.full_like(z_mm, glass.thickness_mm),
        "inlier_fraction": faces.inlier_fraction,
        "residual_mm": faces.residual_mm,
        "bridged": faces.bridged,
        "start_angle_rad": rotation.start_rad,
        "start_angle_known": rotation.start_known,
        "start_angle_sigma_rad": rotation.start_sigma_rad,
        "turn_length": 1 + rotation.stretch,
        "rotation_amplitude_rad": rotation.peak_rad(),
        "rotation_known": rotation.shape_known,
        "rotation_sigma_rad": rotation.shape_sigma_rad,
        "rotation_harmonics_rad": rotation.smooth_rad,
        "lost_at_rad": rotation.lost_at_rad,
        "lost_rad": rotation.lost_rad,
    }
