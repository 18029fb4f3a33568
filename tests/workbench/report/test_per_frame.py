"""Numbers per frame as people read them: angles in degrees, next to what the store has."""

import math

import numpy as np
import pytest

from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.per_frame import PerFrame
from endoct.workbench.report.per_frame import number_of, number_rows
from endoct.workbench.report.side_findings import SideFindings

GRID = SurfaceGrid.full_circle(3, 8, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)


def side(**per_frame: PerFrame) -> SideFindings:
    image, known = np.ones(GRID.shape, np.float32), np.ones(GRID.shape, np.bool_)
    own = {"slice_z_mm": PerFrame(GRID.z_mm, "mm", "place"), **per_frame}
    panorama = Panorama(GRID, image, None, known, image, "oct", True, True, "slice", own)
    return SideFindings(
        name="oct", intensity=image, depth_mm=None, mask=known, valid=known, panorama=panorama, pictures={}
    )


def test_an_angle_is_in_degrees_with_what_the_store_has() -> None:
    lost_rad = PerFrame(np.radians([1.0, 2.0, 3.0]), "rad", "A-scans lost", usual=(0.0, math.radians(5)))
    [row] = number_rows(side(lost_rad=lost_rad))
    assert row == ["lost_rad", "A-scans lost", "0 to 5°", "1.1 to 2.9° (0.0192 to 0.0506 rad)"]


@pytest.mark.parametrize("rounded", [-1.97e-16, 3e-13])
def test_what_rounding_leaves_is_zero(rounded: float) -> None:
    [row] = number_rows(side(lost_rad=PerFrame(np.full(3, rounded), "rad", "A-scans lost")))
    assert row[-1] == "0° (0 rad)"
    [row] = number_rows(side(drift=PerFrame(np.full(3, 1e-6), "mm", "drift")))
    assert row[-1] == "1e-06 mm".replace("-", "−")


def test_only_angles_are_changed() -> None:
    values = np.array([0.1, 0.2])
    assert number_of("residual_mm", values, "misfit", "mm", (0.0, 0.3)).values is values
    turned = number_of("roll_rad", np.array([0.1, 2 * np.pi - 0.1]), "roll", "rad", None)
    assert (turned.unit, turned.values.tolist()) == ("°", pytest.approx([math.degrees(0.1), -math.degrees(0.1)]))
