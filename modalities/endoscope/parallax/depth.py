"""Depth of an endoscope's panorama by parallax, with its standard error.

The wall is swept piece by piece, each with the frames that show it. Pieces overlap, so that none has an end inside the
bore. A ray goes on behind the wall under its slant m. What lies δ behind the wall at z is seen where its ray passes the
wall, at z − m·δ. Frames see it under different slants, so their textures coincide at its true depth alone.

Neighbours mostly lie equally deep, so depths are found together by semi-global matching (Hirschmüller 2008), along z
and around, where paths close upon themselves.

A depth is the surer, the worse the frames agree at others and the smoother depths are around it. How well the optics
are known counts as well: every depth is in proportion to their slants.
"""

from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Kept
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.circle import pad_circle
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.parallax.views import (
    COLUMNS_A_BLOCK,
    FineGrid,
    FineStrip,
    fine_grid,
    fine_strips,
    textures,
)
from endoct.stitching.panorama import Panorama

COST = 200
"""A depth costs so much where frames have nothing in common there, and 0 where they are alike."""
UNSEEN = 255
"""Every depth costs this in a block that fewer than two frames see."""
Costs = NDArray[np.uint8]
"""What depths cost, by block along z, block around, and depth."""
DEPTHS_MM = np.cumsum(np.concatenate([[-0.1], np.full(20, 0.025), 0.025 * 1.083 ** np.arange(1, 27)]))
WALL = 4
"""These depths are tried, mm, with the wall's own, 0, at ``WALL``. They are even where floors are shallow, then ever
farther apart."""
SCALES_MM = (0.007, 0.01, 0.014, 0.02, 0.03, 0.045)
"""Textures of these scales are tried, the finest first: noise and blur leave only coarser ones in common."""
ALIKE = 0.3
"""Frames see the same wall where textures cost less at depth 0, in the median: 0.16 to 0.25 in sharp recordings."""
WINDOW_MM = (0.1, 0.04)
"""Costs are means over this length along z and around."""
STEP, JUMP = 0.2, 1.0
"""It costs this to lie one depth, or any number of depths, behind a neighbour."""
DOUBT = 0.05
"""Depths that cost this much more are 1/e as probable."""
ROUGHNESS = 1.0
SCALE_STATED, SCALE_ASSUMED = 0.03, 0.15
"""All depths together have this relative standard error where the mirror's optics are stated, or are assumed."""
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


def sweep(
    textures: NDArray[np.int8],
    first_mm: Coordinates,
    row_mm: float,
    frame_z_mm: Coordinates,
    strip: tuple[Coordinates, Coordinates],
    z_mm: Coordinates,
    depths_mm: Coordinates,
) -> Costs:
    """Return what each depth costs in each block, uint8 (n_z, n_theta, n_depths), ``UNSEEN`` where too few see it.

    ``textures``: local contrast of frames, int8 (n_frames, n_rows, n_columns), -128 where unknown. ``first_mm`` is z of
    their first rows and ``frame_z_mm`` that of their middles, both float64 (n_frames,); ``row_mm``: from row to row.
    ``strip``: z from a frame's middle, ascending, and the slant there. ``z_mm``: of the samples of blocks, float64
    (n_z, samples along z); around, a block has two columns.
    """
    n_theta = textures.shape[2] // COLUMNS_A_BLOCK
    costs = np.full((len(z_mm), n_theta, depths_mm.size), UNSEEN, np.uint8)
    for k, depth_mm in enumerate(depths_mm):
        seen_mm = places_seen(z_mm, frame_z_mm, float(depth_mm), strip)
        _add_costs(textures, (seen_mm - first_mm) / row_mm, costs[:, :, k])
    return costs


def places_seen(
    z_mm: Coordinates, frame_z_mm: Coordinates, depth_mm: float, strip: tuple[Coordinates, Coordinates]
) -> Coordinates:
    """Return where on the wall the rays pass that end ``depth_mm`` behind ``z_mm``, float64 (…, n_frames), mm.

    ``strip``: z from a frame's middle, ascending, and the slant there. NaN where a frame does not see the place.
    """
    along_mm, slant = strip
    from_middle = z_mm[..., None] - frame_z_mm
    places = np.interp(from_middle, along_mm + slant * depth_mm, along_mm, left=np.nan, right=np.nan)
    return np.asarray(places + frame_z_mm)


