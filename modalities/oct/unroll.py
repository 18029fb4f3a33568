"""One B-scan to one row of the panorama, and the panorama settled once all its rows are there.

A row holds of each A-scan its maximum beyond the capillary, and the depth of the wall's surface. Nothing is smoothed
across slices: they are farther apart than the rims of cells are wide.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.modalities.contract import Frame
from endoct.modalities.oct.bscan import Spacing, logarithmic, reduced, varying
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.doubts import (
    doubts_of_floor,
    doubts_of_lines,
    doubts_of_sizes,
    doubts_of_surface,
    doubts_of_turns,
)
from endoct.modalities.oct.surface.background import bridge_rows, with_lines_of, without_lines
from endoct.modalities.oct.surface.trust import SecondLook, look_again, trusted, wall_sigmas
from endoct.modalities.oct.surface.wall import first_edge
from endoct.modalities.oct.undistort import beam_angles_rad, depth_at_radius_mm, face_depth_mm, radius_mm
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame
from endoct.stitching.strip import Strip


@dataclass(frozen=True, eq=False)
class BeamProfile:
    """The outer face and the wall in each of ``n_theta`` sectors of a turn.

    Attributes: ``angle_rad`` of the sectors' centres from A-scan 0; ``face_mm`` and ``wall_mm``, depths of the outer
    face and of the wall's surface from depth sample 0; ``surface``, whether there is one; ``intensity``, the
    projection; ``trusted``, whether the surface is the wall's; ``wall_sigmas``, by how much the wall stands out in the
    whole slice; ``second_look``, what speaks against it all; ``level``, the B-scan in which the wall was sought,
    logarithmic and without fixed lines, (n_theta, n_depth). Without a surface, the depth is that of the last sample.
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
    samples, angle = bscan.samples, bscan.angle_rad
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


def brightest(image: Image, first_row: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the index of the maximum from ``first_row`` (n,) on of every A-scan of ``image`` (n, depth).

    Laves 2019, Extracting mastoid pattern, implemented literally.
    """
    return np.asarray(np.argmax(_beyond(image, first_row), axis=1))


def maximum_intensity(samples: NDArray[Any], first_row: NDArray[np.intp], lines: Mask) -> Image:
    """Return the maximum of each A-scan of ``samples`` (n, depth) cropped from ``first_row`` (n,) on, float32 (n,).

    The rows ``lines``, bool (depth,), are interpolated from their neighbours. Laves 2019, Extracting mastoid pattern:
    crop, then maximum intensity projection along depth.
    """
    image, nearest = bridge_rows(np.asarray(samples, np.float32), lines), int(first_row.min())
    return np.asarray(np.fmax.reduce(_beyond(image[:, nearest:], first_row - nearest), axis=1), np.float32)


def _beyond(image: Image, first_row: NDArray[np.intp]) -> Image:
    """``image`` (n, depth) with −∞ before ``first_row`` (n,)."""
    return np.where(np.arange(image.shape[1]) >= first_row[:, None], image, np.float32(-np.inf))


def unroll_bscan(frame: Frame, calibration: OctCalibration) -> Strip:
    """Return the panorama's row of one B-scan: intensity and depth at each θ. Pure.

    θ of a column is where the beam crosses the nominal bore surface, so that an opening there appears at its own θ.
    Its depth is that of the surface the beam meets. Where the beam meets none in range (a deep cell), the depth is that
    of the last sample, a lower bound. Bridged slices are not valid, nor slices whose wall hardly stands out of the
    noise. Dead A-scans, anything before the wall, and angles that no A-scan recorded are not valid either.

    Back to the catheter: let c = offset·(cos, sin)(offset direction) of the slice. The sample at column θ lies on the
    beam from c towards R·(cos, sin)(θ + bend), where its distance from the axis is R + depth. R is the nominal bore
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


def settle_pullback(panorama: Panorama, calibration: OctCalibration) -> Panorama:
    """Return ``panorama`` with a helical scan's rows sheared into place, and doubts of what contradicts the sidecar."""
    panorama = _with_faint_slices(panorama, calibration)
    of_levels = (*doubts_of_floor(calibration.background), *doubts_of_lines(calibration))
    of_surface = (*of_levels, *doubts_of_surface(panorama))
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
