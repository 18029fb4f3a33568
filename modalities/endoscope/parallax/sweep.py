"""The plane sweep: how well frames agree on a place, if it lies so deep; and the depths that fit best as a whole.

A ray goes on behind the wall under its slant m: what lies δ behind the wall at z is seen where its ray passes the wall,
at z − m·δ. Frames see it under different slants, so their textures coincide at its true depth alone.

Neighbours mostly lie equally deep, so depths are found together by semi-global matching (Hirschmüller 2008), along z
and around, where paths close upon themselves.
"""

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.compiled import compiled
from endoct.modalities.endoscope.parallax.views import COLUMNS_A_BLOCK

COST = 200
"""Frames that have nothing in common, as what depths cost; 0 where they are alike."""
UNSEEN = 255
"""As cost of every depth of a block that fewer than two frames see."""
Costs = NDArray[np.uint8]
"""By block along z, block around, and depth."""


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

    ``textures``: local contrast of frames, int8 (n_frames, n_rows, n_columns), -128 where unknown, with ``first_mm``,
    z of their first rows, ``row_mm`` from row to row, and ``frame_z_mm``, z of their middles, both float64 (n_frames,).
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
