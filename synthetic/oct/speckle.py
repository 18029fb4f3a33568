"""What bone returns: white, circular Gaussian scatterers, one for each axial pixel and column.

Summed over the width of the beam, they are fully developed speckle. Arrays are (column, sample).
"""

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.stitching.arrays import Coordinates, Image
from endoct.synthetic.oct.beams import BONE_INDEX, Echoes
from endoct.synthetic.oct.spectrometer import roll_off
from endoct.synthetic.oct.sweep import Sweep
from endoct.synthetic.oct.turn import lateral_taps
from endoct.synthetic.sample.parameters import Oct
from endoct.synthetic.sample.randomness import bell

COLUMNS = 128  # worked on at a time
DUST_DB = 2.0  # dust scatters more than bone, and its surface is rougher (chosen)
DUST_ROUGHNESS_MM = 0.008
DIVERGENCE_DB_MM = 6.0  # lost for each mm that the wall is beyond the nominal one, where the focus is (chosen)
NEGLIGIBLE_DB = -20.0  # what bone returns below this is left out
TABLE_PER_PX = 32


def speckle(sweep: Sweep, rng: Generator) -> NDArray[np.complex64]:
    """Return the scatterers that every column's beam gathers, complex64 (column, n), of relative amplitude."""
    oct_, one, turn, echoes = sweep.oct_, sweep.spectrometer, sweep.turn, sweep.echoes
    n, pixel = one.window.size, oct_.axial_pixel_mm
    level_db = oct_.wall_db + sweep.wall_db
    level_db -= DIVERGENCE_DB_MM * np.clip(np.nan_to_num(echoes.wall_radius_mm) - sweep.radius_mm, 0, None)
    level_db += DUST_DB * echoes.dust - echoes.shadow_db
    # a steep wall returns little
    level = 10 ** (level_db / 10) * (0.06 + 0.94 * np.nan_to_num(echoes.wall_cosine) ** 1.5)
    rough_mm = np.where(echoes.dust, DUST_ROUGHNESS_MM, 0) * turn(bell(rng, turn.n_ring))
    entry_px = (echoes.wall_path_mm + rough_mm - oct_.first_sample_mm) / pixel
    bone = np.zeros((turn.n, n), np.complex64)
    if not np.any(np.isfinite(entry_px)):
        return bone
    first = int(np.clip(np.nanmin(entry_px) - 1, 0, n - 1))
    last = _negligible_from(oct_, float(level.max()), first, n)

    # all columns show one profile, shifted: they are windows of it, tabulated for every 1/32 pixel of shift, and
    # everything twice in a row, for the real and the imaginary part
    bins = np.arange(first, last)
    below = np.arange(-TABLE_PER_PX, (last - first + 2) * TABLE_PER_PX) / TABLE_PER_PX
    table = np.sqrt(_profile(oct_, below, np.clip(below + 0.5, 0, 1))).astype(np.float32).reshape(-1, TABLE_PER_PX).T
    above, beyond_table = np.zeros((TABLE_PER_PX, bins.size), np.float32), np.repeat(table[:, -1:], bins.size, axis=1)
    table = np.repeat(np.concatenate([above, table, beyond_table], axis=1), 2, axis=1)
    place = TABLE_PER_PX * (first + 1) - np.rint(np.nan_to_num(entry_px, nan=2.0 * n) * TABLE_PER_PX).astype(np.intp)
    start = np.clip(place // TABLE_PER_PX + bins.size, 0, table.shape[1] // 2 - bins.size)
    windows = sliding_window_view(table, 2 * bins.size, axis=1)
    gain = np.sqrt(0.5 * one.bone_unit2 * level).astype(np.float32)[:, None]
    rolled = np.repeat(roll_off(oct_, bins.astype(np.float64), n), 2).astype(np.float32)
    scatterers = bell(rng, turn.n_ring * 2 * bins.size).reshape(turn.n_ring, -1)
    amplitude, on_ring = np.empty((turn.n, 2 * bins.size), np.float32), turn.place
    for a_block in range(0, turn.n, COLUMNS):
        columns = slice(a_block, min(turn.n, a_block + COLUMNS))
        part = windows[place[columns] % TABLE_PER_PX, 2 * start[columns]]
        for column in np.flatnonzero(np.isfinite(echoes.exit_path_mm[columns])):
            part[column] = np.repeat(_beyond_septum(oct_, echoes, a_block + int(column), entry_px, bins), 2)
        part *= gain[columns]
        part *= rolled
        np.multiply(part, scatterers.take(on_ring[columns], axis=0), out=amplitude[columns])
    taps = lateral_taps(oct_, sweep.radius_mm, turn.n_ring)
    bone[:, first:last] = _summed(amplitude, taps).view(np.complex64)
    return bone


def _beyond_septum(
    oct_: Oct, echoes: Echoes, column: int, entry_px: Coordinates, bins: NDArray[np.intp]
) -> Coordinates:
    """Return the amplitude from axial pixels ``bins`` of a beam that leaves bone and may meet it again."""
    ends = [echoes.exit_path_mm[column], echoes.reentry_path_mm[column]]
    out, back = (np.nan_to_num(np.array(ends), nan=np.inf) - oct_.first_sample_mm) / oct_.axial_pixel_mm
    inside, beyond = bins - entry_px[column], np.minimum(bins, back) - out
    gap = np.clip(bins + 0.5 - out, 0, 1) - np.clip(bins + 0.5 - back, 0, 1)
    share = np.clip(inside + 0.5, 0, 1)
    left: Coordinates = np.sqrt(_profile(oct_, inside - np.maximum(beyond, 0), share - np.minimum(gap, share)))
    return left


def _profile(oct_: Oct, below_px: Coordinates, share: Coordinates) -> Coordinates:
    """Return the intensity from axial pixels with ``below_px`` of bone above them, a ``share`` of them bone."""
    depth_mm = np.maximum(below_px, 0) * oct_.axial_pixel_mm / BONE_INDEX
    tail = 10 ** (oct_.tail_db / 10)
    profile: Coordinates = (1 - tail) * np.exp(-depth_mm / oct_.attenuation_mm) + tail * np.exp(
        -depth_mm / oct_.tail_mm
    )
    return share * profile


def _negligible_from(oct_: Oct, most: float, first: int, n: int) -> int:
    """Return the axial pixel from which bone that begins at ``first`` cannot be seen, not even folded back."""
    bins = np.arange(first, n, dtype=np.float64)
    left = _profile(oct_, bins - first, np.ones_like(bins))
    bright = np.flatnonzero(most * left * roll_off(oct_, bins, n) ** 2 > 10 ** (NEGLIGIBLE_DB / 10))
    return first + (int(bright[-1]) + 1 if bright.size else 1)


def _summed(image: Image, taps: Image) -> Image:
    """Return ``image`` convolved with ``taps`` along columns; the columns at both ends are a margin."""
    out = cv2.sepFilter2D(image, cv2.CV_32F, np.ones(1, np.float32), taps, borderType=cv2.BORDER_REFLECT)
    return np.asarray(out, dtype=np.float32)
