"""What the survey of a pullback notes for the user: bridged slices, a doubtful zero of depth, fixed lines, gaps."""

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.fixed_lines import FixedLines
from endoct.modalities.reading.numbering import notes_on_gaps

FIRST_SAMPLE_TOLERANCE_MM = 0.2  # the glass alone delays the face by (n − 1)·t, 0.05–0.14 mm


def notes_on_survey(faces: Faces, lines: FixedLines, acquisition: OctAcquisition) -> tuple[str, ...]:
    """Return one sentence for each thing to know about the recording."""
    return (
        *_on_bridging(faces),
        *_on_first_sample(faces, acquisition),
        *notes_on_lines(lines),
        *notes_on_gaps(acquisition.positions_mm),
    )


def _on_bridging(faces: Faces) -> tuple[str, ...]:
    count = int(np.count_nonzero(faces.bridged))
    if not count:
        return ()
    return (
        f"{count} of {faces.bridged.size} slices did not show the capillary's outer face well enough; "
        "their geometry is bridged from their neighbours and their samples are not valid.",
    )


def _on_first_sample(faces: Faces, acquisition: OctAcquisition) -> tuple[str, ...]:
    if acquisition.first_sample_mm is None:
        return ()
    expected = -acquisition.first_sample_mm / acquisition.medium_index
    difference = float(np.median(faces.capillary.axis_depth_mm)) - expected
    if -0.05 <= difference <= FIRST_SAMPLE_TOLERANCE_MM:
        return ()
    return (
        f"The stated first_sample_mm puts the axis at a depth of {expected:.3f} mm, the capillary's outer "
        f"face at {expected + difference:.3f} mm; the capillary was trusted.",
    )


def notes_on_lines(lines: FixedLines) -> tuple[str, ...]:
    """Return which depth rows of a recording hold fixed lines, and which may."""
    claimed, undecided = np.flatnonzero(lines.excess > 0), np.flatnonzero(lines.undecided)
    notes: tuple[str, ...] = ()
    if claimed.size:
        notes += (
            f"Depth rows {row_ranges(claimed)} hold fixed lines of the detector, which were taken out; a wall just "
            "there is less certain.",
        )
    if undecided.size:
        notes += (
            f"Depth rows {row_ranges(undecided)} may hold fixed lines of the detector; they are seen in too few "
            "directions to tell, and were kept.",
        )
    return notes


def row_ranges(rows: NDArray[np.intp]) -> str:
    """Return depth rows, ascending, in words: "3, 7–9"."""
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return ", ".join(f"{run[0]}–{run[-1]}" if run.size > 1 else f"{run[0]}" for run in runs)
