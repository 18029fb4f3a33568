"""Every frame as a fine strip of local contrast, which frames that show the same place have in common.

Light and shade change with the frame, and with how deep in a cell something lies. What stays is the texture: the
logarithm of the intensity, less its mean around, over its own spread around.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, sqrt
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Room
from endoct.base.numeric.circle import largest_divisor
from endoct.modalities.contract import Frame
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
UNKNOWN = 0
_ROOM = Room()


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
class Strip:
    """What a frame shows on the rows of a fine grid from ``first`` on: float32 logarithms of its intensity, and where.

    Both (n_rows, n_columns).
    """

    first: int
    logs: Image
    known: Mask


@dataclass(frozen=True, eq=False)
class Texture:
    """The local contrast of a strip, int8 (n_rows, n_columns), ``STEPS_A_SPREAD`` for one spread.

    It is ``UNKNOWN`` where nothing is known, and nowhere else.
    """

    first: int
    contrast: NDArray[np.int8]


def on_fine_rows(calibration: EndoscopeCalibration, fine: FineGrid) -> EndoscopeCalibration:
    """Return ``calibration`` such that frames are unrolled to the samples of ``fine``."""
    return replace(calibration, grid=fine.samples, row_z_mm=fine.samples.z_mm, oversample=(1, 1))


def fine_strip(frame: Frame, on_samples: EndoscopeCalibration) -> Strip:
    """Return what ``frame`` shows, on the samples of a calibration by :func:`on_fine_rows`."""
    strip = unroll_frame(frame, on_samples)
    logs = np.maximum(strip.intensity, np.float32(DARKEST))
    first = int(np.rint(on_samples.grid.row_of(strip.z_mm[0])))
    return Strip(first, np.log(logs, out=logs), strip.valid)


def texture(strip: Strip, scale_mm: float, grid: SurfaceGrid) -> Texture:
    """Return the texture of ``strip`` on the scale ``scale_mm``.

    The mean near a sample is by a Gaussian, those of its surroundings by a box that is passed over them twice.
    """
    sigma = scale_mm / grid.dtheta_mm, scale_mm / grid.dz_mm
    near_around, near_along = (cv2.getGaussianKernel(2 * ceil(3 * size) + 1, size, cv2.CV_32F) for size in sigma)
    box = _box(AROUND * sigma[0]), _box(AROUND * sigma[1])
    beyond = near_around.size // 2 + 3 * box[0]
    n_rows, n_columns = strip.logs.shape
    shape = n_rows, n_columns + 2 * beyond

    def padded(name: str, image: NDArray[Any]) -> NDArray[Any]:
        wide = _ROOM.array(name, shape, image.dtype)
        cv2.copyMakeBorder(image, 0, 0, beyond, beyond, cv2.BORDER_WRAP, dst=wide)
        return wide

    def mean_near(name: str, image: Image) -> Image:
        smooth = _ROOM.array(name, shape)
        cv2.sepFilter2D(image, cv2.CV_32F, near_around, near_along, dst=smooth, borderType=cv2.BORDER_REPLICATE)
        return smooth

    def mean_around(name: str, image: Image) -> Image:
        smooth = _ROOM.array(name, shape)
        cv2.blur(image, box, dst=smooth, borderType=cv2.BORDER_REPLICATE)
        cv2.blur(smooth, box, dst=smooth, borderType=cv2.BORDER_REPLICATE)
        return smooth

    logs, known = padded("logs", strip.logs), padded("known", strip.known.view(np.uint8))
    weight = _ROOM.array("weight", shape)
    np.copyto(weight, known)
    np.multiply(logs, weight, out=logs)
    share_near, share_around = mean_near("share near", weight), mean_around("share around", weight)
    contrast, around = mean_near("contrast", logs), mean_around("around", logs)
    square = logs
    _contrast(contrast, around, known, (share_near, share_around), square)
    steps = np.empty(strip.logs.shape, np.int8)
    _in_spreads(contrast, mean_around("around", square), known, share_around, beyond, steps)
    return Texture(strip.first, steps)


def _box(sigma_px: float) -> int:
    """Return the width of the box that, passed over twice, spreads like a Gaussian."""
    return 2 * max(1, round((sqrt(6 * sigma_px**2 + 1) - 1) / 2)) + 1


@compiled
def _contrast(near: Image, around: Image, known: NDArray[np.uint8], shares: tuple[Image, Image], square: Image) -> None:
    """Turn means ``near`` samples into their contrast with those ``around``, 0 where unseen; write its ``square``."""
    share_near, share_around = shares
    for i in range(near.shape[0]):
        for j in range(near.shape[1]):
            # what is seen has a share of itself
            contrast = (
                near[i, j] / share_near[i, j] - around[i, j] / share_around[i, j] if known[i, j] else np.float32(0)
            )
            near[i, j] = contrast
            square[i, j] = contrast * contrast


@compiled
def _in_spreads(
    contrast: Image, square: Image, known: NDArray[np.uint8], share: Image, beyond: int, steps: NDArray[np.int8]
) -> None:
    """Write ``contrast`` in steps of its spread; 0 means unknown, so none of them is 0."""
    for i in range(steps.shape[0]):
        for j in range(steps.shape[1]):
            b = j + beyond
            if known[i, b]:
                spread = np.sqrt(max(square[i, b], np.float32(0)) / share[i, b]) + np.float32(LEAST_SPREAD)
                step = min(max(np.float32(STEPS_A_SPREAD) * contrast[i, b] / spread, np.float32(-127)), np.float32(127))
                steps[i, j] = np.int8(step + (np.float32(1) if step >= 0 else np.float32(-1)) * np.float32(0.5))
                if steps[i, j] == 0:
                    steps[i, j] = 1
            else:
                steps[i, j] = UNKNOWN


def stacked(textures: Sequence[Texture], n_columns: int, room: Room) -> tuple[NDArray[np.intp], NDArray[np.int8]]:
    """Return the first row of every texture, (n,), and all of them, int8 (n, n_rows, n_columns), an array of ``room``.

    Shorter ones end in ``UNKNOWN``. There may be none.
    """
    longest = max((len(one.contrast) for one in textures), default=0)
    stack = room.array("textures", (len(textures), longest, n_columns), np.int8)
    for here, one in zip(stack, textures, strict=True):
        here[: len(one.contrast)] = one.contrast
        here[len(one.contrast) :] = UNKNOWN
    return np.array([one.first for one in textures], np.intp), stack
