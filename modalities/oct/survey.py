"""One pass over a pullback: the capillary in every slice, how the catheter turned, and the recording's levels."""

from collections.abc import Sequence
from functools import partial
from typing import cast

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.compute.memory import Computed, Kept
from endoct.base.compute.parallel import at_once, thread_map
from endoct.base.errors import NotSeen
from endoct.base.numeric.sine import Sine, ransac_sine
from endoct.modalities.contract import FrameStream
from endoct.modalities.oct.bscan import UPSIDE_DOWN, ascans_of, columns_of
from endoct.modalities.oct.calibration import OctCalibration, notes_on_survey, per_slice_values
from endoct.modalities.oct.face.course import measure_course
from endoct.modalities.oct.face.face_circle import Circle
from endoct.modalities.oct.face.faces import Faces, locate_faces
from endoct.modalities.oct.face.glass import measure_glass
from endoct.modalities.oct.face.points import Points
from endoct.modalities.oct.face.slices import SliceFeatures, examine_bscan
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.fixed_lines import FixedLines, find_fixed_lines
from endoct.modalities.oct.surface.levels import measure_floor, measure_levels
from endoct.modalities.oct.surface.trust import measure_raw_levels
from endoct.modalities.oct.turning.rotation import even_rotation
from endoct.modalities.oct.turning.uneven_turn import Turns, correct_starts, correct_uneven_turns
from endoct.stitching.grid import SurfaceGrid


def survey_pullback(stream: FrameStream, parameters: OctParameters) -> OctCalibration:
    """Survey ``stream`` in one pass: by several threads as it is read, then mostly by one: small steps wait for others.

    Raises :class:`NotSeen` where it shows no capillary or nothing, or is upside down.
    """
    acquisition = cast(OctAcquisition, stream.acquisition)
    first = stream[0]
    n_ascans, n_depth, n_theta = ascans_of(first), first.samples.shape[1], columns_of(first, parameters)
    examine = partial(examine_bscan, acquisition=acquisition, parameters=parameters, n_theta=n_theta)
    with Kept[SliceFeatures]() as kept:
        places = []
        for place_mm, features in thread_map(examine, stream):
            places.append(place_mm)
            kept.append(features)
        z_mm = np.array(places)
        inward = np.argsort(z_mm, kind="stable")
        slices = Computed(len(kept), lambda i: kept[int(inward[i])])
        _reject_empty(slices)
        _reject_upside_down(slices)
        faces = locate_faces(slices, acquisition, parameters)
        glass = measure_glass(slices, faces, acquisition.medium_index)
        seek_lines = (
            partial(find_fixed_lines, slices, faces, glass, acquisition)
            if parameters.fixed_lines
            else partial(FixedLines.none, n_depth)
        )
        lines, (course, sines) = at_once(
            seek_lines, lambda: (measure_course(slices, faces, glass), fit_sines(slices, faces, parameters))
        )
        turns = Turns(slices, faces, even_rotation(len(slices)))
        turns = correct_uneven_turns(turns, glass, lines.excess > 0, acquisition, parameters)
        turns = correct_starts(turns, glass, acquisition, parameters)
        floor = measure_floor(turns.slices, turns.faces, lines.excess > 0, acquisition)
        background = measure_levels(turns.slices, turns.faces, lines.excess, floor, acquisition)
        raw_levels = measure_raw_levels(turns.slices, turns.faces, lines.excess > 0, acquisition)
    recorded = np.argsort(inward, kind="stable")
    faces, rotation = turns.faces.reordered(recorded), turns.rotation.reordered(recorded)
    sines = tuple(sines[i] for i in recorded)
    return OctCalibration(
        grid=_grid(z_mm[inward], n_theta, acquisition),
        row_z_mm=z_mm[inward],
        per_frame=per_slice_values(z_mm, faces, sines, rotation, glass, acquisition),
        notes=(*notes_on_survey(faces, lines, acquisition), *turns.notes),
        acquisition=acquisition,
        parameters=parameters,
        n_ascans=n_ascans,
        n_depth=n_depth,
        slice_z_mm=z_mm,
        rotation=rotation,
        faces=faces,
        sines=sines,
        glass=glass,
        course=course,
        background=background,
        raw_levels=raw_levels,
    )


