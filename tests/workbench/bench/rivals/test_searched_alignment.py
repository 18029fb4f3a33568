"""Panoramas aligned by mutual information, from the best place of all."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.fusion.geometry.alignment import Alignment
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.workbench.bench.rivals import searched_alignment as searched
from endoct.workbench.bench.task import Case
from endoct.workbench.bench.tasks.alignment import TASK, AlignmentCase


@pytest.fixture(scope="module")
def small(easy: AlignmentCase) -> AlignmentCase:
    """The easy pair on every fourth sample, whose orientation is known, B turned by two thirds of the circle."""

    def fewer(side: Panorama) -> Panorama:
        n_z, n_theta = (size // 4 for size in side.grid.shape)
        rows = side.intensity[: 4 * n_z].reshape(n_z, 4, n_theta, 4).mean(axis=(1, 3))
        grid = SurfaceGrid.full_circle(n_z, n_theta, z0_mm=0.0, dz_mm=4 * side.grid.dz_mm, radius_mm=1.25)
        valid = np.ones(rows.shape, np.bool_)
        image = rows.astype(np.float32)
        return Panorama(grid, image, None, valid, valid.astype(np.float32), "blobs", True, True)

    a, b = map(fewer, easy.given)
    assert isinstance(easy.truth, Alignment)
    turned = replace(b, intensity=np.roll(b.intensity, 341, axis=1))
    theta_rad = easy.truth.theta_shift_rad - 2 * np.pi * 341 / 512
    return Case("small", (a, turned), replace(easy.truth, theta_shift_rad=float(np.mod(theta_rad, 2 * np.pi))), {})


def test_simpleitk_finds_any_turn_by_its_search(small: AlignmentCase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searched, "SEARCHED_PX", 8)
    monkeypatch.setattr(searched, "REFINED_PX", (2, 1))
    first, again = (searched.simpleitk_searched(*small.given) for _ in range(2))
    assert TASK.judge(small, first)["landmark_px"] < 1
    assert first == again
