"""Depth of an endoscope's panorama by parallax, with its standard error.

The wall is swept piece by piece, each with the frames that show it. Pieces overlap, so that none has an end inside the
bore.

A depth is more certain where frames agree worse at all other depths, and where the depths around it are smooth. It also
depends on how well the optics are known: every depth is in proportion to their slants.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.memory import Kept, Room
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.circle import pad_circle
from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.parallax.matching import best_depths, spread
from endoct.modalities.endoscope.parallax.sweeping import COST, UNSEEN, Costs, sweep
from endoct.modalities.endoscope.parallax.views import (
    FineGrid,
    Texture,
    fine_grid,
    fine_strip,
    on_fine_rows,
    stacked,
    texture,
)
from endoct.stitching.panorama import Panorama

DEPTHS_MM = np.cumsum(np.concatenate([[-0.1], np.full(20, 0.025), 0.025 * 1.083 ** np.arange(1, 27)]))
WALL = 4
"""These depths are tried, mm, with the wall's own, 0, at ``WALL``. They are even where floors are shallow, then ever
farther apart."""
SCALES_MM = (0.007, 0.01, 0.014, 0.02, 0.03, 0.045)
"""Textures of these scales are tried, the finest first: noise and blur leave only coarser ones in common."""
ALIKE = 0.25
"""Frames see the same wall where textures cost less at depth 0, in the median: 0.14 to 0.2 in sharp recordings."""
WINDOW_MM = (0.1, 0.04)
"""Costs are means over this length along z and around."""
STEP, JUMP = 0.2, 1.0
"""Penalties of matching: for a neighbour one depth away, and for one any farther."""
DOUBT = 0.05
"""Depths that cost this much more are 1/e as probable."""
ROUGHNESS = 1.0
SCALE_STATED, SCALE_ASSUMED = 0.03, 0.4
"""All depths together have this relative standard error where the mirror's optics are stated, or are assumed: they are
as R + d, with the bore's radius R and the pupil's distance d from the cone, which no feed tells."""
LEAST_ERROR_MM, MOST_ERROR_MM = 0.015, 0.25
"""No error is stated as less; where frames tell it less surely than that, depth is not known."""
PIECE_MM, OVERLAP_MM = 1.5, 0.2
LOOK_MM = 0.5
"""The scale of texture is chosen by this length of the bore."""
_ROOM = Room()


def add_parallax(panorama: Panorama, stream: FrameStream, calibration: EndoscopeCalibration) -> Panorama:
    """Return ``panorama`` with the depth of its samples by parallax: NaN where frames show no common texture.

    It is as it was where there is one frame alone.
    ``stream``: the frames that it was made of.
    """
    if len(stream) < 2:
        return panorama
    fine = fine_grid(calibration)
    scale_mm = _finest_alike(stream, calibration, fine)
    if scale_mm is None:
        nowhere = np.full(panorama.grid.shape, np.nan, np.float32)
        return replace(panorama, parallax_depth_mm=nowhere, parallax_error_mm=nowhere)
    on_samples = on_fine_rows(calibration, fine)

    def texture_of(frame: Frame) -> Texture:
        return texture(fine_strip(frame, on_samples), scale_mm, fine.samples)

    with Kept[Texture]() as textures:
        for each in thread_map(texture_of, stream):
            textures.append(each)
        of_piece = partial(_swept, textures=textures, calibration=calibration, fine=fine)
        found = list(thread_map(of_piece, _pieces(fine)))
    depth_mm, error_mm = (np.concatenate(each) for each in zip(*found, strict=True))
    relative = SCALE_ASSUMED if calibration.optics.assumed else SCALE_STATED
    rows, columns = fine.block_of(panorama.grid)
    of_samples = np.ix_(rows, columns)
    known = panorama.valid & (error_mm <= MOST_ERROR_MM)[of_samples]
    error_mm = np.hypot(error_mm, relative * depth_mm)
    return replace(
        panorama,
        parallax_depth_mm=np.where(known, depth_mm[of_samples], np.nan),
        parallax_error_mm=np.where(known, np.maximum(error_mm, LEAST_ERROR_MM)[of_samples], np.nan),
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


def _finest_alike(stream: FrameStream, calibration: EndoscopeCalibration, fine: FineGrid) -> float | None:
    """Return the finest scale of texture that the frames in the middle have in common, mm, or None."""
    middle, half = fine.n_blocks[0] // 2, round(LOOK_MM / 2 / fine.block_size_mm[0])
    rows, wall = range(max(0, middle - half), min(fine.n_blocks[0], middle + half)), np.zeros(1)
    frames = _frames_of(rows, calibration, fine, wall)
    on_samples = on_fine_rows(calibration, fine)
    strips = list(thread_map(lambda k: fine_strip(stream[k], on_samples), frames))
    for scale_mm in SCALES_MM:
        textures = [texture(strip, scale_mm, fine.samples) for strip in strips]
        costs = _costs(rows, frames, textures, calibration, fine, wall)
        seen = costs[costs != UNSEEN]
        if seen.size and np.median(seen) < ALIKE * COST:
            return scale_mm
    return None


def _rays(calibration: EndoscopeCalibration) -> tuple[Coordinates, Coordinates]:
    """Return where a frame's rays pass the wall, z from its middle, mm, ascending, and their slants."""
    optics = calibration.optics
    return calibration.strip_z_mm, optics.slant(optics.r_px(calibration.strip_z_mm))