def _grid(row_z_mm: Coordinates, n_theta: int, acquisition: OctAcquisition) -> SurfaceGrid:
    return SurfaceGrid.full_circle(
        len(row_z_mm),
        n_theta,
        z0_mm=float(row_z_mm[0]),
        dz_mm=float(np.median(np.diff(row_z_mm))) if len(row_z_mm) > 1 else acquisition.pullback_pitch_mm,
        radius_mm=acquisition.bore_radius_mm,
    )


def _reject_upside_down(slices: Sequence[SliceFeatures]) -> None:
    share = float(np.mean([features.brightening for features in slices]))
    if share < UPSIDE_DOWN:
        raise NotSeen(
            "the pullback is upside down: depth seems to run from the last row to the first",
            found=f"in {1 - share:.0%} of the directions it darkens with depth faster than it brightens",
            expected="tissue that is brightest at its surface and fades behind it",
            remedy="turn the pages over, so that the catheter lies at the first row, and export them again",
        )


def _reject_empty(slices: Sequence[SliceFeatures]) -> None:
    ranges = [(float(np.ptp(s.ascans)), s.saturated) for s in slices]
    if max(ranges)[0] == 0:
        raise NotSeen(
            "the pullback shows nothing",
            found=f"one value, {float(slices[0].ascans.flat[0]):g}, all over",
            expected="B-scans of a capillary in a bore",
            remedy="check that the light source was on and the export is right",
        )
    if 2 * sum(saturated for _, saturated in ranges) > len(slices):
        raise NotSeen(
            "the pullback is saturated",
            found="more than half of the samples at the largest value",
            expected="B-scans of a capillary in a bore",
            remedy="record or export it with a smaller gain",
        )


def _sine_of_slice(points: Points, circle: Circle, index: int, parameters: OctParameters) -> Sine:
    """Return the sine of one slice through its ``points`` near ``circle``; fewer than four leave the start value.

    That is what ``parameters`` give, and the first order of the circle for the rest. A catheter off the axis by e in
    the direction β sees the face as a circle. With ω = 1, A = e and φ = −β − π/2, the sine is its first order.
    """
    # by how much the circle's mean depth falls short of that of a catheter on the axis
    second_order_mm = circle.offset_mm**2 / (4 * circle.radius_mm)
    amplitude_mm, phase_rad = parameters.start_amplitude_mm, parameters.start_phase_rad
    phase_rad = -circle.direction_rad - np.pi / 2 if phase_rad is None else phase_rad
    start = Sine(
        amplitude_mm=circle.offset_mm if amplitude_mm is None else amplitude_mm,
        omega=1.0,
        phase_rad=float(np.mod(phase_rad, 2 * np.pi)),
        offset_mm=circle.axis_depth_mm + circle.radius_mm - second_order_mm,
    )
    near = points.where(np.abs(points.beyond_mm(circle)) < 2 * parameters.face_tolerance_mm)
    if len(near) < 4:
        return start
    sine, _ = ransac_sine(
        near.angle_rad,
        near.depth_mm,
        tolerance_mm=parameters.face_tolerance_mm + second_order_mm,
        trials=parameters.ransac_trials,
        rng=np.random.default_rng((parameters.seed, index)),
        start=start,
    )
    return sine


def fit_sines(slices: Sequence[SliceFeatures], faces: Faces, parameters: OctParameters) -> tuple[Sine, ...]:
    """Return the paper's sine of every slice; a bridged one gets the first order of its circle."""
    shown = (Points.none() if bridged else slices[i].points for i, bridged in enumerate(faces.bridged))
    return tuple(_sine_of_slice(points, faces.capillary.circle(i), i, parameters) for i, points in enumerate(shown))
