"""Depth of cells by what a side that sees light shows of them alone."""

from dataclasses import replace

import numpy as np
import pytest
from wall_sides import GRID, disc

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.distance import signed_distance
from endoct.fusion.evidence.light_alone import (
    DARKEST,
    DEEPEST_MM,
    SHALLOWEST_MM,
    depth_by_light,
    depth_of_side,
    light_features,
)
from endoct.fusion.evidence.side import Side
from endoct.stitching.panorama import Panorama

SAMPLE_MM = GRID.dz_mm, GRID.dtheta_mm
NOWHERE = np.full(GRID.shape, np.nan, np.float32)
OVER_SEAM, INSIDE = disc(2.5, 0.05, 0.3), disc(2.5, 3.0, 0.3)
SMALL = disc(1.5, 5.0, 0.1)


def as_dark_as(level: float, cells: Mask = OVER_SEAM) -> Image:
    """Return darkness of ``cells``, and of nothing else, with a little noise."""
    noise = np.random.default_rng(1).normal(0, 0.01, GRID.shape)
    return (np.where(cells, level, 0.0) + noise).astype(np.float32)


def test_what_tells_the_depth_is_known_by_hand() -> None:
    cells = OVER_SEAM | SMALL
    dark = np.where(OVER_SEAM, np.float32(0.7), np.float32(0.2))
    half = cells & (GRID.z_mm[:, None] < 2.5)
    parallax_mm = np.where(half, np.float32(0.4), NOWHERE)
    given = light_features(SAMPLE_MM, cells, dark, parallax_mm, np.where(half, np.float32(0.05), NOWHERE))
    assert given.shape == (13, np.count_nonzero(cells))
    assert given.dtype == np.float32
    assert np.isfinite(given).all()
    large, known = OVER_SEAM[cells], half[cells]
    assert np.array_equal(given[0], dark[cells])
    # means reach into another cell nowhere: the two are far apart
    for mean in given[1:3]:
        np.testing.assert_allclose(mean, dark[cells], rtol=1e-5)
    outline_mm = signed_distance(cells, SAMPLE_MM, 0.3)[cells]
    np.testing.assert_allclose(given[3], outline_mm)
    np.testing.assert_allclose(given[4], np.where(known, 0.4, 0), rtol=1e-6)
    np.testing.assert_allclose(given[5], np.where(known, 0.5, 0), rtol=1e-6)
    np.testing.assert_allclose(given[6][known], 0.4, rtol=1e-5)
    assert (given[6][large][-20:] == 0).all(), "far from all that is known, a mean is not"
    assert given[7][large] == pytest.approx(0.3, rel=0.02)
    assert given[7][~large] == pytest.approx(0.1, rel=0.05)
    for quantile in given[8:10]:
        np.testing.assert_allclose(quantile, np.where(large, 0.7, 0.2), rtol=1e-6)
    for quantile in given[10:12]:
        np.testing.assert_allclose(quantile, 0.4, rtol=1e-6)
    assert given[12][large] == pytest.approx(0.5, abs=0.04)
    assert (given[12][~large] == 1).all()


def test_the_tenth_darkest_sample_of_a_cell_counts() -> None:
    dark = np.where(disc(2.5, 3.0, 0.15), np.float32(1), np.float32(0.3))  # a quarter of the cell
    given = light_features(SAMPLE_MM, INSIDE, dark, NOWHERE, NOWHERE)
    assert (given[8] == np.float32(0.3)).all()
    assert (given[9] == np.float32(1)).all()
    assert not given[[4, 5, 6, 10, 11, 12]].any()


def test_darker_cells_are_deeper_and_none_but_cells_have_a_depth() -> None:
    depths = [depth_by_light(SAMPLE_MM, OVER_SEAM, as_dark_as(level), NOWHERE, NOWHERE) for level in (0.1, 0.7, 1.2)]
    medians = [float(np.median(depth[OVER_SEAM])) for depth, _ in depths]
    assert medians[0] + 0.1 < medians[1] < medians[2] - 0.1
    for depth_mm, error_mm in depths:
        assert np.array_equal(np.isfinite(depth_mm), OVER_SEAM)
        assert np.array_equal(np.isfinite(error_mm), OVER_SEAM)
        assert depth_mm[OVER_SEAM].min() >= np.float32(SHALLOWEST_MM)
        assert depth_mm[OVER_SEAM].max() <= DEEPEST_MM
        assert error_mm[OVER_SEAM].min() >= np.float32(0.03)


