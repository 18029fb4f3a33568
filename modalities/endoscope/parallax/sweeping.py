"""Plane sweep: how well frames agree if the wall lay at each of several depths.

A ray goes on behind the wall under its slant m. What lies δ behind the wall at z is seen where its ray passes the wall,
at z − m·δ. Frames see it under different slants, so their textures coincide at its true depth alone.
"""

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.compiled import compiled
from endoct.modalities.endoscope.parallax.views import COLUMNS_A_BLOCK, UNKNOWN

COST = 200
"""Cost of a depth at which frames have nothing in common; it is 0 where they agree."""
UNSEEN = 255
"""Every depth costs this in a block that fewer than two frames see."""
Costs = NDArray[np.uint8]
"""What depths cost, by block along z, block around, and depth."""
BETWEEN = 16
"""Textures are interpolated in so many steps from row to row: sums of squares of 500 frames then fit 32 bits."""
PLACES_A_ROW = 0.5
"""Where rays pass the wall is tabulated at every second row of the textures."""


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

    ``textures``: local contrast of frames, int8 (n_frames, n_rows, n_columns), ``UNKNOWN`` where that is. ``first_mm``
    is z of their first rows and ``frame_z_mm`` that of their middles, both float64 (n_frames,); ``row_mm``: from row to
    row. ``strip``: z from a frame's middle, ascending, and the slant there. ``z_mm``: of the samples of blocks, float64
    (n_z, samples along z); around, a block has two columns.
    """
    along_mm, slant = strip
    ends_mm = along_mm + slant * depths_mm[:, None]
    first, last = float(ends_mm.min()), float(ends_mm.max())
    tabulated_mm = np.linspace(first, last, 2 + int((last - first) / row_mm * PLACES_A_ROW))
    places = np.stack([places_seen(tabulated_mm, np.zeros(1), float(d), strip)[:, 0] for d in depths_mm])
    step_mm = float(tabulated_mm[1] - tabulated_mm[0])
    costs = np.full((len(z_mm), textures.shape[2] // COLUMNS_A_BLOCK, depths_mm.size), UNSEEN, np.uint8)
    holes = (textures == UNKNOWN).any(axis=2)
    _fill(textures, holes, (first_mm, frame_z_mm, row_mm), (places, first, step_mm), z_mm, costs)
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


@compiled
def _fill(
    textures: NDArray[np.int8],
    holes: Mask,
    frames: tuple[Coordinates, Coordinates, float],
    table: tuple[Coordinates, float, float],
    z_mm: Coordinates,
    costs: Costs,
) -> None:
    """Write what depths cost. ``table``: where rays pass the wall, (n_depths, n), first and distance of their ends."""
    first_mm, frame_z_mm, row_mm = frames
    places, ends_mm, step_mm = table
    n_columns = textures.shape[2]
    apart, whole = np.empty(n_columns, np.float32), np.empty(n_columns, np.float32)
    total, squares = np.empty(n_columns, np.int32), np.empty(n_columns, np.int32)
    count = np.empty(n_columns, np.int32)
    chosen, rows = np.empty(frame_z_mm.size, np.int64), np.empty(frame_z_mm.size, np.int64)
    beyond = np.empty(frame_z_mm.size, np.int32)
    for i in range(costs.shape[0]):
        for d in range(costs.shape[2]):
            apart[:] = 0
            whole[:] = 0
            for sample in range(z_mm.shape[1]):
                n = 0
                for k in range(frame_z_mm.size):
                    place = (z_mm[i, sample] - frame_z_mm[k] - ends_mm) / step_mm
                    if not (place >= 0 and place < places.shape[1] - 1):
                        continue
                    before = int(place)
                    passed = places[d, before] + (place - before) * (places[d, before + 1] - places[d, before])
                    row = (frame_z_mm[k] + passed - first_mm[k]) / row_mm
                    if row >= 0 and row <= textures.shape[1] - 1:  # not NaN
                        chosen[n], rows[n] = k, min(int(row), textures.shape[1] - 2)
                        beyond[n] = int(BETWEEN * (row - rows[n]) + 0.5)
                        n += 1
                if n < 2:
                    continue
                total[:] = 0
                squares[:] = 0
                count[:] = n
                for m in range(n):
                    above, below = textures[chosen[m], rows[m]], textures[chosen[m], rows[m] + 1]
                    with_holes = holes[chosen[m], rows[m]] or holes[chosen[m], rows[m] + 1]
                    _add(above, below, beyond[m], total, squares, count, with_holes)
                _judge(total, squares, count, apart, whole)
            for b in range(costs.shape[1]):
                differ, all_of_it = apart[2 * b] + apart[2 * b + 1], whole[2 * b] + whole[2 * b + 1]
                if all_of_it > 0:
                    costs[i, b, d] = min(np.float32(COST), np.float32(COST) * differ / all_of_it)


@compiled
def _add(
    above: NDArray[np.int8],
    below: NDArray[np.int8],
    beyond: int,
    total: NDArray[np.int32],
    squares: NDArray[np.int32],
    count: NDArray[np.int32],
    with_holes: bool,
) -> None:
    """Add what lies ``beyond`` of ``BETWEEN`` steps from one row to the next, ``BETWEEN`` times, and its square.

    ``with_holes``, it counts where either is not known.
    """
    for j in range(total.size):
        if with_holes and (above[j] == UNKNOWN or below[j] == UNKNOWN):
            count[j] -= 1
        else:
            value = np.int32(above[j]) * np.int32(BETWEEN - beyond) + np.int32(below[j]) * np.int32(beyond)
            total[j] += value
            squares[j] += value * value


@compiled
def _judge(
    total: NDArray[np.int32],
    squares: NDArray[np.int32],
    count: NDArray[np.int32],
    apart: NDArray[np.float32],
    whole: NDArray[np.float32],
) -> None:
    """Add how far samples differ from their mean, and how far they would if they had nothing in common."""
    for j in range(total.size):
        share = np.float32(1) / np.float32(max(count[j], np.int32(1)))
        t, s = np.float32(total[j]), np.float32(squares[j])
        apart[j] += s - t * t * share
        whole[j] += s - s * share
