"""What layers are made of: classes, and outlines of a mask in the frame that is shown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bore_pairs import panorama

from endoct.base.zarr.window import ChunkCache
from endoct.fusion.geometry.alignment import Alignment
from endoct.fusion.scoring.overlap import BOTH, ONLY_A, ONLY_B
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.store import read_outline, save_panorama
from endoct.workbench.page.layers import Classes, mask_outlines, panorama_layers, wall_of
from endoct.workbench.page.plane import Averaged

GRID = SurfaceGrid.full_circle(50, 120, z0_mm=1.0, dz_mm=0.05, radius_mm=1.2)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("z_reversed", [False, True])
def test_an_outline_lies_where_the_alignment_puts_the_mask(mirrored: bool, z_reversed: bool):
    """A rectangle over the seam: all of its outline lies around its corners' places in the other frame."""
    mask = np.zeros(GRID.shape, np.bool_)
    mask[10:20, [*range(112, 120), *range(12)]] = True
    where = Alignment(0.7, 0.3, mirrored=mirrored, z_scale=1.02, z_reversed=z_reversed)
    points = np.concatenate([np.reshape(line, (-1, 2)) for line in mask_outlines(mask, GRID, where)])
    z_mm = np.sort(where.z_to_a(GRID.z_mm[[10, 19]]))
    assert points[:, 1].min() == pytest.approx(z_mm[0], abs=0.05)
    assert points[:, 1].max() == pytest.approx(z_mm[1], abs=0.05)
    middle = float(where.theta_to_a(1.5 * GRID.dtheta_rad))
    apart = np.abs((points[:, 0] - middle + np.pi) % (2 * np.pi) - np.pi)
    assert apart.max() == pytest.approx(10 * GRID.dtheta_rad, abs=1.6 * GRID.dtheta_rad)
    assert apart.max() < 0.7


def test_the_classes_of_one_side_and_of_two():
    """By half of a pixel or more; what a side did not observe is of no class."""
    one = Averaged(np.array([[0.5, 0.49, 1.0, 1.0]], np.float32), np.array([[1, 1, 1, 0]], np.bool_))
    other = Averaged(np.array([[1.0, 1.0, 0.0, 1.0]], np.float32), np.ones((1, 4), np.bool_))
    layer = Classes((), ())
    assert layer.classes([one]).tolist() == [[1, 0, 1, 255]]
    assert layer.classes([one, other]).tolist() == [[BOTH, ONLY_B, ONLY_A, 255]]
    assert layer.classes([other]).tolist() == [[1, 1, 0, 1]]


def test_parallax_that_was_found_nowhere_is_no_layer(tmp_path: Path):
    plain = panorama(np.ones((20, 64)), dz_mm=0.1)
    nowhere, part = (np.full(plain.grid.shape, np.nan, np.float32) for _ in range(2))
    part[3:6, 60:] = part[3:6, :4] = 0.2
    titles = []
    for k, depth_mm in enumerate((nowhere, part)):
        store = tmp_path / f"{k}.zarr"
        save_panorama(replace(plain, parallax_depth_mm=depth_mm, parallax_error_mm=depth_mm / 4), store)
        layers = panorama_layers(store, read_outline(store), wall_of(plain.grid), ChunkCache())
        titles.append([layer.part.title for layer in layers])
    assert titles == [["camera: image"], ["camera: image", "camera: relief by parallax"]]
