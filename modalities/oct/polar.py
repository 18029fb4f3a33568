"""B-scans on (θ, radius) about the capillary's axis: everything from there outward, sub-surface included."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.modalities.contract import Frame
from endoct.modalities.oct.bscan import reduce_theta, sector_angles_rad
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.undistort import beam_of
from endoct.stitching.arrays import Coordinates, Image

INSIDE_MM = 0.05
OUTSIDE_PX = -10.0


def volume_radii_mm(calibration: OctCalibration) -> Coordinates:
    """Return the radii of the volume's samples, float64, mm: to the end of the depth range.

    They start a little inside the capillary, so that its outer face is visible; the glass is not to scale.
    """
    capillary = calibration.capillary
    farthest = calibration.n_depth * calibration.mm_per_px - float(np.median(capillary.axis_depth_mm))
    farthest += float(np.max(capillary.offset_mm))
    return np.asarray(np.arange(capillary.radius_mm - INSIDE_MM, farthest, calibration.mm_per_px))


def resample(frame: Frame, calibration: OctCalibration, radii_mm: Coordinates, every: int = 1) -> Image:
    """Return one B-scan on (θ, radius) about the capillary's axis, float32 (n_theta, n_radii), NaN outside.

    θ is that of the panorama, or ``every`` such column from the first.
    """
    grid = calibration.grid
    image = reduce_theta(frame.samples, grid.n_theta)
    angle, depth = beam_of(calibration, frame.index, grid.theta_rad[::every, None], radii_mm[None, :])
    first = sector_angles_rad(frame.samples.shape[0], grid.n_theta)[0]
    column = np.mod((angle - first) / grid.dtheta_rad, grid.n_theta)
    wrapped = np.concatenate([image, image[:1]])
    sampled = cv2.remap(
        wrapped,
        np.nan_to_num(depth / calibration.mm_per_px, nan=OUTSIDE_PX).astype(np.float32),
        np.broadcast_to(column, depth.shape).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )
    return np.asarray(sampled, dtype=np.float32)


def as_recorded(samples: Image, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return interpolated samples in the recording's type: whole numbers rounded, 0 for NaN."""
    return samples if dtype.kind == "f" else np.rint(np.nan_to_num(samples)).astype(dtype)