def _frames_of(rows: range, calibration: EndoscopeCalibration, fine: FineGrid, depths_mm: Coordinates) -> list[int]:
    """Return the frames that may show these rows of blocks if they lie at one of ``depths_mm``."""
    z_mm = fine.z_mm(rows)
    along_mm, slant = _rays(calibration)
    ends_mm = along_mm + slant * depths_mm[:, None]
    frames = (calibration.z_mm >= z_mm[0, 0] - ends_mm.max()) & (calibration.z_mm <= z_mm[-1, -1] - ends_mm.min())
    return [int(k) for k in np.flatnonzero(frames)]


def _costs(
    rows: range,
    frames: Sequence[int],
    textures: Sequence[Texture],
    calibration: EndoscopeCalibration,
    fine: FineGrid,
    depths_mm: Coordinates,
) -> Costs:
    """Return what each of ``depths_mm`` costs by ``textures`` of ``frames``, as :func:`sweep` does."""
    first, stack = stacked(textures, fine.samples.n_theta, _ROOM)
    return sweep(
        stack,
        np.asarray(fine.samples.z0_mm + fine.samples.dz_mm * first, dtype=np.float64),
        fine.samples.dz_mm,
        calibration.z_mm[frames],
        _rays(calibration),
        fine.z_mm(rows),
        depths_mm,
    )


def _swept(
    piece: _Piece, textures: Kept[Texture], calibration: EndoscopeCalibration, fine: FineGrid
) -> tuple[Image, Image]:
    """Return depth and standard error of the blocks of a piece, mm, float32 (rows, blocks around); NaN where unseen."""
    frames = _frames_of(piece.swept, calibration, fine, DEPTHS_MM)
    costs = _costs(piece.swept, frames, [textures[k] for k in frames], calibration, fine, DEPTHS_MM)
    unseen = costs[:, :, WALL] == UNSEEN  # at the ends, what is deep may be seen by two frames, and the wall by one
    np.minimum(costs, COST, out=costs)
    smooth = _mean_around(costs, fine)
    depth_mm = best_depths(smooth, round(STEP * COST), round(JUMP * COST), DEPTHS_MM)
    error_mm = np.hypot(spread(smooth, depth_mm, DEPTHS_MM, DOUBT * COST), ROUGHNESS * _roughness(depth_mm))
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


def _roughness(depth_mm: Image) -> Image:
    """Return how far depths differ from those of their neighbours, root of the mean square, mm."""
    padded = np.pad(pad_circle(depth_mm, 1), ((1, 1), (0, 0)), mode="edge")
    mean, square = (cv2.blur(each, (3, 3))[1:-1, 1:-1] for each in (padded, padded**2))
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0)), dtype=np.float32)
