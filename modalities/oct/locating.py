"""Where places of the wall are seen in the pictures of a B-scan: which beam meets them, and how deep."""

import numpy as np

from endoct.modalities.contract import Places
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.undistort import beam_angles_rad, depth_at_radius_mm, theta_at_radius
from endoct.stitching.arrays import Coordinates


def locate_in_bscan(index: int, places: Places, calibration: OctCalibration) -> dict[str, Coordinates]:
    """Return (nominal angle of the A-scan, depth in mm) of each place, and (θ, radius) in the undistorted B-scan.

    A place of the panorama is that which the beam meets that crosses the nominal bore at its θ, see
    :func:`~endoct.modalities.oct.unroll.unroll_bscan`; in a deep cell it lies at another θ in truth, at which the
    undistorted B-scan has it. Places beyond the neighbouring slices, and angles that no A-scan recorded, are not seen.
    """
    nominal, recorded = beam_angles_rad(calibration, index, places.theta_rad)
    near = np.abs(places.z_mm - calibration.slice_z_mm[index]) <= calibration.grid.dz_mm
    radius = calibration.grid.radius_mm + places.depth_mm
    depth_mm = depth_at_radius_mm(calibration, index, nominal, radius)
    theta = np.where(np.isfinite(radius), theta_at_radius(calibration, index, nominal, radius), places.theta_rad)
    seen = (recorded & near)[:, np.newaxis]
    return {
        "bscan": np.where(seen, np.stack([np.mod(nominal, 2 * np.pi), depth_mm], axis=1), np.nan),
        "bscan-undistorted": np.where(seen, np.stack([theta, radius], axis=1), np.nan),
    }
