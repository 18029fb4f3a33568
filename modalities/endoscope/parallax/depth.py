"""Depth of an endoscope's panorama by parallax, with its standard error.

The wall is swept piece by piece, each with the frames that show it; pieces overlap, so that none has an end inside the
bore. How sure a depth is follows from how much worse the frames agree at others, from how rough depths are around it,
and from how well the optics are known, to whose slants every depth is in proportion.
"""

from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.memory import Kept
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.circle import pad_circle
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.parallax.sweep import COST, UNSEEN, Costs, best_depths, sweep
from endoct.modalities.endoscope.parallax.views import FineGrid, FineStrip, fine_grid, fine_strips, textures
from endoct.stitching.panorama import Panorama

DEPTHS_MM = np.cumsum(np.concatenate([[-0.1], np.full(20, 0.025), 0.025 * 1.083 ** np.arange(1, 27)]))
WALL = 4
"""Depths that are tried, mm, the wall's own, 0, at ``WALL``: even where floors are shallow, then ever farther apart."""
SCALES_MM = (0.007, 0.01, 0.014, 0.02, 0.03, 0.045)
"""Textures that are tried, the finest first: noise and blur leave only coarser ones in common."""
ALIKE = 0.3
"""Frames see the same wall where textures cost less at depth 0, in the median: 0.16 to 0.25 in sharp recordings."""
WINDOW_MM = (0.1, 0.04)
"""Costs are means over this length along z and around."""
STEP, JUMP = 0.2, 1.0
"""What it costs to lie one depth or any number of depths behind a neighbour."""
DOUBT = 0.05
"""Depths that cost this much more are 1/e as probable."""
ROUGHNESS = 1.0
SCALE_STATED, SCALE_ASSUMED = 0.03, 0.15
"""Standard error of all depths together, relative, where the mirror's optics are stated and where they are assumed."""
LEAST_ERROR_MM, MOST_ERROR_MM = 0.015, 0.25
"""No error is stated as less; what is less sure than that is not known."""
PIECE_MM, OVERLAP_MM = 2.0, 0.4


def add_parallax(panorama: Panorama, stream: FrameStream, calibration: EndoscopeCalibration) -> Panorama:
    """Return ``panorama`` with the depth of its samples by parallax; as it is where frames show no common texture.

    ``stream``: the frames that it was made of.
    """
    if len(stream) < 2:
        return panorama
    fine = fine_grid(calibration)
    with Kept[FineStrip]() as strips:
        fine_strips(stream, calibration, fine, strips)
        scale_mm = _finest_alike(strips, calibration, fine)
        if scale_mm is None:
            return panorama
        pieces = _pieces(fine)
        of_piece = partial(_swept, strips=strips, calibration=calibration, fine=fine, scale_mm=scale_mm)
        found = list(thread_map(of_piece, pieces))
    depth_mm, error_mm = (np.concatenate(each) for each in zip(*found, strict=True))
    relative = SCALE_ASSUMED if calibration.optics.assumed else SCALE_STATED
    error_mm = np.hypot(error_mm, relative * depth_mm)
    rows, columns = fine.block_of(panorama.grid)
    on_samples = np.ix_(rows, columns)
    known = panorama.valid & (error_mm <= MOST_ERROR_MM)[on_samples]
    return replace(
        panorama,
        parallax_depth_mm=np.where(known, depth_mm[on_samples], np.nan),
        parallax_error_mm=np.where(known, np.maximum(error_mm, LEAST_ERROR_MM)[on_samples], np.nan),
    )


@dataclass(frozen=True)
class _Piece:
    """Rows of blocks that are swept together, and those of them that are kept."""

    swept: range
    kept: range


def _pieces(fine: FineGrid) -> list[_Piece]:
    n = fine.n_blocks[0]
    length, overlap = (round(size_mm / fine.block_size_mm[0]) for size_mm in (PIECE_MM, OVERLAP_MM))
    return [
        _Piece(range(max(0, first - overlap), min(n, first + length + overlap)), range(first, min(n, first + length)))
        for first in range(0, n, length)
    ]


