"""From what a beam met at which depth to radius and angle about the capillary's axis.

Two ways. "eccentric" takes the catheter where it is: a sample at distance ρ along the beam at angle α lies at
e + ρ·u(α), turned by what the capillary's glass bends the beam. "sine" is the paper's (Laves 2019, Image
undistortion): every A-scan is shifted by the fitted sine, its angle kept; right for the radius to first order only.
"""

import numpy as np

from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.glass import bend_rad
from endoct.modalities.oct.sine import circle_distance_mm, ripple_basis
from endoct.stitching.arrays import Coordinates


def beam_angles_rad(calibration: OctCalibration, index: int, theta_rad: Coordinates) -> Coordinates:
    """Return the rotation angle of the beam that crosses the nominal bore surface at each ``theta_rad``."""
    turned = calibration.rotation_of_theta(theta_rad)
    if calibration.parameters.undistort == "sine":
        return turned
    radius = calibration.grid.radius_mm
    offset_x, offset_y = calibration.offset_x_mm[index], calibration.offset_y_mm[index]
    angle = turned
    bend: Coordinates = np.zeros_like(turned)
    for _ in range(3 if calibration.glass_mm else 1):
        angle = np.arctan2(radius * np.sin(turned + bend) - offset_y, radius * np.cos(turned + bend) - offset_x)
        bend = _bend_rad(calibration, index, angle)
    return np.asarray(np.mod(angle, 2 * np.pi))


def face_depth_mm(calibration: OctCalibration, index: int, angle_rad: Coordinates) -> Coordinates:
    """Return the depth of the outer face, from depth sample 0 and in the medium, in the beams at ``angle_rad``."""
    if calibration.parameters.undistort == "sine":
        return calibration.sines[index](angle_rad)
    x, y = calibration.offset_x_mm[index], calibration.offset_y_mm[index]
    distance = circle_distance_mm(angle_rad, x, y, calibration.capillary_radius_mm)
    return np.asarray(distance) + _depth_of_axis(calibration, index, angle_rad)


def radius_mm(calibration: OctCalibration, index: int, angle_rad: Coordinates, depth_mm: Coordinates) -> Coordinates:
    """Return the distance from the capillary's axis of what lies at ``depth_mm`` in the beams at ``angle_rad``."""
    if calibration.parameters.undistort == "sine":
        return np.asarray(depth_mm - calibration.sines[index](angle_rad) + calibration.capillary_radius_mm)
    along = depth_mm - _depth_of_axis(calibration, index, angle_rad)
    x = calibration.offset_x_mm[index] + along * np.cos(angle_rad)
    y = calibration.offset_y_mm[index] + along * np.sin(angle_rad)
    return np.asarray(np.hypot(x, y))


def beam_of(
    calibration: OctCalibration, index: int, theta_rad: Coordinates, radius: Coordinates
) -> tuple[Coordinates, Coordinates]:
    """Return (rotation angle, depth in mm) at which the place (r, θ) about the axis was recorded; shapes broadcast."""
    turned = calibration.rotation_of_theta(theta_rad)
    if calibration.parameters.undistort == "sine":
        depth = radius - calibration.capillary_radius_mm + calibration.sines[index](turned)
        return np.broadcast_to(turned, depth.shape), depth
    # ripple and bend are smooth: over the few degrees that one θ spans along the radius they are those at the wall
    at_bore = beam_angles_rad(calibration, index, np.ravel(theta_rad))
    turned = turned + _bend_rad(calibration, index, at_bore).reshape(np.shape(theta_rad))
    x = radius * np.cos(turned) - calibration.offset_x_mm[index]
    y = radius * np.sin(turned) - calibration.offset_y_mm[index]
    angle = np.mod(np.arctan2(y, x), 2 * np.pi)
    axis = _depth_of_axis(calibration, index, at_bore).reshape(np.shape(theta_rad))
    return angle, np.hypot(x, y) + axis


def _depth_of_axis(calibration: OctCalibration, index: int, angle_rad: Coordinates) -> Coordinates:
    """The depth at which ρ = 0, in every beam: the circle's, and the face's departure from the circle."""
    return np.asarray(calibration.axis_depth_mm[index] + ripple_basis(angle_rad) @ calibration.ripple_mm[index])


def _bend_rad(calibration: OctCalibration, index: int, angle_rad: Coordinates) -> Coordinates:
    """By how much the glass turns the beams at ``angle_rad``; 0 where the glass is not known."""
    if not calibration.glass_mm:
        return np.zeros_like(angle_rad)
    passing = calibration.offset_x_mm[index] * np.sin(angle_rad) - calibration.offset_y_mm[index] * np.cos(angle_rad)
    medium = calibration.acquisition.medium_index
    return bend_rad(passing, calibration.capillary_radius_mm, calibration.glass_mm, medium)
