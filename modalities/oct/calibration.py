"""What the survey of a pullback measured: all that unrolling needs besides a B-scan, values of slices, and notes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.numeric.sine import Sine
from endoct.modalities.oct.face.course import Course
from endoct.modalities.oct.face.face_circle import Capillary
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.surface.background import Background
from endoct.modalities.oct.surface.fixed_lines import FixedLines
from endoct.modalities.oct.surface.trust import RawLevels
from endoct.modalities.oct.turning.rotation import Rotation
from endoct.modalities.reading.numbering import notes_on_gaps
from endoct.stitching.grid import SurfaceGrid

FIRST_SAMPLE_TOLERANCE_MM = 0.2  # the glass alone delays the face by (n − 1)·t, 0.05–0.14 mm


@dataclass(frozen=True, eq=False)
class OctCalibration:
    """The calibration of the contract, with the place of the capillary's outer face in every slice.

    Attributes
    ----------
    grid, row_z_mm, per_frame, notes, handedness_known, travel_known: as the contract says.
    acquisition, parameters: the sidecar and the settings of the survey.
    n_ascans, n_depth: the size of a B-scan.
    slice_z_mm: float64 (n_slices,), in recording order.
    rotation: how the catheter turned, in recording order.
    faces: the outer face in recording order, in the frame of each slice, in which ``rotation`` gives the directions of
        beams (A-scan 0 near angle 0). Its ripple delays the wall as well. So it is subtracted from depths and does not
        change angles.
    sines: the paper's fit of the face in every slice, in recording order, at nominal angles.
    glass: the capillary's wall; its thickness is 0 where its inner face is not seen.
    course: what the outer face's course says of its diameter; None where the catheter is too near the axis.
    background: levels of the recording.
    raw_levels: darkness and bone as recorded, for the second look at what was found.
    """

    grid: SurfaceGrid
    row_z_mm: Coordinates
    per_frame: Mapping[str, Coordinates | Mask]
    notes: tuple[str, ...]
    acquisition: OctAcquisition
    parameters: OctParameters
    n_ascans: int
    n_depth: int
    slice_z_mm: Coordinates
    rotation: Rotation
    faces: Faces
    sines: tuple[Sine, ...]
    glass: Glass
    course: Course | None
    background: Background
    raw_levels: RawLevels

    @property
    def handedness_known(self) -> bool:
        """Whether the sidecar says how A-scans run against θ."""
        return self.acquisition.handedness != "unknown"

    @property
    def travel_known(self) -> bool:
        """Whether the sidecar says which way the catheter moved."""
        return self.acquisition.travel != "unknown"

    @property
    def mm_per_px(self) -> float:
        """Distance of two depth samples in the medium, mm."""
        return self.acquisition.mm_per_px

    @property
    def capillary(self) -> Capillary:
        """The circle of the outer face in every slice, in recording order."""
        return self.faces.capillary

    @property
    def bridged(self) -> Mask:
        """Whether a slice's geometry is interpolated from its neighbours, bool (n_slices,), in recording order."""
        return self.faces.bridged


def per_slice_values(
    z_mm: Coordinates,
    faces: Faces,
    sines: Sequence[Sine],
    rotation: Rotation,
    glass: Glass,
    acquisition: OctAcquisition,
) -> dict[str, Coordinates | Mask]:
    """Return the geometry of every slice, its quality and its rotation by name, each (n_slices, …)."""
    capillary = faces.capillary
    turned_rad = acquisition.sense * (capillary.direction_rad + rotation.start_rad)
    return {
        "z_mm": z_mm,
        "sine_amplitude_mm": np.array([sine.amplitude_mm for sine in sines]),
        "sine_omega": np.array([sine.omega for sine in sines]),
        "sine_phase_rad": np.array([sine.phase_rad for sine in sines]),
        "sine_offset_mm": np.array([sine.offset_mm for sine in sines]),
        "offset_mm": capillary.offset_mm,
        "offset_direction_rad": np.mod(acquisition.theta_origin_rad + turned_rad, 2 * np.pi),
        "glass_mm": np.full_like(z_mm, glass.thickness_mm),
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


def notes_on_survey(faces: Faces, lines: FixedLines, acquisition: OctAcquisition) -> tuple[str, ...]:
    """Return one sentence for each thing to know about the recording."""
    return (
        *_on_bridging(faces),
        *_on_first_sample(faces, acquisition),
        *notes_on_lines(lines),
        *notes_on_gaps(acquisition.positions_mm),
    )


def _on_bridging(faces: Faces) -> Iterator[str]:
    if count := int(np.count_nonzero(faces.bridged)):
        yield (
            f"{count} of {faces.bridged.size} slices did not show the capillary's outer face well enough; "
            "their geometry is bridged from their neighbours and their samples are not valid."
        )


def _on_first_sample(faces: Faces, acquisition: OctAcquisition) -> Iterator[str]:
    if acquisition.first_sample_mm is None:
        return
    expected = -acquisition.first_sample_mm / acquisition.medium_index
    difference = float(np.median(faces.capillary.axis_depth_mm)) - expected
    if not -0.05 <= difference <= FIRST_SAMPLE_TOLERANCE_MM:
        yield (
            f"The stated first_sample_mm puts the axis at a depth of {expected:.3f} mm, the capillary's outer "
            f"face at {expected + difference:.3f} mm; the capillary was trusted."
        )


def notes_on_lines(lines: FixedLines) -> Iterator[str]:
    """Yield which depth rows of a recording hold fixed lines, and which may."""
    claimed, undecided = np.flatnonzero(lines.excess > 0), np.flatnonzero(lines.undecided)
    if claimed.size:
        yield (
            f"Depth rows {row_ranges(claimed)} hold fixed lines of the detector, which were taken out; a wall just "
            "there is less certain."
        )
    if undecided.size:
        yield (
            f"Depth rows {row_ranges(undecided)} may hold fixed lines of the detector; they are seen in too few "
            "directions to tell, and were kept."
        )


def row_ranges(rows: NDArray[np.intp]) -> str:
    """Return depth rows, ascending, in words: "3, 7–9"."""
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return ", ".join(f"{run[0]}–{run[-1]}" if run.size > 1 else f"{run[0]}" for run in runs)
