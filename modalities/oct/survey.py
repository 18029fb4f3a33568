"""One pass over a pullback: where the capillary lies in every slice, and the levels of noise and wall."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.numbering import notes_on_gaps
from endoct.modalities.oct.bscan import logarithmic, reduce_theta, sector_angles_rad
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.face.capillary import Faces, locate_faces, refit_faces, starts_anywhere
from endoct.modalities.oct.face.glass import glass_mm
from endoct.modalities.oct.face.lines import Points, find_lines, line_points
from endoct.modalities.oct.face.slices import SliceEvidence
from endoct.modalities.oct.levels import measure_levels
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.fixed_lines import fixed_line_excess, points_off
from endoct.modalities.oct.turning.rotation import Rotation, even_rotation
from endoct.modalities.oct.turning.start_angle import measure_starts
from endoct.modalities.oct.turning.uneven_turn import measure_turns, turned
from endoct.stitching.arrays import Coordinates, Image, Mask
from endoct.stitching.errors import NotSeen
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.kept import Computed, Kept
from endoct.stitching.parallel import thread_map

SURVEY_COLUMNS = 256
KEPT_ASCANS = 96
MOST_COLUMNS = 2048
LINE_OF_FACE_MM = 0.06  # nearer to the outer face, what stands out is the face itself
FIRST_SAMPLE_TOLERANCE_MM = 0.2  # the glass alone delays the face by (n − 1)·t, 0.05–0.14 mm


def survey_pullback(stream: FrameStream, parameters: OctParameters) -> OctCalibration:
    """Survey ``stream`` in one pass. Raises :class:`NotSeen` where it shows no capillary, or nothing at all."""
    acquisition = cast(OctAcquisition, stream.acquisition)
    n_ascans, n_depth = stream[0].samples.shape
    n_theta = min(parameters.n_theta or MOST_COLUMNS, n_ascans)
    examine = partial(_examine, acquisition=acquisition, parameters=parameters, n_theta=n_theta)
    with Kept[SliceEvidence]() as kept:
        places = []
        for place, evidence in thread_map(examine, stream):
            places.append(place)
            kept.append(evidence)
        return _calibrated(np.array(places), kept, acquisition, parameters, n_theta, (n_ascans, n_depth))


def _calibrated(
    z_mm: Coordinates,
    kept: Kept[SliceEvidence],
    acquisition: OctAcquisition,
    parameters: OctParameters,
    n_theta: int,
    shape: tuple[int, int],
) -> OctCalibration:
    """Return the calibration of B-scans of ``shape`` from what was ``kept`` of each, in recording order."""
    inward = np.argsort(z_mm, kind="stable")
    slices: Sequence[SliceEvidence] = Computed(len(kept), lambda i: kept[int(inward[i])])
    _reject_empty(slices)

    mm_per_px = acquisition.mm_per_px
    line_excess = fixed_line_excess(_every_ascan(slices, max(1, len(slices) // 40)), mm_per_px)
    radius_mm, bore_mm = acquisition.capillary_outer_diameter_mm / 2, acquisition.bore_diameter_mm / 2
    faces = locate_faces(slices, radius_mm, bore_mm - radius_mm, mm_per_px, parameters)
    thickness = glass_mm(slices, faces, acquisition.medium_index)
    slices, faces, rotation, told = _turned(slices, faces, thickness, line_excess > 0, acquisition, parameters)
    background = measure_levels(slices, faces, line_excess, radius_mm, bore_mm - radius_mm, mm_per_px)
    recorded = np.argsort(inward, kind="stable")
    faces, rotation = faces.reordered(recorded), rotation.reordered(recorded)
    row_z_mm = z_mm[inward]
    grid = SurfaceGrid.full_circle(
        len(row_z_mm),
        n_theta,
        z0_mm=float(row_z_mm[0]),
        dz_mm=float(np.median(np.diff(row_z_mm))) if len(row_z_mm) > 1 else acquisition.pullback_pitch_mm,
        radius_mm=bore_mm,
    )
    return OctCalibration(
        grid=grid,
        row_z_mm=row_z_mm,
        per_frame=_per_frame(z_mm, faces, rotation, thickness, acquisition),
        notes=(*_notes(faces, line_excess, acquisition), *told),
        acquisition=acquisition,
        parameters=parameters,
        n_ascans=shape[0],
        n_depth=shape[1],
        slice_z_mm=z_mm,
        rotation=rotation,
        offset_x_mm=faces.x_mm,
        offset_y_mm=faces.y_mm,
        axis_depth_mm=faces.axis_depth_mm,
        ripple_mm=faces.ripple_mm,
        glass_mm=thickness,
        sines=faces.sines,
        bridged=faces.bridged,
        background=background,
    )


def _turned(
    slices: Sequence[SliceEvidence],
    faces: Faces,
    thickness_mm: float,
    fixed_line: Mask,
    acquisition: OctAcquisition,
    parameters: OctParameters,
) -> tuple[Sequence[SliceEvidence], Faces, Rotation, tuple[str, ...]]:
    """Return slices and faces with the angles of beams in place of nominal ones, the rotation, and notes on it.

    All in the order of z.
    """
    rotation, notes = even_rotation(len(slices)), []
    radius_mm, bore_mm = acquisition.capillary_outer_diameter_mm / 2, acquisition.bore_diameter_mm / 2
    mm_per_px = acquisition.mm_per_px
    if parameters.correct_rotation or parameters.correct_turn_length or parameters.correct_lost_ascans:
        nominal = slices

        def clear(i: int) -> SliceEvidence:
            evidence = nominal[i]
            return replace(evidence, points=points_off(fixed_line, evidence.points, mm_per_px))

        within_turns, faces = measure_turns(Computed(len(nominal), clear), faces, radius_mm, thickness_mm, parameters)
        rotation = within_turns
        slices = Computed(len(nominal), lambda i: turned(nominal[i], within_turns, i))
        faces = refit_faces(slices, faces, radius_mm, parameters)
        if count := int(np.count_nonzero(np.isfinite(rotation.lost_at_rad))):
            notes.append(f"{count} of {len(slices)} slices lack a block of A-scans; what lay there is not valid.")
    if parameters.correct_start_angle:
        rotation, how = measure_starts(slices, faces, rotation, radius_mm, bore_mm, mm_per_px, parameters)
        notes += [how] if how else []
    elif starts_anywhere(faces.x_mm, faces.y_mm, ~faces.bridged, parameters):
        notes.append("Turns start anywhere; this was not corrected, so that slices lie at unrelated angles.")
    return slices, faces, rotation, tuple(notes)


def _examine(
    frame: Frame, acquisition: OctAcquisition, parameters: OctParameters, n_theta: int
) -> tuple[float, SliceEvidence]:
    mm_per_px = acquisition.mm_per_px
    n_ascans, n_depth = frame.samples.shape
    fine = reduce_theta(frame.samples, n_theta)
    n_columns = min(SURVEY_COLUMNS, n_theta)
    coarse = logarithmic(reduce_theta(fine, n_columns), acquisition.intensity)
    kept = np.linspace(0, n_theta, min(KEPT_ASCANS, n_theta), endpoint=False).astype(int)
    angle_rad = sector_angles_rad(n_ascans, n_columns)
    if float(np.ptp(coarse)) > 0:
        points = line_points(coarse, angle_rad, mm_per_px, parameters)
    else:
        points = Points(np.empty(0), np.empty(0), np.empty(0))
    lines = find_lines(
        points,
        angle_rad,
        n_depth * mm_per_px,
        mm_per_px,
        acquisition.capillary_outer_diameter_mm / 2,
        parameters.ransac_trials,
        np.random.default_rng((parameters.seed, frame.index)),
    )
    ascans = logarithmic(fine[kept], acquisition.intensity)
    return frame.z_mm, SliceEvidence(
        points, n_columns, lines, ascans, sector_angles_rad(n_ascans, n_theta)[kept], _saturated(frame)
    )


def _saturated(frame: Frame) -> bool:
    some = frame.samples[:: max(1, frame.samples.shape[0] // 64)]
    return some.dtype.kind == "u" and bool(np.median(some) == np.iinfo(some.dtype).max)


def _every_ascan(slices: Sequence[SliceEvidence], step: int) -> Image:
    """Return every ``step``-th of all the slices' A-scans, float32 (n, depth)."""
    some, first = [], 0
    for evidence in slices:
        some.append(evidence.ascans[first::step].copy())  # a view would hold them all
        first = (first - len(evidence.ascans)) % step
    return np.concatenate(some)


