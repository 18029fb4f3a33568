"""From what a beam met at which depth to radius and angle about the capillary's axis.

Two ways. "eccentric" takes the catheter where it is: a sample at distance ρ along the beam at angle α lies at
e + ρ·u(α), turned by what the capillary's glass bends the beam. "sine" is the paper's (Laves 2019, Image
undistortion): every A-scan is shifted by the fitted sine, its angle kept; right for the radius to first order only.

Three angles: θ of the panorama; the direction of a beam in the frame of its slice; and the nominal angle of an A-scan,
its share of the turn. :mod:`endoct.modalities.oct.turning.rotation` says where frames start and which A-scan looked
where.
"""

import numpy as np

from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.face.glass import bend_rad
from endoct.modalities.oct.face.sine import circle_distance_mm, ripple_basis
from endoct.stitching.arrays import Coordinates, Mask


def beam_angles_rad(calibration: OctCalibration, index: int, theta_rad: Coordinates) -> tuple[Coordinates, Mask]:
    """Return the nominal angle of the A-scan that crosses the nominal bore surface at each ``theta_rad``.

    And whether there is one: a turn that was too short, or lost A-scans, left some θ unseen.
    """
    beam = _beams_at_bore(calibration, index, theta_rad)
    return calibration.rotation.nominal_rad(index, beam, calibration.n_ascans)


def face_depth_mm(calibration: OctCalibration, index: int, nominal_rad: Coordinates) -> Coordinates:
    """Return the depth of the outer face, from sample 0 and in the medium, in the A-scans at ``nominal_rad``."""
    if calibration.parameters.undistort == "sine":
        return calibration.sines[index](nominal_rad)
    beam = calibration.rotation.beam_rad(index, nominal_rad)
    x, y = calibration.offset_x_mm[index], calibration.offset_y_mm[index]
    distance = circle_distance_mm(beam, x, y, calibration.capillary_radius_mm)
    return np.asarray(distance) + _depth_of_axis(calibration, index, beam)


def radius_mm(calibration: OctCalibration, index: int, nominal_rad: Coordinates, depth_mm: Coordinates) -> Coordinates:
    """Return the distance from the capillary's axis of what lies at ``depth_mm`` in the A-scans at ``nominal_rad``."""
    if calibration.parameters.undistort == "sine":
        return np.asarray(depth_mm - calibration.sines[index](nominal_rad) + calibration.capillary_radius_mm)
    beam = calibration.rotation.beam_rad(index, nominal_rad)
    along = depth_mm - _depth_of_axis(calibration, index, beam)
    x = calibration.offset_x_mm[index] + along * np.cos(beam)
    y = calibration.offset_y_mm[index] + along * np.sin(beam)
    return np.asarray(np.hypot(x, y))


def beam_of(
    calibration: OctCalibration, index: int, theta_rad: Coordinates, radius: Coordinates
) -> tuple[Coordinates, Coordinates]:
    """Return (nominal angle, depth in mm) at which the place (r, θ) about the axis was recorded; shapes broadcast.

    The depth is NaN where no A-scan looked.
    """
    turned = _in_slice_rad(calibration, index, theta_rad)
    if calibration.parameters.undistort == "sine":
        nominal, seen = calibration.rotation.nominal_rad(index, turned, calibration.n_ascans)
        depth = np.where(seen, radius - calibration.capillary_radius_mm + calibration.sines[index](nominal), np.nan)
        return np.broadcast_to(nominal, depth.shape), depth
    # ripple and bend are smooth: over the few degrees that one θ spans along the radius they are those at the wall
    at_bore = _beams_at_bore(calibration, index, np.ravel(theta_rad))
    turned = turned + _bend_rad(calibration, index, at_bore).reshape(np.shape(theta_rad))
    x = radius * np.cos(turned) - calibration.offset_x_mm[index]
    y = radius * np.sin(turned) - calibration.offset_y_mm[index]
    axis = _depth_of_axis(calibration, index, at_bore).reshape(np.shape(theta_rad))
    nominal, seen = calibration.rotation.nominal_rad(index, np.arctan2(y, x), calibration.n_ascans)
    return nominal, np.where(seen, np.hypot(x, y) + axis, np.nan)


def _in_slice_rad(calibration: OctCalibration, index: int, theta_rad: Coordinates) -> Coordinates:
    """The angle of a panorama's θ in the frame of one slice."""
    return np.asarray(calibration.rotation_of_theta(theta_rad) - calibration.rotation.start_rad[index])


def _beams_at_bore(calibration: OctCalibration, index: int, theta_rad: Coordinates) -> Coordinates:
    """The direction, in the slice's frame, of the beam that crosses the nominal bore surface at each θ, [0, 2π)."""
    turned = _in_slice_rad(calibration, index, theta_rad)
    if calibration.parameters.undistort == "sine":
        return np.mod(turned, 2 * np.pi)
    radius = calibration.grid.radius_mm
    offset_x, offset_y = calibration.offset_x_mm[index], calibration.offset_y_mm[index]
    beam = turned
    bend: Coordinates = np.zeros_like(turned)
    for _ in range(3 if calibration.glass_mm else 1):
        beam = np.arctan2(radius * np.sin(turned + bend) - offset_y, radius * np.cos(turned + bend) - offset_x)
        bend = _bend_rad(calibration, index, beam)
    return np.asarray(np.mod(beam, 2 * np.pi))


def _depth_of_axis(calibration: OctCalibration, index: int, beam_rad: Coordinates) -> Coordinates:
    """The depth at which ρ = 0, in every beam: the circle's, and the face's departure from the circle."""
    return np.asarray(calibration.axis_depth_mm[index] + ripple_basis(beam_rad) @ calibration.ripple_mm[index])


def _bend_rad(calibration: OctCalibration, index: int, beam_rad: Coordinates) -> Coordinates:
    """By how much the glass turns the beams at ``beam_rad``; 0 where the glass is not known."""
    if not calibration.glass_mm:
        return np.zeros_like(beam_rad)
    passing = calibration.offset_x_mm[index] * np.sin(beam_rad) - calibration.offset_y_mm[index] * np.cos(beam_rad)
    medium = calibration.acquisition.medium_index
    return bend_rad(passing, calibration.capillary_radius_mm, calibration.glass_mm, medium)