def _finest_alike(strips: Kept[FineStrip], calibration: EndoscopeCalibration, fine: FineGrid) -> float | None:
    """Return the finest scale of texture that the frames in the middle have in common, mm, or None."""
    middle = fine.n_blocks[0] // 2
    half = round(PIECE_MM / 2 / fine.block_size_mm[0])
    rows = range(max(0, middle - half), min(fine.n_blocks[0], middle + half))
    for scale_mm in SCALES_MM:
        costs = _costs(rows, strips, calibration, fine, scale_mm, np.zeros(1, np.float64))
        seen = costs[costs != UNSEEN]
        if seen.size and np.median(seen) < ALIKE * COST:
            return scale_mm
    return None


def _costs(
    rows: range,
    strips: Kept[FineStrip],
    calibration: EndoscopeCalibration,
    fine: FineGrid,
    scale_mm: float,
    depths_mm: Coordinates,
) -> Costs:
    """Return what each of ``depths_mm`` costs, uint8 (rows, blocks around, depths)."""
    z_mm = fine.z_mm(rows)
    reach_mm = float(calibration.strip_z_mm[-1]) + OVERLAP_MM
    shown = (calibration.z_mm > z_mm.min() - reach_mm) & (calibration.z_mm < z_mm.max() + reach_mm)
    chosen = np.flatnonzero(shown)
    first, stack = textures([strips[int(k)] for k in chosen], scale_mm, fine.samples)
    optics = calibration.optics
    slant = optics.slant(optics.r_px(calibration.strip_z_mm))
    return sweep(
        stack,
        np.asarray(fine.samples.z0_mm + fine.samples.dz_mm * first, dtype=np.float64),
        fine.samples.dz_mm,
        calibration.z_mm[chosen],
        (calibration.strip_z_mm, slant),
        z_mm,
        depths_mm,
    )


def _swept(
    piece: _Piece, strips: Kept[FineStrip], calibration: EndoscopeCalibration, fine: FineGrid, scale_mm: float
) -> tuple[Image, Image]:
    """Return depth and standard error of the blocks of a piece, mm, float32 (rows, blocks around); NaN where unseen."""
    costs = _costs(piece.swept, strips, calibration, fine, scale_mm, DEPTHS_MM)
    unseen = costs[:, :, WALL] == UNSEEN  # at the ends, what is deep may be seen by two frames, and the wall by one
    np.minimum(costs, COST, out=costs)
    smooth = _mean_around(costs, fine)
    depth_mm = best_depths(smooth, round(STEP * COST), round(JUMP * COST), DEPTHS_MM)
    error_mm = np.hypot(_spread(smooth, depth_mm), ROUGHNESS * _roughness(depth_mm))
    error_mm[unseen] = np.nan
    inside = slice(piece.kept.start - piece.swept.start, piece.kept.stop - piece.swept.start)
    return depth_mm[inside], error_mm[inside]


def _mean_around(costs: Costs, fine: FineGrid) -> Costs:
    """Return means of ``costs`` over ``WINDOW_MM``, cyclic in θ."""
    along, around = (2 * int(size / step / 2) + 1 for size, step in zip(WINDOW_MM, fine.block_size_mm, strict=True))
    reach = around // 2
    padded = pad_circle(costs, reach, axis=1)
    means = cv2.blur(padded, (around, along), borderType=cv2.BORDER_REPLICATE)
    return np.ascontiguousarray(means[:, reach : reach + costs.shape[1]])


def _spread(costs: Costs, depth_mm: Image) -> Image:
    """Return the standard deviation from ``depth_mm`` of depths as probable as their costs say, mm."""
    shares = np.gradient(DEPTHS_MM).astype(np.float32)
    table = np.exp(-np.arange(256, dtype=np.float32) / np.float32(DOUBT * COST))
    probable = table[costs - costs.min(axis=2, keepdims=True)] * shares
    total = probable.sum(axis=2)
    mean = probable @ DEPTHS_MM.astype(np.float32) / total
    square = probable @ (DEPTHS_MM**2).astype(np.float32) / total
    return np.asarray(np.sqrt(np.maximum(square - 2 * depth_mm * mean + depth_mm**2, 0)), dtype=np.float32)


def _roughness(depth_mm: Image) -> Image:
    """Return how far depths differ from those of their neighbours, root of the mean square, mm."""
    padded = np.pad(pad_circle(depth_mm, 1), ((1, 1), (0, 0)), mode="edge")
    mean, square = (cv2.blur(each, (3, 3))[1:-1, 1:-1] for each in (padded, padded**2))
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0)), dtype=np.float32)