def _reject_empty(slices: Sequence[SliceEvidence]) -> None:
    seen = [(float(np.ptp(s.ascans)), s.saturated) for s in slices]
    if max(seen)[0] == 0:
        raise NotSeen(
            "the pullback shows nothing",
            found=f"one value, {float(slices[0].ascans.flat[0]):g}, all over",
            expected="B-scans of a capillary in a bore",
            remedy="check that the light source was on and the export is right",
        )
    if 2 * sum(saturated for _, saturated in seen) > len(slices):
        raise NotSeen(
            "the pullback is saturated",
            found="more than half of the samples at the largest value",
            expected="B-scans of a capillary in a bore",
            remedy="record or export it with a smaller gain",
        )


def _per_frame(
    z_mm: Coordinates, faces: Faces, rotation: Rotation, thickness_mm: float, acquisition: OctAcquisition
) -> dict[str, Coordinates]:
    sense = -1 if acquisition.handedness == "mirrored" else 1
    direction = acquisition.theta_origin_rad + sense * (np.arctan2(faces.y_mm, faces.x_mm) + rotation.start_rad)
    return {
        "z_mm": z_mm,
        "sine_amplitude_mm": np.array([sine.amplitude_mm for sine in faces.sines]),
        "sine_omega": np.array([sine.omega for sine in faces.sines]),
        "sine_phase_rad": np.array([sine.phase_rad for sine in faces.sines]),
        "sine_offset_mm": np.array([sine.offset_mm for sine in faces.sines]),
        "offset_mm": np.hypot(faces.x_mm, faces.y_mm),
        "offset_direction_rad": np.mod(direction, 2 * np.pi),
        "glass_mm": np.full_like(z_mm, thickness_mm),
        "inlier_fraction": faces.inlier_fraction,
        "residual_mm": faces.residual_mm,
        "bridged": faces.bridged,
        "start_angle_rad": rotation.start_rad,
        "start_angle_known": rotation.start_known,
        "start_angle_sigma_rad": rotation.start_sigma_rad,
        "turn_length": 1 + rotation.stretch,
        "rotation_amplitude_rad": rotation.peak_rad(),
        "rotation_known": rotation.shape_known,
        "rotation_sigma_rad": rotation.shape_sigma_rad,
        "rotation_harmonics_rad": rotation.smooth_rad,
        "lost_at_rad": rotation.lost_at_rad,
        "lost_rad": rotation.lost_rad,
    }


