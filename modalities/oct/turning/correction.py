"""All that the survey corrects about the rotation: uneven turns first, then the angles at which turns start."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from endoct.modalities.oct.face.faces import Faces, refit_faces
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.face.neighbours import starts_anywhere
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters
from endoct.modalities.oct.turning.rotation import Rotation, even_rotation
from endoct.modalities.oct.turning.start_angle import measure_starts
from endoct.modalities.oct.turning.uneven_turn import measure_turns, with_beam_angles
from endoct.stitching.arrays import Mask
from endoct.stitching.kept import Computed

NOT_CORRECTED = "Turns start anywhere; this was not corrected, so that slices lie at unrelated angles."


@dataclass(frozen=True, eq=False)
class Turns:
    """The slices and their faces at the angles that ``rotation`` gives, with notes on it. All in the order of z."""

    slices: Sequence[SliceFeatures]
    faces: Faces
    rotation: Rotation
    notes: tuple[str, ...] = ()


def nominal_turns(slices: Sequence[SliceFeatures], faces: Faces) -> Turns:
    """Return turns as A-scans are counted: even, complete and starting at one angle."""
    return Turns(slices, faces, even_rotation(len(slices)))


def correct_uneven_turns(
    turns: Turns, glass: Glass, fixed_rows: Mask, acquisition: OctAcquisition, parameters: OctParameters
) -> Turns:
    """Return nominal ``turns`` with what ``parameters`` ask to correct within turns; faces are fitted again.

    Points in ``fixed_rows``, bool (n_depth,), do not count: where the face crosses a fixed line of the detector, the
    line's points look like those of a face seen in a very uneven turn.
    """
    if not (parameters.correct_rotation or parameters.correct_turn_length or parameters.correct_lost_ascans):
        return turns
    nominal = turns.slices

    def without_fixed_rows(i: int) -> SliceFeatures:
        features = nominal[i]
        return replace(features, points=features.points.outside_rows(fixed_rows, acquisition.mm_per_px))

    rotation, faces = measure_turns(Computed(len(nominal), without_fixed_rows), turns.faces, glass, parameters)
    slices = Computed(len(nominal), lambda i: with_beam_angles(nominal[i], rotation, i))
    notes = turns.notes
    if count := int(np.count_nonzero(np.isfinite(rotation.lost_at_rad))):
        notes += (f"{count} of {len(slices)} slices lack a block of A-scans; what lay there is not valid.",)
    return Turns(slices, refit_faces(slices, faces, parameters), rotation, notes)


def correct_starts(turns: Turns, glass: Glass, acquisition: OctAcquisition, parameters: OctParameters) -> Turns:
    """Return ``turns`` with the angles at which they start, where ``parameters`` ask for that."""
    if parameters.correct_start_angle:
        rotation, note = measure_starts(turns.slices, turns.faces, glass, turns.rotation, acquisition, parameters)
        return replace(turns, rotation=rotation, notes=(*turns.notes, note) if note else turns.notes)
    if starts_anywhere(turns.faces.observed, parameters.start):
        return replace(turns, notes=(*turns.notes, NOT_CORRECTED))
    return turns
