"""Every frame as a fine strip of local contrast, which frames that show the same place have in common.

Light and shade change with the frame, and with how deep in a cell something lies. What stays is the texture: the
logarithm of the intensity, less its mean around, over its own spread around.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.memory import Kept
from endoct.base.compute.parallel import thread_map
from endoct.base.numeric.circle import largest_divisor, masked_gaussian
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.light import DARKEST
from endoct.modalities.endoscope.unroll import unroll_frame
from endoct.stitching.grid import SurfaceGrid

BLOCK_MM = 0.02
COLUMNS_A_BLOCK = 2
MOST_ROWS_A_BLOCK = 5
AROUND = 2.0
"""The surroundings reach this many times as far as the texture's own scale."""
LEAST_SPREAD = 0.01
STEPS_A_SPREAD = 32.0
UNKNOWN = -128


@dataclass(frozen=True)
class FineGrid:
    """Blocks of which the depth is found, and the samples they are made of.

    ``samples``: the grid of the samples; a block has ``rows`` of them along z and ``COLUMNS_A_BLOCK`` around.
    """

    samples: SurfaceGrid
    rows: int

    @property
    def n_blocks(self) -> tuple[int, int]:
        """Blocks along z and around."""
        return self.samples.n_z // self.rows, self.samples.n_theta // COLUMNS_A_BLOCK

    @property
    def block_size_mm(self) -> tuple[float, float]:
        """Length of a block along z and around."""
        return self.rows * self.samples.dz_mm, COLUMNS_A_BLOCK * self.samples.dtheta_mm

    def z_mm(self, blocks: range) -> Coordinates:
        """Return z of the samples of rows of blocks, float64 (blocks, rows)."""
        return self.samples.z_mm.reshape(-1, self.rows)[blocks.start : blocks.stop]

    def block_of(self, grid: SurfaceGrid) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return which block along z each row of ``grid`` lies in or next to, and which one around each column."""
        along = np.floor((self.samples.row_of(grid.z_mm) + 0.5) / self.rows)
        around = np.floor((self.samples.column_of(grid.theta_rad) + 0.5) / COLUMNS_A_BLOCK)
        n_z, n_theta = self.n_blocks
        return np.clip(along, 0, n_z - 1).astype(np.intp), around.astype(np.intp) % n_theta


def fine_grid(calibration: EndoscopeCalibration) -> FineGrid:
    """Return blocks about ``BLOCK_MM`` long over the panorama of ``calibration``, of rows as fine as the image's."""
    grid = calibration.grid
    together = largest_divisor(grid.n_theta, round(BLOCK_MM / 2 / (grid.dtheta_mm)))
    rows = int(np.clip(round(BLOCK_MM / calibration.optics.mm_per_px), 1, MOST_ROWS_A_BLOCK))
    first_mm, last_mm = calibration.row_z_mm[0], calibration.row_z_mm[-1]
    n_blocks = max(1, round((last_mm - first_mm) / BLOCK_MM))
    step_mm = BLOCK_MM / rows
    samples = SurfaceGrid.full_circle(
        n_blocks * rows,
        COLUMNS_A_BLOCK * (grid.n_theta // together),
        z0_mm=float(first_mm) + step_mm / 2,
        dz_mm=step_mm,
        radius_mm=grid.radius_mm,
        theta0_rad=grid.theta0_rad,
    )
    return FineGrid(samples, rows)


@dataclass(frozen=True, eq=False)
class FineStrip:
    """A frame on the rows of a fine grid from ``first`` on: logarithm of its intensity, float16; NaN where unseen."""

    first: int
    logs: NDArray[np.float16]


def fine_strips(
    stream: FrameStream, calibration: EndoscopeCalibration, fine: FineGrid, strips: Kept[FineStrip]
) -> None:
    """Append every frame of ``stream`` to ``strips``, on the rows of ``fine`` that it shows."""
    on_samples = replace(calibration, grid=fine.samples, row_z_mm=fine.samples.z_mm, oversample=(1, 1))
    for strip in thread_map(partial(unroll_frame, calibration=on_samples), stream):
        logs = np.where(strip.valid, np.log(np.maximum(strip.intensity, DARKEST)), np.nan)
        strips.append(FineStrip(int(np.rint(fine.samples.row_of(strip.z_mm[0]))), logs.astype(np.float16)))


def textures(
    strips: Sequence[FineStrip], scale_mm: float, grid: SurfaceGrid
) -> tuple[NDArray[np.intp], NDArray[np.int8]]:
    """Return the first row of every strip, (n,), and its local contrast, int8 (n, n_rows, n_columns).

    ``STEPS_A_SPREAD`` for one spread; ``UNKNOWN`` where nothing is seen, as beyond the end of the shorter strips.
    """
    longest = max((len(strip.logs) for strip in strips), default=0)
    stack = np.full((len(strips), longest, grid.n_theta), UNKNOWN, np.int8)
    for one, strip in zip(stack, strips, strict=True):
        one[: len(strip.logs)] = _local_contrast(strip.logs, scale_mm, grid)
    return np.array([strip.first for strip in strips], np.intp), stack


def _local_contrast(logs: NDArray[np.float16], scale_mm: float, grid: SurfaceGrid) -> NDArray[np.int8]:
    seen = np.isfinite(logs)
    values = np.where(seen, logs, 0).astype(np.float32)

    def smooth(image: Image, sigma_mm: float) -> Image:
        return masked_gaussian(image, seen, sigma_mm / grid.dz_mm, sigma_mm / grid.dtheta_mm)

    contrast = smooth(values, scale_mm) - smooth(values, AROUND * scale_mm)
    spread = np.sqrt(smooth(contrast**2, AROUND * scale_mm)) + np.float32(LEAST_SPREAD)
    steps = np.clip(np.rint(np.float32(STEPS_A_SPREAD) * contrast / spread), -127, 127)
    return np.where(seen, steps, UNKNOWN).astype(np.int8)