def _notes(faces: Faces, line_excess: Image, acquisition: OctAcquisition) -> tuple[str, ...]:
    notes = []
    if count := int(np.count_nonzero(faces.bridged)):
        notes.append(
            f"{count} of {faces.bridged.size} slices did not show the capillary's outer face well enough; "
            "their geometry is bridged from their neighbours and their samples are not valid."
        )
    if acquisition.first_sample_mm is not None:
        expected = -acquisition.first_sample_mm / acquisition.medium_index
        difference = float(np.median(faces.axis_depth_mm)) - expected
        if not -0.05 <= difference <= FIRST_SAMPLE_TOLERANCE_MM:
            notes.append(
                f"The sidecar's first_sample_mm puts the axis at a depth of {expected:.3f} mm, the capillary's outer "
                f"face at {expected + difference:.3f} mm; the capillary was trusted."
            )
    face_mm = float(np.min(faces.axis_depth_mm - np.hypot(faces.x_mm, faces.y_mm)))
    face_mm += acquisition.capillary_outer_diameter_mm / 2 + LINE_OF_FACE_MM
    beyond = np.flatnonzero(line_excess > 0)
    beyond = beyond[beyond * acquisition.mm_per_px > face_mm]
    if beyond.size:
        notes.append(
            f"Depth rows {_ranges(beyond)} hold fixed lines of the detector, which were taken out; a wall just there "
            "is less certain."
        )
    return (*notes, *notes_on_gaps(acquisition.positions_mm))


def _ranges(rows: NDArray[np.intp]) -> str:
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return ", ".join(f"{run[0]}–{run[-1]}" if run.size > 1 else f"{run[0]}" for run in runs)
