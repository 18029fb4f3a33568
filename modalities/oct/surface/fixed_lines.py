"""Lines at one depth in every A-scan, which come from the detector and not from the specimen.

A catheter that lies steadily off the axis keeps glass and wall at steady depths too. So a depth that is bright in many
A-scans is no proof of a line. A line is claimed only where neither can stand, by the geometry of the slice. And all
parts of the turn and of the pullback must show it. Where the capillary is nearer in some directions, the line may be
there before the capillary in all others. The sheath, which keeps its depth all round, lies within the capillary. The
glass's inner face, which keeps its depth for a third of the turn, counts for no line where geometry predicts it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, percentile_filter, uniform_filter1d

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.numeric import ranks
from endoct.base.numeric.ranks import robust_sigma
from endoct.modalities.oct.bscan import rows_from
from endoct.modalities.oct.face.faces import Faces
from endoct.modalities.oct.face.glass import Glass
from endoct.modalities.oct.face.slices import SliceFeatures
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.surface.background import DARK_SHARE, LINE_SIGMAS, lines_with_skirts
from endoct.modalities.oct.surface.levels import FEWEST_ASCANS, SECTORS, Pool, filled_medians, pooled

LINE_BACKGROUND_MM = 0.35
LINE_BEYOND_MM = (0.07, 0.13)
"""Range behind a line in which darkness is judged: behind its echo, but before the signal of bone ends."""
AROUND_LINE_MM = (0.03, 0.07)
"""Range before and behind a line that it is compared with, within the gap, which may be narrow."""
FACE_MM = 0.06
"""Distance behind the outer face up to which the face is still in view."""
WALL_MM = (0.06, 0.25)
"""How far before and behind the expected place the wall may lie."""
WALL_SHIFT = 0.3
"""The wall is looked for no farther off than this part of the gap between glass and wall."""
FEWEST_SECTORS = 3
"""Hardly any cell, and no stretch of glass or wall at one depth, spans this many sectors, a quarter of the turn."""
MOST_MISSED = 0.2
"""All but this part of the sectors and parts must show a line."""
HALF = 0.5
"""Least share of its typical contrast that shows a line, and least share of its rows that can judge it."""
NEAREST_SHARE, CROSSING_MM = 0.02, 0.03
"""Share of the A-scans in which the face is nearest, and how much deeper a line must lie to be behind it there."""
INNER_FACE_MM = 0.04
"""How far the inner face of the glass reaches before and behind its expected place: half the width of its line."""


@dataclass(frozen=True, eq=False)
class FixedLines:
    """The fixed lines of a recording.

    Attributes: ``excess``, float32 (n_depth,), how far each depth stands out, 0 where there is no line; ``undecided``,
    bool (n_depth,): depths that stand out in the dark, but are seen in too few directions for a claim.
    """

    excess: Image
    undecided: Mask

    @classmethod
    def none(cls, n_depth: int) -> "FixedLines":
        """Return no lines."""
        return cls(np.zeros(n_depth, np.float32), np.zeros(n_depth, np.bool_))


def find_fixed_lines(
    slices: Sequence[SliceFeatures], faces: Faces, glass: Glass, acquisition: OctAcquisition
) -> FixedLines:
    """Return the detector's fixed lines, with their skirts, by A-scans of all ``slices``, which show ``faces``.

    A depth is judged behind the outer face, away from where the wall is expected, in A-scans that are dark a little
    deeper. Bone interferes with a line, and so can make it fainter as well as brighter.
    """
    pool = pooled(slices, faces, acquisition)
    mm_per_px = acquisition.mm_per_px
    n, n_depth = pool.ascans.shape
    if not n:
        return FixedLines.none(n_depth)
    depth_mm = np.arange(n_depth, dtype=np.float32) * np.float32(mm_per_px)
    behind_face = depth_mm - pool.face_mm.astype(np.float32)[:, None]
    behind_wall = depth_mm - (pool.wall_mm + _wall_shift_mm(pool, mm_per_px)).astype(np.float32)[:, None]
    before, at_wall = behind_wall < -WALL_MM[0], (behind_wall > 0) & (behind_wall < WALL_MM[1])
    open_cell = _is_dark(pool.ascans, at_wall, (behind_face > FACE_MM) & before)
    can_stand = (behind_face > FACE_MM) & (before | (behind_wall > WALL_MM[1]) | open_cell[:, None])
    judged = can_stand & _dark_beyond(pool.ascans, can_stand, mm_per_px)
    excess = _excess(np.where(judged, pool.ascans, np.nan), mm_per_px)
    sigma = max(robust_sigma(pool.ascans - ranks.medians(pool.ascans)), 1e-6)
    lines = lines_with_skirts(excess, sigma, mm_per_px)
    undecided = np.zeros(n_depth, np.bool_)
    runs, count = label(lines > 0)
    for k in range(1, count + 1):
        rows = runs == k
        core = np.flatnonzero(rows & (excess > LINE_SIGMAS * sigma))
        contrast = _contrast(pool.ascans, can_stand, slice(int(core[0]), int(core[-1]) + 1), mm_per_px)
        contrast[judged[:, core].mean(axis=1) < HALF] = np.nan
        everywhere = _is_everywhere(contrast, pool.part, LINE_SIGMAS * sigma)
        if not everywhere:
            lines[rows] = 0
        undecided[rows] = everywhere is None
    no_glass = np.abs(behind_face + glass.path_mm) > INNER_FACE_MM
    lines = np.maximum(lines, _crossing_lines(pool, behind_face, (no_glass, can_stand), sigma, mm_per_px))
    return FixedLines(lines, undecided & (lines == 0))


def _wall_shift_mm(pool: Pool, mm_per_px: float) -> float:
    """By how much deeper than the nominal bore the wall typically stands: where, from it, A-scans are brightest."""
    gap_mm = float(np.min(pool.wall_mm - pool.face_mm))
    most = max(0, round(WALL_SHIFT * gap_mm / mm_per_px))
    near = rows_from(pool.ascans, np.round(pool.wall_mm / mm_per_px).astype(np.intp) - most, 2 * most + 1)
    level = uniform_filter1d(filled_medians(near), max(1, round(0.05 / mm_per_px)), mode="nearest")
    return float(int(np.argmax(level)) - most) * mm_per_px


def _is_dark(ascans: Image, at_wall: Mask, in_gap: Mask) -> Mask:
    """Say which A-scans are nearer to darkness than to bone ``at_wall``: they meet the opening of a cell, (n,)."""
    level = np.where(at_wall, ascans, 0).sum(axis=1) / np.maximum(at_wall.sum(axis=1), 1)
    darkness = float(np.median(ascans[in_gap])) if in_gap.any() else float(level.min())
    bone = float(np.quantile(level, 1 - DARK_SHARE))
    return np.asarray(level < darkness + HALF * (bone - darkness))


def _dark_beyond(ascans: Image, can_stand: Mask, mm_per_px: float) -> Mask:
    """Say which samples lie in A-scans that, a little deeper, belong to the darkest of those ``can_stand`` leaves."""
    near, far = (max(1, round(reach / mm_per_px)) for reach in LINE_BEYOND_MM)
    deeper = np.pad(uniform_filter1d(ascans, far - near, axis=1), ((0, 0), (0, far)), mode="edge")[:, far:]
    last = np.maximum(np.ceil(DARK_SHARE * np.count_nonzero(can_stand, axis=0)).astype(np.intp) - 1, 0)
    return np.asarray(deeper <= ranks.ranked(deeper, can_stand, last))


def _contrast(ascans: Image, can_stand: Mask, line: slice, mm_per_px: float) -> Coordinates:
    """By how much every A-scan is brighter at the rows ``line`` than before them, and than behind them, (n,).

    It is less bright behind where bone fades, so that the dark before it counts; NaN where glass or wall may stand
    there. Behind the line, the wall may follow.
    """
    near, far = (round(reach / mm_per_px) for reach in AROUND_LINE_MM)
    before = slice(max(line.start - far, 0), max(line.start - near, 1))
    behind = slice(line.stop + near, max(line.stop + far, line.stop + near + 1))
    level = ascans[:, line].mean(axis=1)
    contrast = np.where(can_stand[:, before].all(axis=1), level - ascans[:, before].mean(axis=1), np.nan)
    if behind.stop <= ascans.shape[1]:
        clear = can_stand[:, behind].all(axis=1)
        contrast = np.minimum(contrast, np.where(clear, level - ascans[:, behind].mean(axis=1), np.inf))
    return np.asarray(contrast, dtype=np.float64)


def _crossing_lines(pool: Pool, behind_face: Image, clear: tuple[Mask, Mask], sigma: float, mm_per_px: float) -> Image:
    """Return the excess of lines that are there all round before the face, but too deep to be before it everywhere.

    ``clear``: where, before the face, the glass's inner face cannot be, and where, behind it, neither face nor wall can
    be. A line is there as well. Where the inner face is farthest, it keeps its depth for a third of the turn.
    """
    before = behind_face < -FACE_MM
    excess = _excess(np.where(before & clear[0], pool.ascans, np.nan), mm_per_px)
    lines = lines_with_skirts(excess, sigma, mm_per_px)
    crossing = float(np.quantile(pool.face_mm, NEAREST_SHARE)) + CROSSING_MM
    runs, count = label(lines > 0)
    for k in range(1, count + 1):
        rows = runs == k
        core = np.flatnonzero(rows & (excess > LINE_SIGMAS * sigma))
        line = slice(int(core[0]), int(core[-1]) + 1)
        contrast = np.full(len(pool.ascans), np.nan)
        for judged in (clear[1], before & clear[0]):
            whole = judged[:, line].all(axis=1)
            contrast[whole] = _contrast(pool.ascans, judged, line, mm_per_px)[whole]
        if core[-1] * mm_per_px < crossing or not _is_everywhere(contrast, pool.part, LINE_SIGMAS * sigma):
            lines[rows] = 0
    return lines


def _excess(samples: Image, mm_per_px: float) -> Image:
    """Return how far the median of every depth of ``samples``, NaN where not judged, stands out of those around.

    It is 0 where too few are judged: what is known of the depths next to it says nothing of a line there.
    """
    level = filled_medians(samples)
    around = percentile_filter(level, 25, round(LINE_BACKGROUND_MM / mm_per_px) | 1, mode="nearest")
    judged = np.count_nonzero(np.isfinite(samples), axis=0) >= FEWEST_ASCANS
    return np.where(judged, level - around, 0).astype(np.float32)


def _is_everywhere(contrast: Coordinates, part: NDArray[np.intp], sigma: float) -> bool | None:
    """Say whether A-scans of all parts have a ``contrast`` (n,), NaN where not judged; None where too few are."""
    known = np.isfinite(contrast)
    enough = [k for k in np.unique(part[known]) if np.count_nonzero(part[known] == k) >= FEWEST_ASCANS]
    typical = float(np.median(contrast[known])) if known.any() else 0.0
    if len({k % SECTORS for k in enough}) < FEWEST_SECTORS:
        return None if typical > HALF * sigma else False
    there = [np.median(contrast[known & (part == k)]) > HALF * typical for k in enough]
    return bool(typical > HALF * sigma and np.mean(there) >= 1 - MOST_MISSED)