def test_what_is_darker_or_deeper_than_was_learned_says_no_more() -> None:
    there = np.full(GRID.shape, 0.05, np.float32)
    pairs = [(DARKEST, DARKEST + 3, 0.5, 0.5), (0.7, 0.7, DEEPEST_MM, DEEPEST_MM + 2)]
    for dark, darker, near, far in pairs:
        cells = [
            depth_by_light(
                SAMPLE_MM, INSIDE, np.where(INSIDE, np.float32(level), 0), np.full(GRID.shape, deep, np.float32), there
            )
            for level, deep in ((dark, near), (darker, far))
        ]
        np.testing.assert_allclose(*(depth[INSIDE] for depth, _ in cells), rtol=1e-5)


def test_where_the_darkness_is_not_known_nothing_is() -> None:
    part = OVER_SEAM & (GRID.z_mm[:, None] > 2.6)
    dark = np.where(part, NOWHERE, as_dark_as(0.8))
    depth_mm, error_mm = depth_by_light(SAMPLE_MM, OVER_SEAM, dark, NOWHERE, NOWHERE)
    for of in (depth_mm, error_mm):
        assert np.array_equal(np.isfinite(of), OVER_SEAM & ~part)
    nothing = depth_by_light(SAMPLE_MM, np.zeros(GRID.shape, np.bool_), as_dark_as(0.8), NOWHERE, NOWHERE)
    assert all(np.isnan(of).all() for of in nothing)


def test_good_parallax_is_followed_and_makes_surer() -> None:
    cells, dark = INSIDE, as_dark_as(0.6, INSIDE)
    errors = np.full(GRID.shape, 0.02, np.float32)
    by_both = [
        depth_by_light(SAMPLE_MM, cells, dark, np.full(GRID.shape, of, np.float32), errors) for of in (0.15, 0.5)
    ]
    alone = depth_by_light(SAMPLE_MM, cells, dark, NOWHERE, NOWHERE)
    shallow, deep = (float(np.median(depth[cells])) for depth, _ in by_both)
    assert deep - shallow > 0.2
    assert np.median(by_both[0][1][cells]) < np.median(alone[1][cells])


def test_a_cell_over_the_seam_is_as_deep_as_anywhere() -> None:
    turn = GRID.n_theta // 2
    dark, here = as_dark_as(0.8), np.where(OVER_SEAM & (GRID.z_mm[:, None] < 2.5), np.float32(0.5), NOWHERE)
    given = dark, here, np.where(np.isfinite(here), np.float32(0.03), NOWHERE)
    plain = depth_by_light(SAMPLE_MM, OVER_SEAM, *given)
    turned = depth_by_light(SAMPLE_MM, np.roll(OVER_SEAM, turn, 1), *(np.roll(of, turn, 1) for of in given))
    for of, rolled in zip(plain, turned, strict=True):
        np.testing.assert_allclose(np.roll(of, turn, 1), rolled, atol=1e-5)


def test_a_side_has_its_plain_wall_by_parallax() -> None:
    cells, dark, blind = INSIDE, as_dark_as(0.8, INSIDE), INSIDE & (GRID.theta_rad > 3.2)
    known = ~blind & (GRID.theta_rad > 1.0)
    rng = np.random.default_rng(2)
    depth_mm = np.where(known, np.where(cells, 0.4, 0.0) + rng.normal(0, 0.004, GRID.shape), np.nan).astype(np.float32)
    panorama = Panorama(
        grid=GRID,
        intensity=np.exp(-dark),
        depth_mm=None,
        valid=~blind,
        weight=np.ones(GRID.shape, np.float32),
        modality="endoscope",
        handedness_known=True,
        travel_known=True,
        parallax_depth_mm=depth_mm,
        parallax_error_mm=np.where(known, np.float32(0.02), np.float32(np.nan)),
    )
    side = Side("endoscope", panorama)
    relief = side.parallax
    assert relief is not None
    relief_mm, error_mm = depth_of_side(side, cells)
    cells = cells & ~blind
    plain = known & ~cells
    assert np.array_equal(np.isfinite(relief_mm), known | cells)
    assert np.median(np.abs(relief_mm[plain])) < 0.01
    assert (error_mm[plain] == np.float32(0.02)).all()
    by_cells = depth_by_light(SAMPLE_MM, cells, side.contrast("dark").values, relief.relief_mm, relief.error_mm)
    for of, of_cells in zip((relief_mm, error_mm), by_cells, strict=True):
        assert np.array_equal(of[cells], of_cells[cells])
    without = Side("endoscope", replace(panorama, parallax_depth_mm=None, parallax_error_mm=None))
    assert np.array_equal(np.isfinite(depth_of_side(without, cells | blind)[0]), cells)
