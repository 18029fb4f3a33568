"""Places of frames by the numbers in their names, as a plug-in that opens a folder of images has them."""

from collections.abc import Sequence
from pathlib import Path

from endoct.modalities.frame_files import choose_frames
from endoct.modalities.numbering import Positions, positions_along


def positions_by_number(files: Sequence[Path], pitch_mm: float) -> Positions:
    """Return the place of every file along the travel, mm from the first; None where they lie evenly."""
    chosen = choose_frames(Path(), files, lambda one, other: False)
    return positions_along(chosen.along, pitch_mm)[0]
