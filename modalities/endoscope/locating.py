"""Where places of the wall are seen in the pictures of a frame: which pixel looks at them."""

import numpy as np

from endoct.modalities.contract import Places
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.stitching.arrays import Coordinates


def locate_in_frame(index: int, places: Places, calibration: EndoscopeCalibration) -> dict[str, Coordinates]:
    """Return (column, row) in px of the pixel that looks at each place on the nominal bore, and (θ, z) in the strip.

    Depth is not known to an endoscope: what lies behind the bore's wall is seen where the ray through it crosses that,
    and so is the place of the panorama. Places beyond the rims are not seen.
    """
    from_centre_mm = places.z_mm - calibration.z_mm[index]
    seen = np.abs(from_centre_mm) <= calibration.strip_z_mm[-1]
    r_px = calibration.optics.r_px(np.where(seen, from_centre_mm, 0.0))
    angle = calibration.image_angle(index, places.theta_rad)
    annulus = calibration.annuli[index].with_drift(*calibration.drift_px).moved(*calibration.shift_px)
    x, y = annulus.centre_at(r_px)
    pixel = np.stack([annulus.columns(x + r_px * np.cos(angle)), y + r_px * np.sin(angle)], axis=1)
    strip = np.stack([np.mod(places.theta_rad, 2 * np.pi), places.z_mm], axis=1)
    return {name: np.where(seen[:, np.newaxis], xy, np.nan) for name, xy in (("frame", pixel), ("strip", strip))}
