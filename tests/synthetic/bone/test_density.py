"""How dense bone is inside: as drawn, the same for all instruments, and nothing that truth calls a cell."""

from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from endoct.synthetic.bone.density import NODES, STEP_MM, BoneDensity, density_of
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw
from endoct.synthetic.sample.parameters import Sample

LENGTHS_MM = tuple(n * STEP_MM for n in NODES)


def _sample(seed: int = 3, **density: Any) -> Sample:
    sample = draw("learning", seed, ranges={"bore.bone": ("network",)})
    assert sample.bore.density is not None
    usual = {"contrast": 0.15, "scale_mm": 0.6, "channel_mm": 0.3, "channels_per_mm2": 0.06}
    bone = sample.bore.density.model_copy(update=usual | density)
    return sample.model_copy(update={"bore": sample.bore.model_copy(update={"density": bone})})


def _of(sample: Sample) -> BoneDensity:
    density = density_of(sample)
    assert density is not None
    return density


def test_density_varies_by_as_much_and_as_far_as_drawn() -> None:
    bone = _of(_sample(channel_mm=0.0)).on(Lattice.around_bore(30.0, 4.0, STEP_MM)) - 1
    assert np.mean(bone) == pytest.approx(0, abs=0.02)
    assert np.std(bone) == pytest.approx(0.15, rel=0.05)
    along = [float(np.mean(bone[lag:] * bone[: len(bone) - lag])) for lag in range(12)]
    length_mm = STEP_MM * np.interp(-np.exp(-1), -np.array(along) / along[0], np.arange(12))
    assert length_mm == pytest.approx(0.6, rel=0.05)


def test_channels_are_as_wide_and_as_many_as_drawn() -> None:
    z, x = (values.astype(np.float32) for values in np.mgrid[0 : LENGTHS_MM[0] : 0.05, 0 : LENGTHS_MM[2] : 0.05])
    cuts = np.arange(0.0, LENGTHS_MM[1], 2.0)
    count, across = 0, []
    for seed in range(6):
        density = _of(_sample(seed))
        for y in cuts:
            parts, n = ndimage.label(density.at(x, np.full_like(x, y), z) < 0.3)
            count += n
            across += (2 * np.sqrt(np.bincount(parts.ravel())[1:] * 0.05**2 / np.pi)).tolist()
    assert count / (6 * len(cuts) * LENGTHS_MM[0] * LENGTHS_MM[2]) == pytest.approx(0.06, rel=0.25)
    assert np.median(across) == pytest.approx(0.3, rel=0.2)


def test_one_place_has_one_density_however_it_is_asked_for() -> None:
    density, lattice = _of(_sample()), Lattice.around_bore(3.0, 2.0, 0.13)
    np.testing.assert_allclose(density.at(*lattice.places()), density.on(lattice), atol=2e-3)
    x, y, z = (np.full(1, value, np.float32) for value in (0.4, -1.2, -0.3))
    np.testing.assert_allclose(density.at(x, y, z), density.at(x, y, z + np.float32(LENGTHS_MM[0])), atol=1e-3)


def test_neither_density_nor_channels_move_the_wall_or_its_cells() -> None:
    even, uneven = (
        build_wall(_sample(channel_mm=width, contrast=contrast)) for width, contrast in ((0, 0), (0.4, 0.2))
    )
    np.testing.assert_array_equal(even.relief_mm, uneven.relief_mm)
    np.testing.assert_array_equal(even.cell, uneven.cell)
    np.testing.assert_array_equal(even.cell_id, uneven.cell_id)
    assert np.any(even.albedo != uneven.albedo)


def test_the_wall_is_darker_where_bone_is_less_dense() -> None:
    sample = _sample()
    even, wall = (build_wall(one) for one in (_sample(contrast=0.0, channel_mm=0.0), sample))
    row, column = np.divmod(np.arange(0, wall.albedo.size, 37), wall.albedo.shape[1])
    radius = wall.radius_mm + wall.relief_mm[row, column]
    theta, z = wall.dtheta_rad * column, (wall.dz_mm * row).astype(np.float32)
    x, y = (radius * np.cos(theta)).astype(np.float32), (radius * np.sin(theta)).astype(np.float32)
    change = wall.albedo[row, column] / even.albedo[row, column] - 1
    assert sample.bore.density is not None
    expected = sample.bore.density.albedo * (_of(sample).at(x, y, z) - 1)
    away = np.abs(np.gradient(wall.relief_mm, axis=1)[row, column]) < 0.005  # from steps, which are smoothed
    assert np.corrcoef(change[away], expected[away])[0, 1] > 0.97
    assert np.std(change[away]) == pytest.approx(np.std(expected[away]), rel=0.1)


def test_what_is_varied_leaves_the_rest_of_the_bone() -> None:
    plain = _of(_sample())
    denser = _of(_sample(contrast=0.1))
    np.testing.assert_array_equal(plain.channel_mm2, denser.channel_mm2)
    np.testing.assert_allclose((plain.bone - 1) / 0.15, (denser.bone - 1) / 0.1, atol=1e-5)
    more = _of(_sample(channels_per_mm2=0.1))
    np.testing.assert_array_equal(plain.bone, more.bone)


def test_drilled_phantoms_and_data_sets_are_even() -> None:
    assert density_of(draw("quick", 1)) is None
    assert density_of(draw("hard", 1)) is None
    assert density_of(draw("learning", 1, ranges={"bore.bone": ("network",)})) is None
    assert density_of(draw("mastoid", 1)) is not None
