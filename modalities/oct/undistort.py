"""From the depth along a beam to radius and angle about the capillary's axis, and back; B-scans on such a grid.

There are two methods. "eccentric" uses the catheter's position. A sample at distance ρ along the beam at angle α
lies at e + ρ·u(α), turned as far as the glass bends the beam. "sine" is the paper's (Laves
2019, Image undistortion). Every A-scan is shifted by the fitted sine and keeps its angle, which is right for the
radius to first order only.

Three angles occur: θ of the panorama, the direction of a beam in the frame of its slice, and the nominal angle of
an A-scan. The last is its share of the turn. :mod:`endoct.modalities.oct.turning.rotation` relates all three.

B-scans are resampled on (θ, radius) about the capillary's axis: everything from there outward, sub-surface
included. All of them together are the dense volume, a hollow cylinder in a panorama's store.
"""

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.parallel import thread_map
from endoct.base.zarr.zarr_store import Named, consolidate, new_array, write_arrays
from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.oct.bscan import reduce_theta, sector_angles_rad
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.face.faces import ripple_basis

INSIDE_MM = 0.05
OUTSIDE_PX = -10.0


def beam_angles_rad(calibration: OctCalibration, index: int, theta_rad: Coordinates) -> tuple[Coordinates, Mask]:
    """Return the nominal angle of the A-scan that crosses the nominal bore surface at each ``theta_rad``.

    The second array, bool, says whether there is one: short turns and lost A-scans leave gaps.
    """
    beam = _beams_at_bore(calibration, index, theta_rad)
    return calibration.rotation.nominal_rad(index, beam, calibration.n_ascans)


def face_depth_mm(calibration: OctCalibration, index: int, nominal_rad: Coordinates) -> Coordinates:
    """Return the depth of the outer face, from sample 0 and in the medium, in the A-scans at ``nominal_rad``."""
    if calibration.parameters.undistort == "sine":
        return calibration.sines[index](nominal_rad)
    beam = calibration.rotation.beam_rad(index, nominal_rad)
    return calibration.capillary.circle(index).distance_mm(beam) + _depth_of_axis(calibration, index, beam)


def radius_mm(calibration: OctCalibration, index: int, nominal_rad: Coordinates, depth_mm: Coordinates) -> Coordinates:
    """Return the distance from the capillary's axis, mm, of depths ``depth_mm`` in the A-scans at ``nominal_rad``."""
    if calibration.parameters.undistort == "sine":
        return np.asarray(depth_mm - calibration.sines[index](nominal_rad) + calibration.capillary.radius_mm)
    beam = calibration.rotation.beam_rad(index, nominal_rad)
    along = depth_mm - _depth_of_axis(calibration, index, beam)
    face = calibration.capillary.circle(index)
    x = face.x_mm + along * np.cos(beam)
    y = face.y_mm + along * np.sin(beam)
    return np.asarray(np.hypot(x, y))


def beam_of(
    calibration: OctCalibration, index: int, theta_rad: Coordinates, radius: Coordinates
) -> tuple[Coordinates, Coordinates]:
    """Return (nominal angle, depth in mm) at which the place (r, θ) about the axis was recorded; shapes broadcast.

    The depth is NaN where no A-scan was recorded.
    """
    turned = _in_slice_rad(calibration, index, theta_rad)
    if calibration.parameters.undistort == "sine":
        nominal, recorded = calibration.rotation.nominal_rad(index, turned, calibration.n_ascans)
        depth = np.where(recorded, radius - calibration.capillary.radius_mm + calibration.sines[index](nominal), np.nan)
        return np.broadcast_to(nominal, depth.shape), depth
    # ripple and bend are smooth: over the few degrees that one θ spans along the radius they are those at the wall
    at_bore = _beams_at_bore(calibration, index, np.ravel(theta_rad))
    turned = turned + bend_rad(calibration, index, at_bore).reshape(np.shape(theta_rad))
    face = calibration.capillary.circle(index)
    x = radius * np.cos(turned) - face.x_mm
    y = radius * np.sin(turned) - face.y_mm
    axis = _depth_of_axis(calibration, index, at_bore).reshape(np.shape(theta_rad))
    nominal, recorded = calibration.rotation.nominal_rad(index, np.arctan2(y, x), calibration.n_ascans)
    return nominal, np.where(recorded, np.hypot(x, y) + axis, np.nan)


def depth_at_radius_mm(
    calibration: OctCalibration, index: int, nominal_rad: Coordinates, radius: Coordinates
) -> Coordinates:
    """Return the depth, mm, at which the A-scans at ``nominal_rad`` are ``radius`` from the axis; undoes ``radius_mm``.

    NaN where a beam never is that far.
    """
    if calibration.parameters.undistort == "sine":
        return np.asarray(radius - calibration.capillary.radius_mm + calibration.sines[index](nominal_rad))
    beam = calibration.rotation.beam_rad(index, nominal_rad)
    face = calibration.capillary.circle(index)
    ahead = face.x_mm * np.cos(beam) + face.y_mm * np.sin(beam)
    squared = radius**2 - (face.x_mm * np.sin(beam) - face.y_mm * np.cos(beam)) ** 2
    along = np.sqrt(np.where(squared >= 0, squared, np.nan)) - ahead
    return np.asarray(along + _depth_of_axis(calibration, index, beam))


