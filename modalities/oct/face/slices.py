"""What the survey keeps of one slice: points on lines, the lines, and some A-scans."""

from dataclasses import dataclass

import numpy as np

from endoct.modalities.oct.face.lines import Points
from endoct.modalities.oct.face.sine import circle_distance_mm
from endoct.stitching.arrays import Coordinates, Image


@dataclass(frozen=True, eq=False)
class SliceEvidence:
    """What the survey keeps of one slice.

    Attributes: ``points`` on lines; ``lines``, see :func:`endoct.modalities.oct.face.lines.find_lines`; ``ascans``,
    some A-scans (n, depth) in the recording's logarithmic samples, at the rotation angles ``ascan_angle_rad``;
    ``n_columns``, over how many sectors of the turn the points were sought; ``saturated``, whether most is.
    """

    points: Points
    n_columns: int
    lines: Coordinates
    ascans: Image
    ascan_angle_rad: Coordinates
    saturated: bool = False


def behind(evidence: SliceEvidence, circle: Coordinates, radius_mm: float, mm_per_px: float, n_px: int) -> Image:
    """Return the samples from the line ``circle`` (x, y, axis depth; mm) on, float32 (n_ascans, n_px), NaN outside."""
    face = circle[2] + circle_distance_mm(evidence.ascan_angle_rad, circle[0], circle[1], radius_mm)
    rows = np.round(face / mm_per_px).astype(int)[:, None] + np.arange(n_px)
    inside = (rows >= 0) & (rows < evidence.ascans.shape[1])
    taken = np.take_along_axis(evidence.ascans, np.clip(rows, 0, evidence.ascans.shape[1] - 1), axis=1)
    return np.where(inside, taken, np.nan).astype(np.float32)
