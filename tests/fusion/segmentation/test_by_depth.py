"""Depth beside brightness: bright floors, stains, cells in the dark, depth that is not known, the seam of θ."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Mask
from endoct.fusion.evidence.evidence import Evidence
from endoct.fusion.evidence.relief import ParallaxRelief, parallax_relief
from endoct.fusion.segmentation.parameters import SegmentParameters
from endoct.fusion.segmentation.segment import judged_by_depth
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama

N_Z, N_THETA, STEP_MM = 120, 300, 0.02
ROWS, COLUMNS = np.mgrid[:N_Z, :N_THETA]
RADIUS_MM = N_THETA * STEP_MM / (2 * np.pi)


def disc(row: float, column: float, radius_mm: float) -> Mask:
    across = np.mod(COLUMNS - column + N_THETA / 2, N_THETA) - N_THETA / 2
    return np.asarray(np.hypot(ROWS - row, across) * STEP_MM <= radius_mm)


BRIGHT_FLOOR, DARK_CELL, STAIN = disc(60, 2, 0.3), disc(60, 120, 0.3), disc(60, 220, 0.3)
DARKNESS = Evidence(
    np.where(DARK_CELL, 1.0, np.where(STAIN, 0.2, 0.0)).astype(np.float32),
    np.ones((N_Z, N_THETA), np.bool_),
    STEP_MM * np.arange(N_Z),
    STEP_MM,
    0.0,
    RADIUS_MM,
    "darkness",
)
BY_DARKNESS = DARK_CELL | STAIN


def relief(error_mm: float = 0.02) -> ParallaxRelief:
    noise = np.random.default_rng(1).normal(0, 0.01, (N_Z, N_THETA))
    depth_mm = np.where(BRIGHT_FLOOR | DARK_CELL, 0.2, 0.0) + noise
    return ParallaxRelief(depth_mm.astype(np.float32), np.full((N_Z, N_THETA), error_mm, np.float32))


def without(relief_: ParallaxRelief, where: Mask) -> ParallaxRelief:
    def hidden(image: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.where(where, np.float32(np.nan), image)

    return ParallaxRelief(hidden(relief_.relief_mm), hidden(relief_.error_mm))


def test_a_bright_floor_across_the_seam_is_added_and_a_stain_dropped() -> None:
    cells, by_depth = judged_by_depth(BY_DARKNESS, DARKNESS, relief(), SegmentParameters())
    truth = BRIGHT_FLOOR | DARK_CELL
    assert (cells & truth).sum() / (cells | truth).sum() > 0.97
    assert by_depth.known == 1
    assert abs(by_depth.added - BRIGHT_FLOOR.mean()) < 0.1 * BRIGHT_FLOOR.mean()
    assert by_depth.dropped == STAIN.mean()


def test_depth_that_is_not_sure_changes_nothing() -> None:
    cells, by_depth = judged_by_depth(BY_DARKNESS, DARKNESS, relief(error_mm=0.2), SegmentParameters())
    np.testing.assert_array_equal(cells, BY_DARKNESS)
    assert by_depth.added == by_depth.dropped == 0


def test_darkness_decides_where_depth_is_not_known() -> None:
    cells, by_depth = judged_by_depth(
        BY_DARKNESS, DARKNESS, without(relief(), BRIGHT_FLOOR | STAIN), SegmentParameters()
    )
    np.testing.assert_array_equal(cells, BY_DARKNESS)
    assert by_depth.known == 1 - (BRIGHT_FLOOR | STAIN).mean()


def test_what_is_as_dark_as_deep_cells_is_no_stain() -> None:
    dark = replace(DARKNESS, values=np.where(STAIN, np.float32(0.8), DARKNESS.values))
    cells, _ = judged_by_depth(BY_DARKNESS, dark, relief(), SegmentParameters())
    assert cells[STAIN].all()


def test_nothing_is_added_where_nothing_was_observed() -> None:
    seen = replace(DARKNESS, valid=~disc(60, 2, 0.15))
    cells, _ = judged_by_depth(BY_DARKNESS & seen.valid, seen, relief(), SegmentParameters())
    assert not cells[~seen.valid].any()
    assert cells[BRIGHT_FLOOR & seen.valid].mean() > 0.9


def panorama(known: float) -> Panorama:
    shape = N_Z, N_THETA
    depth_mm = (0.03 * np.cos(2 * np.pi * COLUMNS / N_THETA) + 0.2 * BRIGHT_FLOOR).astype(np.float32)
    hidden = np.random.default_rng(2).random(shape) > known
    depth_mm[hidden] = np.nan
    error_mm = np.where(hidden, np.nan, 0.02)
    grid = SurfaceGrid.full_circle(N_Z, N_THETA, z0_mm=0.0, dz_mm=STEP_MM, radius_mm=RADIUS_MM)
    ones = np.ones(shape)
    return Panorama(
        grid, ones, None, ones > 0, ones, "camera", True, True, parallax_depth_mm=depth_mm, parallax_error_mm=error_mm
    )


def test_relief_is_taken_from_the_wall_of_a_probe_off_the_axis() -> None:
    found = parallax_relief(panorama(known=0.8))
    assert found is not None
    assert abs(found.known.mean() - 0.8) < 0.02
    assert abs(np.median(found.relief_mm[found.known & BRIGHT_FLOOR]) - 0.2) < 0.01
    assert np.abs(found.relief_mm[found.known & ~disc(60, 2, 0.4)]).max() < 0.01


def test_too_little_depth_is_none() -> None:
    assert parallax_relief(panorama(known=0.1)) is None
    assert parallax_relief(replace(panorama(1.0), parallax_depth_mm=None, parallax_error_mm=None)) is None
