"""Frames that are missing, by the numbers in the names of a recording's images."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

LEAST_REGULAR = 0.8
"""Share of equal steps below which numbers in names are taken for something else than a count."""
GAP_STEPS = 1.5
LONGEST_NUMBER = 15
"""Digits; longer ones, as of a time in ns, do not count frames."""


def positions_by_number(files: Sequence[Path], pitch_mm: float) -> tuple[float, ...] | None:
    """Return the place of every file along the travel, mm from the first, where their numbering has gaps.

    None where the last numbers in the names count without a gap, or do not count at all.
    """
    found = [re.findall(r"[0-9]+", file.stem) for file in files]  # \d would take digits of other scripts
    if len(files) < 3 or not all(found) or max(len(digits[-1]) for digits in found) > LONGEST_NUMBER:
        return None
    numbers = np.array([int(digits[-1]) for digits in found])
    steps = np.diff(numbers)
    values, counts = np.unique(steps, return_counts=True)
    usual = int(values[np.argmax(counts)])
    if usual < 1 or counts.max() < LEAST_REGULAR * steps.size or (steps < 1).any() or (steps % usual).any():
        return None
    if (steps == usual).all():
        return None
    return tuple(float(place) for place in (numbers - numbers[0]) / usual * pitch_mm)


def notes_on_gaps(positions_mm: Sequence[float] | None) -> tuple[str, ...]:
    """Return a sentence on frames that are missing between ``positions_mm``, none where there is no gap."""
    if positions_mm is None or len(positions_mm) < 3:
        return ()
    steps = np.abs(np.diff(positions_mm))
    gaps = np.flatnonzero(steps > GAP_STEPS * np.median(steps))
    if not gaps.size:
        return ()
    widest = int(gaps[np.argmax(steps[gaps])])
    return (
        f"Frames are missing in {gaps.size} place{'s' if gaps.size > 1 else ''}, at the widest {steps[widest]:.2f} mm "
        f"between frames {widest} and {widest + 1}; what lies beyond was placed by the nominal pitch.",
    )
