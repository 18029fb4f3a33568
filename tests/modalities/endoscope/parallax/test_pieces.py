"""Pieces of the wall, the frames that show them, means of costs and how rough depths are: by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from endoct.modalities.endoscope.parallax import depth
from endoct.modalities.endoscope.parallax.views import FineGrid
from endoct.stitching.grid import SurfaceGrid

COLUMN_MM = 0.01
"""Blocks of 2 × 2 samples are 20 µm long each way."""


def blocks(along: int, around: int = 40) -> FineGrid:
    radius_mm = 2 * around * COLUMN_MM / (2 * np.pi)
    return FineGrid(SurfaceGrid.full_circle(2 * along, 2 * around, z0_mm=0.0, dz_mm=0.01, radius_mm=radius_mm), rows=2)


def test_pieces_keep_all_blocks_once_and_sweep_some_on_either_side() -> None:
    """1.5 mm are 75 blocks, and 0.2 mm are 10."""
    pieces = depth._pieces(blocks(200))
    assert [piece.kept for piece in pieces] == [range(75), range(75, 150), range(150, 200)]
    assert [piece.swept for piece in pieces] == [range(85), range(65, 160), range(140, 200)]
    assert [(piece.swept, piece.kept) for piece in depth._pieces(blocks(40))] == [(range(40), range(40))]


def test_frames_are_those_whose_rays_may_end_at_a_row() -> None:
    """Rays pass the wall up to 0.4 mm from a frame's middle; 0.2 mm behind it they end 0.1 mm farther on."""
    along_mm = np.linspace(-0.4, 0.4, 9)
    optics = SimpleNamespace(r_px=lambda z_mm: 100 + z_mm, slant=lambda r_px: np.full(r_px.shape, 0.5))
    frames_mm = np.array([0.45, 0.51, 0.99, 1.40, 1.58, 1.60])
    calibration: Any = SimpleNamespace(strip_z_mm=along_mm, optics=optics, z_mm=frames_mm)
    rows = range(50, 60)  # samples at 1.00 to 1.19 mm
    assert depth._frames_of(rows, calibration, blocks(100), np.array([0.0, 0.2])) == [1, 2, 3, 4]
    assert depth._frames_of(rows, calibration, blocks(100), np.zeros(1)) == [2, 3, 4]


def test_costs_are_means_over_5_blocks_along_and_3_around_the_seam() -> None:
    costs = np.zeros((12, 40, 2), np.uint8)
    costs[6, 0, 1] = 150
    means = depth._mean_around(costs, blocks(12))
    expected = np.zeros_like(costs)
    expected[4:9, [39, 0, 1], 1] = 10
    np.testing.assert_array_equal(means, expected)
    costs[:] = 0
    costs[0] = 15
    np.testing.assert_array_equal(depth._mean_around(costs, blocks(12))[:4, 0, 0], [9, 6, 3, 0])  # the end once more


def test_depths_are_rough_by_how_far_their_neighbours_lie() -> None:
    flat = np.full((6, 8), 0.3, np.float32)
    flat[2, 0] = 1.2
    rough = depth._roughness(flat)
    near = np.zeros(flat.shape, np.bool_)
    near[1:4, [7, 0, 1]] = True
    # one of nine lies 0.9 higher: the standard deviation is 0.9·√8/9
    assert rough[near] == pytest.approx(0.9 * np.sqrt(8) / 9, rel=1e-4)
    assert rough[~near] == pytest.approx(0, abs=2e-4)
    ramp = np.repeat(0.1 * np.arange(6, dtype=np.float32)[:, None], 8, axis=1)
    assert depth._roughness(ramp)[1:-1] == pytest.approx(0.1 * np.sqrt(2 / 3), rel=1e-4)
    assert depth._roughness(ramp)[[0, -1]] == pytest.approx(0.1 * np.sqrt(2) / 3, rel=1e-4)  # the end once more
