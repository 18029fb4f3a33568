"""The OCT plug-in with the methods that the contract requires, and its pictures of a B-scan.

Pictures show where places of the wall are seen: which beam meets a place, and how deep, says where it is.
Every other step has a module of its own.
"""

from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Frame, Picture, Places, VolumetricModality
from endoct.modalities.oct.bscan import reduced_pullback, sector_angles_rad, sector_means
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.pullback_stream import Pullback, sniff_pullback
from endoct.modalities.oct.survey import survey_pullback
from endoct.modalities.oct.tube_calibration import calibrate_pullback
from endoct.modalities.oct.undistort import (
    as_recorded,
    beam_angles_rad,
    depth_at_radius_mm,
    radius_mm,
    resample,
    theta_at_radius,
    volume_radii_mm,
    write_volume,
)
from endoct.modalities.oct.unroll import profile_beams, settle_pullback, unroll_bscan

PICTURE_COLUMNS = 1000


def picture_bscan(frame: Frame, calibration: OctCalibration) -> tuple[Picture, ...]:
    """Return the B-scan as recorded, with outer face, its sine and wall, and the same undistorted, with the wall."""
    beams = profile_beams(frame, calibration)
    # 8 bits would be shown as they are, not from the darkest to the brightest
    kind = np.promote_types(frame.samples.dtype, np.uint16)
    mm, index = calibration.mm_per_px, frame.index
    n_columns = min(PICTURE_COLUMNS, frame.samples.shape[0])
    angle = sector_angles_rad(frame.samples.shape[0], n_columns)
    wall = np.where(beams.surface, beams.wall_mm, np.nan)
    recorded = Picture(
        name="bscan",
        title="B-scan as recorded",
        image=sector_means(frame.samples, n_columns).astype(kind, copy=False).T,
        x_label="rotation (rad)",
        y_label="depth (mm)",
        x_extent=(float(angle[0]), float(angle[-1])),
        y_extent=(0.0, (calibration.n_depth - 1) * mm),
        curves={
            "outer face of the capillary": _curve(beams.angle_rad, beams.face_mm),
            "sine first fitted to it": _curve(beams.angle_rad, calibration.sines[index](beams.angle_rad)),
            "wall": _curve(beams.angle_rad, wall),
        },
        about="Bright lines above that face: the end of the fibre, the catheter's sheath, and the inner face of the "
        "capillary. A straight line that crosses the others is added by the detector.",
    )
    theta, radii = calibration.grid.theta_rad, volume_radii_mm(calibration)
    every = max(1, theta.size // PICTURE_COLUMNS)
    undistorted = resample(frame, calibration, radii, every)
    undistorted = np.where(np.isfinite(undistorted), undistorted, np.nanmin(undistorted))
    beam, _ = beam_angles_rad(calibration, index, theta)
    nearest = np.round((beam - beams.angle_rad[0]) / calibration.grid.dtheta_rad).astype(np.intp) % theta.size
    wall_radius = radius_mm(calibration, index, beams.angle_rad, wall)[nearest]
    return recorded, Picture(
        name="bscan-undistorted",
        title="B-scan undistorted",
        image=as_recorded(undistorted, kind).T,
        x_label="θ (rad)",
        y_label="radius (mm)",
        x_extent=(float(theta[0]), float(theta[::every][-1])),
        y_extent=(float(radii[0]), float(radii[-1])),
        curves={"wall": _curve(theta, wall_radius)},
        about="Black below the wall: deeper than was recorded.",
    )


def _curve(x: Coordinates, y: Coordinates) -> Coordinates:
    return np.stack([x, y], axis=1)


def locate_in_bscan(index: int, places: Places, calibration: OctCalibration) -> dict[str, Coordinates]:
    """Return (nominal angle of the A-scan, depth in mm) of each place, and (θ, radius) in the undistorted B-scan.

    The panorama has at each θ what the beam meets that crosses the nominal bore there
    (:func:`~endoct.modalities.oct.unroll.unroll_bscan`). In a deep cell that place truly lies at another θ, and there
    the undistorted B-scan has it. Places beyond the neighbouring slices, and angles that no A-scan recorded, are NaN.
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


class OctModality:
    """Catheter OCT; it has no state."""

    parameters = OctParameters
    sniff = staticmethod(sniff_pullback)
    survey = staticmethod(survey_pullback)
    reading_once = staticmethod(reduced_pullback)
    unroll = staticmethod(unroll_bscan)
    settle = staticmethod(settle_pullback)
    illustrate = staticmethod(picture_bscan)
    locate = staticmethod(locate_in_bscan)
    write_volume = staticmethod(write_volume)
    calibrate = staticmethod(calibrate_pullback)

    def open(self, path: Path, acquisition: Acquisition) -> Pullback:
        """Open a pullback. Raises :class:`EndoctError` where it is unusable."""
        if not isinstance(acquisition, OctAcquisition):
            raise EndoctError("a pullback needs the sidecar of an OCT", found=type(acquisition).__name__)
        return Pullback(path, acquisition)


OCT: VolumetricModality[OctParameters, OctCalibration] = OctModality()
