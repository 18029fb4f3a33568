"""How one would place the strips with a whole program for stitching: m2stitch.

It sees θ as a circle, as every strip is continued by some columns at either end. What it takes for a bad pair is "I do
not know". It gets strips without what is the same in every strip and in every row, as ours does.
"""

import contextlib
import io
import warnings
from collections.abc import Iterator, Sequence

import numpy as np

from endoct.base.numeric.circle import pad_circle
from endoct.stitching.strip import Strip
from endoct.workbench.bench.rivals.stitching import (
    poses_of,
    prepared,
    row_mm,
)
from endoct.workbench.bench.task import Declined, NotInstalled
from endoct.workbench.bench.tasks.stitching import StripPoses

AROUND = 32
"""Columns by which a strip is continued at either end."""
M2_LEAST_CORRELATION, M2_UNCERTAIN_PERCENT, M2_FARTHEST_PERCENT = 0.1, 45.0, 60.0


def m2stitch_prepared(strips: Sequence[Strip], nominal_pitch_mm: float) -> StripPoses:
    """m2stitch (Fukai 2022), which is MIST (Chalfoun et al. 2017) in Python, on prepared strips.

    MIST is for grids of tiles with neighbours on two sides, so every strip is cut into two halves that overlap.
    """
    try:
        with _quiet():
            import m2stitch
    except ImportError as error:
        raise NotInstalled("m2stitch") from error
    images, rows = prepared(strips), nominal_pitch_mm / row_mm(strips)
    if rows < 0:  # it wants the first tile on top
        images = images[::-1]
    n, half = len(images), images.shape[2] // 2
    around = pad_circle(images, AROUND)
    tiles = np.stack([around[:, :, first : first + half + 2 * AROUND] for first in (0, half)], axis=1)
    index = np.stack(np.meshgrid(np.arange(n), [0, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    try:
        with _quiet():
            grid, _ = m2stitch.stitch_images(
                tiles.reshape(2 * n, *tiles.shape[2:]),
                position_indices=index,
                position_initial_guess=index * [abs(rows), half],
                overlap_diff_threshold=M2_FARTHEST_PERCENT,
                pou=M2_UNCERTAIN_PERCENT,
                ncc_threshold=M2_LEAST_CORRELATION,
                full_output=True,
                row_col_transpose=False,
            )
    except AssertionError as error:
        raise Declined(f"m2stitch gave up: {error}") from error
    places = grid[["y_pos", "x_pos"]].to_numpy(np.float64).reshape(n, 2, 2).mean(axis=1)
    sure = grid["top_valid3"].to_numpy(np.bool_).reshape(n, 2)[1:].any(axis=1)
    shifts = np.diff(places, axis=0)
    if rows < 0:
        shifts, sure = -shifts[::-1], sure[::-1]
    known = [(float(y), float(x), bool(is_known)) for (y, x), is_known in zip(shifts, sure, strict=True)]
    return poses_of(known, strips, nominal_pitch_mm)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep progress bars and warnings of libraries to themselves."""
    with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        yield
