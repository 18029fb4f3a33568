"""Light that bounces, shadows, and the gain of the camera."""

import numpy as np
import pytest

from endoct.base.arrays import Image
from endoct.synthetic.bone.wall import WallMaps, build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.endoscope.camera import noise_free
from endoct.synthetic.endoscope.cone import FrameView
from endoct.synthetic.endoscope.facets import RAYS, facets_of
from endoct.synthetic.endoscope.irradiance import EVERY_COLUMN, shade_of
from endoct.synthetic.endoscope.lighting import lighting_of
from endoct.synthetic.endoscope.sight import view

RADIUS_MM, DZ_MM = 1.25, 0.02


def wall_of(relief_mm: Image) -> WallMaps:
    zero = np.zeros_like(relief_mm)
    return WallMaps(
        radius_mm=RADIUS_MM, dz_mm=DZ_MM, relief_mm=relief_mm, cell=relief_mm > 0.01,
        cell_id=(relief_mm > 0.01).astype(np.int32), albedo=zero + 1, rim=zero, slope_z=zero, slope_theta=zero,
        wet=zero,
    )  # fmt: skip


def test_facets_of_a_plain_bore_see_it_as_a_cylinder_sees_itself() -> None:
    """The rest leaves through the ends: (x² + 2)/(2√(x² + 4)) − x/2 of it through one at x radii."""
    facets = facets_of(wall_of(np.zeros((300, 1024), np.float32)))
    leaves = (facets.seen == len(facets.grid)).mean(axis=1)
    inner = np.abs(facets.z_mm - 3) < 2
    x = np.stack([facets.z_mm, 6 - facets.z_mm])[:, inner] / RADIUS_MM
    ends = ((x * x + 2) / (2 * np.sqrt(x * x + 4)) - x / 2).sum(axis=0)
    # a ray more or less through either end
    assert np.abs(leaves[inner] - ends).max() < 2 / RAYS
    assert leaves[inner].mean() == pytest.approx(ends.mean(), abs=0.01)
    assert not (facets.seen == np.arange(len(facets.grid))[:, None]).any()


def test_a_pit_hides_its_floor_from_slanted_light_and_shows_it_to_the_rest_of_itself() -> None:
    relief = np.zeros((300, 1024), np.float32)
    relief[140:160, 100:180] = 0.4  # 0.4 mm along the bore
    wall = wall_of(relief)
    before, behind = np.moveaxis(shade_of(wall), -1, 0)
    column = 140 // EVERY_COLUMN
    # a ray along dz/dr of the distance over the depth grazes the edge
    for row in (142, 150, 157):
        assert before[row, column] == pytest.approx(0.4 / (DZ_MM * (row - 139)), rel=0.1)
        assert behind[row, column] == pytest.approx(0.4 / (DZ_MM * (160 - row)), rel=0.1)
    assert not before[100:139].any()
    facets = facets_of(wall)
    floor = (facets.radius_mm > RADIUS_MM + 0.39) & (np.abs(facets.z_mm - 3) < 0.1)
    assert floor.any()
    deep = np.append(facets.radius_mm, 0)[facets.seen[floor]] > RADIUS_MM + 0.02
    # most of what a floor sees is the pit's own side
    assert 0.3 < deep.mean() < 0.9


@pytest.mark.parametrize("saturated", [0.003, 0.02])
def test_the_gain_saturates_the_share_of_the_annulus_that_a_person_lets(saturated: float) -> None:
    sample = draw("learning", 3, ranges={"endoscope.saturated": (saturated, saturated)})
    wall = build_wall(sample).maps()
    lighting = lighting_of(sample, wall)
    seen = []
    for index in range(3):
        frame = noise_free(sample, wall, lighting, index)
        brightest = frame.reshape(*frame.shape[:2], -1).max(axis=2)
        seen.append(brightest.ravel()[view(FrameView.of(sample.endoscope, index, wall.radius_mm)).pixel])
    # defocus takes the tops of fine highlights
    assert np.mean(np.concatenate(seen) == 255) == pytest.approx(saturated, rel=0.6)
