"""The assembled panorama of a pullback: a helical scan's rows put in place, and final plausibility checks.

Nothing is smoothed across slices: they are farther apart than the rims of cells are wide.
"""

from dataclasses import replace

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.doubts import doubts_of_floor, doubts_of_sizes, doubts_of_surface, doubts_of_turns
from endoct.modalities.oct.undistort import beam_angles_rad
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame


def settle_pullback(panorama: Panorama, calibration: OctCalibration) -> Panorama:
    """Return ``panorama`` with a helical scan's rows sheared into place, and doubts of what contradicts the sidecar."""
    panorama = _with_faint_slices(panorama, calibration)
    of_surface = (*doubts_of_floor(calibration.background), *doubts_of_surface(panorama))
    if calibration.acquisition.scan == "helical" and panorama.grid.n_z > 1:
        panorama = _sheared(panorama, calibration)
    if panorama.depth_mm is None or not panorama.valid.any():
        return panorama
    of_geometry = (*doubts_of_sizes(panorama.depth_mm[panorama.valid], calibration), *doubts_of_turns(calibration))
    return replace(panorama, doubts=(*panorama.doubts, *of_geometry, *of_surface))


def _with_faint_slices(panorama: Panorama, calibration: OctCalibration) -> Panorama:
    """Flag the slices that are not valid because their wall hardly stands out of the noise."""
    least = calibration.parameters.least_wall_sigmas
    faint = (panorama.per_frame["wall_sigmas"].values < least) & ~panorama.per_frame["bridged"].values
    flag = PerFrame(faint, "", "wall faint", trusted_when=False)
    panorama = replace(panorama, per_frame={**panorama.per_frame, "wall_faint": flag})
    if not faint.any():
        return panorama
    note = (
        f"In {np.count_nonzero(faint)} of {faint.size} slices the wall stands out of the noise by less than {least:g} "
        "standard errors (least_wall_sigmas); their samples are not valid."
    )
    return replace(panorama, notes=(*panorama.notes, note))


def _sheared(panorama: Panorama, calibration: OctCalibration) -> Panorama:
    """Interpolate along z: in a helical scan the nominal z of a slice is that of the middle of its turn."""
    theta_rad = panorama.grid.theta_rad
    in_z = np.argsort(calibration.slice_z_mm, kind="stable")
    turn = np.stack([beam_angles_rad(calibration, int(i), theta_rad)[0] for i in in_z]) / (2 * np.pi)
    inward = -1 if calibration.acquisition.travel == "out" else 1
    recorded_mm = panorama.z_mm[:, None] + inward * panorama.grid.dz_mm * (turn - 0.5)
    intensity = _placed(panorama.intensity, panorama, recorded_mm)
    depth = None if panorama.depth_mm is None else _placed(panorama.depth_mm, panorama, recorded_mm)
    valid = np.isfinite(intensity)
    return replace(
        panorama,
        intensity=np.where(valid, intensity, 0).astype(np.float32),
        depth_mm=depth,
        valid=valid,
        weight=np.where(valid, 1, 0).astype(np.float32),
    )


def _placed(image: Image, panorama: Panorama, recorded_mm: Coordinates) -> Image:
    """Samples recorded at ``recorded_mm`` (n_z, n_theta), at the panorama's rows; NaN where not valid there."""
    placed = np.full_like(image, np.nan)
    for column in range(image.shape[1]):
        # where turns start anywhere, two of them may be two pitches apart at one θ, or hardly any distance
        order = np.argsort(recorded_mm[:, column], kind="stable")
        at_mm, good = recorded_mm[order, column], panorama.valid[order, column]
        if not good.any():
            continue
        nearest = np.round(np.interp(panorama.z_mm, at_mm, np.arange(order.size))).astype(np.intp)
        values = np.interp(panorama.z_mm, at_mm[good], image[order[good], column])
        placed[:, column] = np.where(good[nearest], values, np.nan)
    return placed