def best_depths(costs: Costs, step: int, jump: int, depths_mm: Coordinates) -> Image:
    """Return the depths that fit best together, between those that were tried, float32 (n_z, n_theta), mm.

    ``step`` and ``jump``: what it costs to lie one depth or more behind a neighbour.
    """
    total = np.zeros(costs.shape, np.uint16)
    _add_paths(costs, step, jump, total)
    best = np.clip(total.argmin(axis=2), 1, depths_mm.size - 2)[:, :, None]
    before, least, after = (np.take_along_axis(total, best + k, 2)[:, :, 0].astype(np.float64) for k in (-1, 0, 1))
    bend = before - 2 * least + after
    beyond = np.divide(before - after, 2 * bend, out=np.zeros_like(bend), where=bend > 0)
    places = best[:, :, 0] + np.clip(beyond, -0.5, 0.5)
    return np.asarray(np.interp(places, np.arange(depths_mm.size), depths_mm), dtype=np.float32)


@compiled
def _add_costs(textures: NDArray[np.int8], rows: Coordinates, costs: NDArray[np.uint8]) -> None:
    """Write what one depth costs, (n_z, n_theta); ``rows`` of the textures that show it, (n_z, samples, n_frames)."""
    n_columns = textures.shape[2]
    apart, whole = np.empty(costs.shape[1], np.float32), np.empty(costs.shape[1], np.float32)
    total, squares = np.empty(n_columns, np.float32), np.empty(n_columns, np.float32)
    count = np.empty(n_columns, np.float32)
    for i in range(costs.shape[0]):
        apart[:] = 0
        whole[:] = 0
        for sample in range(rows.shape[1]):
            total[:] = 0
            squares[:] = 0
            count[:] = 0
            for k in range(rows.shape[2]):
                row = rows[i, sample, k]
                if not (row >= 0 and row <= textures.shape[1] - 1):  # NaN too
                    continue
                above = min(int(row), textures.shape[1] - 2)
                beyond = np.float32(row - above)
                one, two = textures[k, above], textures[k, above + 1]
                for j in range(n_columns):
                    value = np.float32(one[j]) + beyond * (np.float32(two[j]) - np.float32(one[j]))
                    known = np.float32(1) if one[j] != -128 and two[j] != -128 else np.float32(0)
                    total[j] += known * value
                    squares[j] += known * value * value
                    count[j] += known
            for j in range(n_columns):
                if count[j] >= 2:
                    apart[j // 2] += squares[j] - total[j] * total[j] / count[j]
                    whole[j // 2] += squares[j] * (count[j] - 1) / count[j]
        for b in range(costs.shape[1]):
            if whole[b] > 0:
                costs[i, b] = min(np.float32(COST), np.float32(COST) * apart[b] / whole[b])


@compiled
def _add_paths(costs: Costs, step: int, jump: int, total: NDArray[np.uint16]) -> None:
    """Add to ``total``, of the shape of ``costs``, what depths cost along the four paths that lead to each block."""
    n_z, n_theta, n = costs.shape
    for turn in range(2):  # the way there and the way back
        for i in range(n_z):
            before = np.zeros(n, np.int32)
            least = 0
            # a first lap finds what the path, which has no beginning, brings along
            for lap in range(2 * n_theta):
                j = lap % n_theta if turn == 0 else n_theta - 1 - lap % n_theta
                least = _step(costs[i, j], before, least, step, jump)
                if lap >= n_theta:
                    for d in range(n):
                        total[i, j, d] += before[d]
    for turn in range(2):
        behind = np.zeros((n_theta, n), np.int32)
        leasts = np.zeros(n_theta, np.int64)
        for k in range(n_z):
            i = k if turn == 0 else n_z - 1 - k
            for j in range(n_theta):
                leasts[j] = _step(costs[i, j], behind[j], leasts[j], step, jump)
                for d in range(n):
                    total[i, j, d] += behind[j, d]


@compiled
def _step(costs: NDArray[np.uint8], before: NDArray[np.int32], least: int, step: int, jump: int) -> int:
    """Replace what depths cost up to the block before by what they cost up to this one; return the least."""
    n = before.size
    left = before[0]
    new_least = 1 << 30
    for d in range(n):
        here = before[d]
        best = min(here, least + jump)
        if d > 0:
            best = min(best, left + step)
        if d + 1 < n:
            best = min(best, before[d + 1] + step)
        left = here
        before[d] = best - least + costs[d]
        new_least = min(new_least, before[d])
    return new_least
