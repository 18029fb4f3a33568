"""What the detector's fixed lines mean for the wall: notes of where they lie, and the doubt that they hide too much."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from endoct.base.doubt import Doubt
from endoct.modalities.oct.calibration import OctCalibration
from endoct.modalities.oct.surface.fixed_lines import FixedLines

WIDE_MM = 0.06
"""Where nothing is seen over so much of depth, the wall may be found at the wrong end. Lines of seven simulated
recordings, of 0.03 mm at most, were made wider on purpose. At 0.06 mm the Jaccard index of the cells fell by up to
0.11, at 0.075 mm by up to 0.39. The widest among 20 simulated recordings is 0.056 mm."""
MOST_UNDER_LINES = 0.05
"""At most this part of the bore's nominal wall may lie there. In these recordings it was 0.1 to 0.5."""
N_BEAMS = 360


def doubts_of_lines(calibration: OctCalibration) -> tuple[Doubt, ...]:
    """Return the doubt that much of the bore's nominal wall lies under lines that hide it over a wide band of depth."""
    mm = calibration.mm_per_px
    run, _ = label(calibration.background.hidden)
    deep_mm = np.bincount(run, minlength=1) * mm
    deep_mm[0] = 0  # what no line hides
    blind = np.append((deep_mm >= WIDE_MM)[run], False)  # no line is deeper than a B-scan
    if not blind.any():
        return ()
    beam = 2 * np.pi * np.arange(N_BEAMS) / N_BEAMS
    bore = (
        replace(calibration.capillary.circle(i), radius_mm=calibration.grid.radius_mm)
        for i in map(int, np.flatnonzero(~calibration.bridged))
    )
    row = np.rint(np.array([circle.depth_mm(beam) / mm for circle in bore])).astype(np.intp)
    share = float(np.mean(blind[row.clip(0, calibration.n_depth)])) if row.size else 0.0
    if share <= MOST_UNDER_LINES:
        return ()
    what = (
        f"{share:.0%} of the bore's nominal wall lies under fixed lines of the detector (depth rows "
        f"{_ranges(np.flatnonzero(blind))}), which hide it: it may be found up to {deep_mm.max():.2f} mm off, "
        "and cells there may be none."
    )
    return (Doubt("wall-under-lines", what, value=share, unit="1", expected=(0.0, MOST_UNDER_LINES)),)


def notes_on_lines(lines: FixedLines) -> tuple[str, ...]:
    """Return which depth rows of a recording hold fixed lines, and which may."""
    claimed, undecided = np.flatnonzero(lines.excess > 0), np.flatnonzero(lines.undecided)
    notes: tuple[str, ...] = ()
    if claimed.size:
        notes += (
            f"Depth rows {_ranges(claimed)} hold fixed lines of the detector, which were taken out; a wall just there "
            "is less certain.",
        )
    if undecided.size:
        notes += (
            f"Depth rows {_ranges(undecided)} may hold fixed lines of the detector; they are seen in too few "
            "directions to tell, and were kept.",
        )
    return notes


def _ranges(rows: NDArray[np.intp]) -> str:
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return ", ".join(f"{run[0]}–{run[-1]}" if run.size > 1 else f"{run[0]}" for run in runs)
