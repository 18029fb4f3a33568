"""Strips of a recording become its panorama, and what they tell of frames its figures."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.assembly import assemble
from endoct.modalities.contract import Manifest
from endoct.modalities.registry import manifests
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip

GRID = SurfaceGrid.full_circle(3, 8, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
OCT: Manifest = manifests()["oct"]


@dataclass(frozen=True)
class Outward:
    """A calibration of three slices, the one nearest the mouth last."""

    grid: SurfaceGrid = GRID
    row_z_mm: Any = field(default_factory=lambda: GRID.z_mm)
    per_frame: Any = field(default_factory=lambda: {"z_mm": GRID.z_mm[::-1], "residual_mm": np.zeros(3)})
    notes: tuple[str, ...] = ()
    handedness_known: bool = True
    travel_known: bool = True


def assembled(*values: dict[str, float]) -> Panorama:
    ones = np.ones((1, 8))
    z_mm = GRID.z_mm[::-1]
    return assemble(
        [Strip(z_mm[k : k + 1], GRID.theta_rad, ones, ones, ones > 0, ones, values[k]) for k in range(3)],
        Outward(),
        OCT,
    )


def test_diagnostics_of_strips_are_told_by_ascending_z() -> None:
    panorama = assembled({"focus": 1.0}, {"focus": 2.0}, {"focus": 3.0})
    np.testing.assert_array_equal(panorama.per_frame["focus"].values, [3.0, 2.0, 1.0])
    np.testing.assert_array_equal(panorama.per_frame["slice_index"].values, [2, 1, 0])


@pytest.mark.parametrize("later", [{}, {"sharpness": 1.0}])
def test_every_frame_tells_the_same_figures(later: dict[str, float]) -> None:
    with pytest.raises(EndoctError, match="gives other diagnostics of frame 1 than of the first"):
        assembled({"focus": 1.0}, later, {"focus": 1.0})


@pytest.mark.parametrize("name", ["valid", "z_mm", "theta", "residual_mm"])
def test_figures_of_frames_take_nobodys_name(name: str) -> None:
    with pytest.raises(EndoctError, match=f"names that are taken; found {name}"):
        assembled(*({name: 1.0},) * 3)