def theta_at_radius(
    calibration: OctCalibration, index: int, nominal_rad: Coordinates, radius: Coordinates
) -> Coordinates:
    """Return θ of the panorama, [0, 2π), at which the A-scans at ``nominal_rad`` are ``radius`` from the axis."""
    beam = calibration.rotation.beam_rad(index, nominal_rad)
    turned = beam
    if calibration.parameters.undistort != "sine":
        along = depth_at_radius_mm(calibration, index, nominal_rad, radius) - _depth_of_axis(calibration, index, beam)
        face = calibration.capillary.circle(index)
        turned = np.arctan2(face.y_mm + along * np.sin(beam), face.x_mm + along * np.cos(beam))
        turned = turned - bend_rad(calibration, index, beam)
    in_frame = turned + calibration.rotation.start_rad[index]
    return np.asarray(
        np.mod(calibration.acquisition.sense * in_frame + calibration.acquisition.theta_origin_rad, 2 * np.pi)
    )


def _in_slice_rad(calibration: OctCalibration, index: int, theta_rad: Coordinates) -> Coordinates:
    """The angle of a panorama's θ in the frame of one slice."""
    from_origin_rad = calibration.acquisition.sense * (theta_rad - calibration.acquisition.theta_origin_rad)
    return np.asarray(np.mod(from_origin_rad, 2 * np.pi) - calibration.rotation.start_rad[index])


def _beams_at_bore(calibration: OctCalibration, index: int, theta_rad: Coordinates) -> Coordinates:
    """The direction, in the slice's frame, of the beam that crosses the nominal bore surface at each θ, [0, 2π)."""
    turned = _in_slice_rad(calibration, index, theta_rad)
    if calibration.parameters.undistort == "sine":
        return np.mod(turned, 2 * np.pi)
    radius, face = calibration.grid.radius_mm, calibration.capillary.circle(index)
    beam = turned
    bend: Coordinates = np.zeros_like(turned)
    for _ in range(3 if calibration.glass.thickness_mm else 1):
        beam = np.arctan2(radius * np.sin(turned + bend) - face.y_mm, radius * np.cos(turned + bend) - face.x_mm)
        bend = bend_rad(calibration, index, beam)
    return np.asarray(np.mod(beam, 2 * np.pi))


def _depth_of_axis(calibration: OctCalibration, index: int, beam_rad: Coordinates) -> Coordinates:
    """The depth at which ρ = 0, in every beam: the circle's, and the face's departure from the circle."""
    faces = calibration.faces
    return np.asarray(faces.capillary.axis_depth_mm[index] + ripple_basis(beam_rad) @ faces.ripple_mm[index])


def bend_rad(calibration: OctCalibration, index: int, beam_rad: Coordinates) -> Coordinates:
    """Return by how much the glass turns the beams of a slice at ``beam_rad``, rad; 0 where the glass is not known."""
    face = calibration.capillary.circle(index)
    return calibration.glass.bend_rad(np.asarray(face.x_mm * np.sin(beam_rad) - face.y_mm * np.cos(beam_rad)))


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


def write_volume(stream: FrameStream, calibration: OctCalibration, store: Path) -> None:
    """Write the group ``volume`` into the Zarr ``store``: ``intensity`` (z, theta, depth), one slice a chunk.

    ``radius`` (mm, from the capillary's axis) lies along depth. Samples keep the recording's type; outside what
    was recorded they are 0 (NaN in a float recording).
    """
    grid, radii = calibration.grid, volume_radii_mm(calibration)
    dtype = stream[0].samples.dtype
    arrays = {
        "z": Named(("z",), calibration.row_z_mm, {"units": "mm"}),
        "theta": Named(("theta",), grid.theta_rad, {"units": "rad"}),
        "radius": Named(("depth",), radii, {"units": "mm"}),
    }
    group = write_arrays(store / "volume", arrays, {"radius_mm": grid.radius_mm}, coordinates=["radius"])
    sizes = {"z": grid.n_z, "theta": grid.n_theta, "depth": radii.size}
    array = new_array(group, "intensity", sizes, dtype, chunks=(1, grid.n_theta, radii.size))
    rows = np.searchsorted(calibration.row_z_mm, calibration.slice_z_mm)
    slices: Iterable[Image] = thread_map(partial(resample, calibration=calibration, radii_mm=radii), stream)
    for row, samples in zip(rows, slices, strict=True):
        array[int(row)] = as_recorded(samples, dtype)
    for place in (store / "volume", store):  # a reader may begin at either
        consolidate(place)
