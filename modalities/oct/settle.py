"""The assembled panorama of a pullback: a helical scan's rows put in place, and a last plausibility check.

Nothing is smoothed across slices: they lie farther apart than the rims of cells are sharp.
"""

from dataclasses import replace

import numpy as np

from endoct.modalities.oct.calibration import OctCalibration
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.panorama import Panorama

ODD_WALL_SHARE = 0.1


def settle_pullback(panorama: Panorama, calibration: OctCalibration) -> Panorama:
    """Return ``panorama`` with a helical scan's rows sheared into place, and a note where the wall lies oddly."""
    if calibration.acquisition.scan == "helical" and panorama.grid.n_z > 1:
        panorama = _sheared(panorama, calibration)
    if panorama.depth_mm is None or not panorama.valid.any():
        return panorama
    median_mm = float(np.median(panorama.depth_mm[panorama.valid]))
    if abs(median_mm) <= ODD_WALL_SHARE * panorama.grid.radius_mm:
        return panorama
    note = (
        f"The wall lies {abs(median_mm):.2f} mm {'behind' if median_mm > 0 else 'before'} the nominal bore in the "
        "median; bore_diameter_mm, capillary_outer_diameter_mm or axial_pixel_mm may be wrong, or the wrong line "
        "was taken for the capillary."
    )
    return replace(panorama, provenance={**panorama.provenance, "notes": [*panorama.provenance.get("notes", ()), note]})


def _sheared(panorama: Panorama, calibration: OctCalibration) -> Panorama:
    """Interpolate along z: in a helical scan the nominal z of a slice is that of the middle of its turn."""
    turn = calibration.rotation_of_theta(panorama.grid.theta_rad) / (2 * np.pi)
    inward = -1 if calibration.acquisition.travel == "out" else 1
    shift_mm = inward * panorama.grid.dz_mm * (turn - 0.5)
    intensity = _shifted(panorama.intensity, panorama, shift_mm)
    depth = None if panorama.depth_mm is None else _shifted(panorama.depth_mm, panorama, shift_mm)
    valid = np.isfinite(intensity)
    return replace(
        panorama,
        intensity=np.where(valid, intensity, 0).astype(np.float32),
        depth_mm=depth,
        valid=valid,
        weight=np.where(valid, 1, 0).astype(np.float32),
    )


def _shifted(image: Image, panorama: Panorama, shift_mm: Coordinates) -> Image:
    """Columns recorded at z + ``shift_mm`` (n_theta,), at the panorama's rows; NaN where not valid there."""
    shifted = np.empty_like(image)
    for column, shift in enumerate(shift_mm):
        good = panorama.valid[:, column]
        if not good.any():
            shifted[:, column] = np.nan
            continue
        recorded_mm = panorama.z_mm + shift
        step = np.round((panorama.z_mm - recorded_mm[0]) / panorama.grid.dz_mm).astype(np.intp)
        nearest = np.clip(step, 0, good.size - 1)
        values = np.interp(panorama.z_mm, recorded_mm[good], image[good, column])
        shifted[:, column] = np.where(good[nearest], values, np.nan)
    return shifted
