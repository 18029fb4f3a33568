"""One B-scan to one row of the panorama."""

from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.modalities.contract import Frame
from endoct.modalities.oct.bscan import Spacing, logarithmic, reduced, sector_angles_rad, varying
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.surface.fixed_lines import with_lines_of
from endoct.modalities.oct.surface.line_removal import bridge_rows, without_lines
from endoct.modalities.oct.surface.second_look import SecondLook, look_again
from endoct.modalities.oct.surface.wall import brightest, first_edge, maximum_intensity, trusted, wall_sigmas
from endoct.modalities.oct.undistort import beam_angles_rad, depth_at_radius_mm, face_depth_mm, radius_mm
from endoct.stitching.strip import Strip


@dataclass(frozen=True, eq=False)
class BeamProfile:
    """The outer face and the wall in each of ``n_theta`` sectors of a turn.

    Attributes: ``angle_rad`` of the sectors' centres from A-scan 0; ``face_mm`` and ``wall_mm``, depths of the outer
    face and of the wall's surface from depth sample 0 (of the last sample where there is no surface); ``surface``,
    whether there is one; ``intensity``, the projection; ``trusted``, whether the surface is the wall's;
    ``wall_sigmas``, by how much the wall stands out in the whole slice; ``second_look``, what speaks against it all;
    ``level``, the B-scan in which the wall was sought, logarithmic and without fixed lines, (n_theta, n_depth).
    """

    angle_rad: Coordinates
    face_mm: Coordinates
    wall_mm: Coordinates
    surface: Mask
    intensity: Image
    trusted: Mask
    wall_sigmas: float
    second_look: SecondLook
    level: Image


def profile_beams(frame: Frame, calibration: OctCalibration) -> BeamProfile:
    """Return the outer face and the wall in every sector of one B-scan."""
    parameters, acquisition = calibration.parameters, calibration.acquisition
    n_theta, mm = calibration.grid.n_theta, calibration.mm_per_px
    bscan = reduced(frame, n_theta)
    samples, angle = bscan.samples, sector_angles_rad(bscan.n_ascans, n_theta)
    face = face_depth_mm(calibration, frame.index, angle)
    n_depth = samples.shape[1]
    first_row = np.clip(np.ceil((face + parameters.clearance_mm) / mm), 0, n_depth - 1).astype(np.intp)
    background, recorded = calibration.background, logarithmic(samples, acquisition.intensity)
    if parameters.fixed_lines:
        circle = calibration.capillary.circle(frame.index)
        background = with_lines_of(recorded, background, circle, calibration.glass.path_mm, mm)
    level, lines = without_lines(recorded, background), background.lines
    spacing = Spacing(mm, calibration.grid.dtheta_mm)
    if parameters.wall == "maximum":
        row = brightest(bridge_rows(bscan.image, lines), first_row)
    else:
        row = first_edge(level, first_row, background, spacing, parameters)
    surface = row < n_depth
    good = varying(samples) & trusted(level, row, background, spacing)
    wall = depth_at_radius_mm(calibration, frame.index, angle, np.full(n_theta, calibration.grid.radius_mm))
    return BeamProfile(
        angle_rad=angle,
        face_mm=face,
        wall_mm=np.minimum(row, n_depth - 1) * mm,
        surface=surface,
        intensity=maximum_intensity(samples, first_row, lines),
        trusted=good,
        wall_sigmas=wall_sigmas(level, row, good, background, spacing),
        second_look=look_again(recorded, row, wall, good, lines, calibration.raw_levels, spacing),
        level=level,
    )


def unroll_bscan(frame: Frame, calibration: OctCalibration) -> Strip:
    """Return the panorama's row of one B-scan: intensity and depth at each θ. Pure.

    θ of a column is where the beam crosses the nominal bore surface, so that an opening there appears at its own
    θ; its depth is that of the surface the beam meets. Where the beam meets no surface in range (a deep cell), the
    depth is that of the last sample, a lower bound. Not valid are bridged slices, slices whose wall hardly stands out
    of the noise, dead A-scans, anything before the wall, and angles that no A-scan recorded.

    Back to the catheter: with c = offset·(cos, sin)(offset direction) of the slice, the sample at column θ lies on the
    beam from c towards R·(cos, sin)(θ + bend), where its distance from the axis is R + depth; R is the nominal bore
    radius, bend up to 2° where ``glass_mm`` is not 0 (:mod:`endoct.modalities.oct.face.glass`).
    """
    beams = profile_beams(frame, calibration)
    grid = calibration.grid
    wall_radius = radius_mm(calibration, frame.index, beams.angle_rad, beams.wall_mm)
    wanted, recorded = beam_angles_rad(calibration, frame.index, grid.theta_rad)
    step = 2 * np.pi / grid.n_theta
    nearest = np.round((wanted - beams.angle_rad[0]) / step).astype(np.intp) % grid.n_theta
    faint = beams.wall_sigmas < calibration.parameters.least_wall_sigmas
    valid = beams.trusted & (not faint and not calibration.bridged[frame.index])
    return Strip(
        z_mm=np.array([frame.z_mm]),
        theta_rad=grid.theta_rad,
        intensity=beams.intensity[nearest][None],
        depth_mm=(wall_radius - grid.radius_mm)[nearest][None],
        valid=(valid[nearest] & recorded)[None],
        weight=np.ones((1, grid.n_theta), np.float32),
        diagnostics={
            "surface_fraction": float(beams.surface.mean()),
            "wall_sigmas": beams.wall_sigmas,
            "opening_fraction": beams.second_look.openings,
            "bone_before_fraction": beams.second_look.bone_before,
            "dark_wall_fraction": beams.second_look.dark_wall,
        },
    )
