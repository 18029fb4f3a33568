"""Every task of the published benchmark shows what is had for no work, and plain rivals are right where it is easy."""

import numpy as np
import pytest

from endoct.fusion.geometry.alignment import Alignment, NotAligned
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.published.definition import load_definition
from endoct.workbench.bench.rivals.plain import STEP_MM, fft_correlation
from endoct.workbench.bench.task import load_task, method_names


@pytest.mark.parametrize("name", load_definition("endoct-bench-2").tasks)
def test_every_task_has_its_baselines(name: str) -> None:
    methods = method_names(load_task(name))
    assert "constant" in methods
    assert ("flat" if name == "depth" else "nothing") in methods


def side(depth_mm: np.ndarray) -> Panorama:
    grid = SurfaceGrid.full_circle(*depth_mm.shape, z0_mm=1.0, dz_mm=STEP_MM, radius_mm=1.25)
    valid = np.ones(depth_mm.shape, np.bool_)
    return Panorama(grid, np.ones_like(depth_mm), depth_mm, valid, valid.astype(np.float32), "oct", True, True)


def test_a_turned_and_shifted_wall_is_found_and_a_periodic_one_is_not() -> None:
    wall = np.random.default_rng(3).random((12, 16)).repeat(8, 0).repeat(16, 1).astype(np.float32) * 0.2
    there = fft_correlation(side(wall), side(np.roll(wall[20:80], -32, axis=1)))
    assert isinstance(there, Alignment)
    assert there.theta_shift_rad == pytest.approx(2 * np.pi * 32 / 256, abs=0.02)
    assert there.z_to_a(1.0) == pytest.approx(1.0 + 20 * STEP_MM, abs=0.06)
    twice = np.concatenate([wall[:, :128]] * 2, axis=1)
    assert isinstance(fft_correlation(side(twice), side(twice)), NotAligned)
