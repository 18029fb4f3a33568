"""Bringing images onto other rows and columns, and distances to outlines, against what libraries say of the same."""

from dataclasses import replace

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.fusion.geometry.alignment import ALL_ORIENTATIONS, Alignment, Bend
from endoct.fusion.geometry.placement import (
    IN_PLACE,
    Placement,
    Sampling,
    check_same_bore,
    column_weights,
    common_grid,
    resample,
    rolled,
    row_weights,
)
from endoct.stitching.grid import SurfaceGrid


@pytest.mark.parametrize(("n_rows", "n_columns"), [(9, 16), (60, 96), (31, 40)])
def test_resampling_is_what_the_matrices_say_of_what_was_observed(n_rows: int, n_columns: int) -> None:
    random = np.random.default_rng(1)
    image, valid = random.normal(size=(30, 48)).astype(np.float32), random.random((30, 48)) < 0.7
    image[~valid] = np.nan
    from_mm, to_mm = 0.1 * np.arange(30.0), np.linspace(-0.2, 3.1, n_rows)
    rows = row_weights(from_mm, 0.1, to_mm, float(to_mm[1] - to_mm[0]))
    columns = column_weights(48, 48 / n_columns * np.arange(n_columns) - 0.3, 48 / n_columns)
    share = rows @ (valid.astype(float) @ columns.T)
    total = rows @ (np.where(valid, image, 0).astype(float) @ columns.T)
    found, observed = resample(image, valid, rows, columns)
    clear = np.abs(share - 0.5) > 1e-5
    assert (observed == (share > 0.5))[clear].all()
    assert found[observed] == pytest.approx((total / np.where(observed, share, 1))[observed], abs=1e-5)
    assert not found[~observed].any()


@pytest.mark.parametrize(("mirrored", "z_reversed"), ALL_ORIENTATIONS)
def test_a_side_moved_by_whole_samples_is_rolled_and_turned_round(mirrored: bool, z_reversed: bool) -> None:
    rng, n = np.random.default_rng(2), 64
    b = SurfaceGrid.full_circle(20, n, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
    a = SurfaceGrid.full_circle(20, n, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
    image, valid, mask = rng.normal(size=(20, n)), rng.random((20, n)) < 0.8, rng.random((20, n)) < 0.3
    where = Alignment(2 * np.pi * 7 / n, 0.3 + (1.9 if z_reversed else 0.0), 1.0, mirrored, z_reversed)
    rows, columns = np.arange(20) - 3, np.arange(n) - 7
    rows, columns = 19 - rows if z_reversed else rows, (-columns if mirrored else columns) % n
    inside = ((rows >= 0) & (rows < 20))[:, None]
    expected = valid[np.clip(rows, 0, 19)][:, columns] & inside
    placement = Placement.averaging(b, where, a)
    found, observed = placement.image(image.astype(np.float32), valid)
    np.testing.assert_array_equal(observed, expected)
    of_b = image[np.clip(rows, 0, 19)][:, columns]
    np.testing.assert_allclose(found[expected], of_b[expected], atol=1e-5)
    assert np.isnan(placement.known(image.astype(np.float32), valid)[~expected]).all()
    cells, observed = placement.mask(mask, valid)
    np.testing.assert_array_equal(cells, mask[np.clip(rows, 0, 19)][:, columns] & expected)
    np.testing.assert_array_equal(observed, expected)


def test_an_outline_between_wide_rows_is_interpolated_and_between_close_ones_not() -> None:
    """A slanted edge goes on between rows 0.2 mm apart; where new rows are as high, half of a sample decides."""
    wide = SurfaceGrid.full_circle(10, 128, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
    fine = SurfaceGrid.full_circle(91, 128, z0_mm=0.0, dz_mm=0.02, radius_mm=1.25)
    column = np.arange(128)

    def slanted(z_mm: np.ndarray) -> np.ndarray:
        edge = 40 + 3 * z_mm[:, None] / 0.2
        return np.asarray(np.mod(column - edge + 45, 128) < 45)

    everywhere = np.ones((10, 128), np.bool_)
    cells, observed = Placement.averaging(wide, IN_PLACE, fine).mask(slanted(wide.z_mm), everywhere)
    assert observed.all()
    nearest = slanted(wide.z_mm)[np.round(fine.z_mm / 0.2).astype(int)]
    wrong, left_alone = ((mask != slanted(fine.z_mm))[10:80].mean() for mask in (cells, nearest))
    assert wrong < 0.6 * left_alone
    speckled = np.random.default_rng(3).random((91, 128)) < 0.5
    seen = np.random.default_rng(4).random((91, 128)) < 0.9
    placement = Placement.averaging(fine, IN_PLACE, wide)
    share, known = placement.image(speckled.astype(np.float32), seen)
    halved, observed = placement.mask(speckled, seen)
    np.testing.assert_array_equal(halved, (share >= 0.5) & known)
    np.testing.assert_array_equal(observed, known)


@pytest.mark.parametrize(("dz_mm", "expected_mm"), [(None, 0.05), (0.03, 0.03)])
def test_a_common_grid_covers_both_sides_on_rows_of_a(dz_mm: float | None, expected_mm: float) -> None:
    a = SurfaceGrid.full_circle(61, 512, z0_mm=0.5, dz_mm=0.05, radius_mm=1.25)
    b = SurfaceGrid.full_circle(20, 512, z0_mm=0.0, dz_mm=0.2, radius_mm=1.25)
    grid = common_grid(
        Sampling(a, IN_PLACE), Sampling(b, Alignment(1.0, 4.01, 0.98, z_reversed=True)), dz_mm=dz_mm, n_theta=256
    )
    assert grid.dz_mm == pytest.approx(expected_mm)
    assert grid.n_theta == 256
    steps = (grid.z_mm - 0.5) / expected_mm
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    low, high = 4.01 - 0.98 * 3.8, 4.01  # of B
    assert low <= grid.z_mm[0] < low + expected_mm
    assert high - expected_mm < grid.z_mm[-1] <= high
    finest = common_grid(Sampling(replace(a, dz_mm=0.001), IN_PLACE), Sampling(b, IN_PLACE), dz_mm=None, n_theta=64)
    assert finest.dz_mm == pytest.approx(0.02)


def test_diameters_of_one_bore_differ_by_little() -> None:
    assert check_same_bore(1.25, 1.25 + 1e-9) == ()
    for other in (1.25 * 1.029, 1.25 * 0.972):
        (note,) = check_same_bore(1.25, other)
        assert "2.5 mm for the other" in note
    for other in (1.25 * 1.032, 1.25 * 0.969):
        with pytest.raises(EndoctError, match="bores of different diameters"):
            check_same_bore(1.25, other)


def test_rows_are_rolled_each_by_its_own_columns_around_the_circle() -> None:
    image = np.arange(8, dtype=np.float32).reshape(2, 4)
    valid = np.array([[1, 1, 1, 1], [1, 1, 1, 0]], np.bool_)
    new, observed = rolled(image, valid, np.array([1.0, -0.25]))
    assert new[0].tolist() == [3, 0, 1, 2]
    assert observed.tolist() == [[True] * 4, [True, True, False, False]]
    assert new[1].tolist() == [4.25, 5.25, 0, 0]
    assert rolled(image, valid, np.array([0.0, 5.0]))[1].tolist() == [[True] * 4, [False, True, True, True]]


@pytest.mark.parametrize(("mirrored", "z_reversed"), ALL_ORIENTATIONS)
def test_a_bent_side_lies_where_its_alignment_puts_each_sample(mirrored: bool, z_reversed: bool) -> None:
    """Every sample of B, moved by whole rows and columns, on a grid that has them; a lost row stays unknown."""
    rng, n = np.random.default_rng(2), 64
    b = SurfaceGrid.full_circle(20, n, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
    common = SurfaceGrid.full_circle(40, n, z0_mm=-1.0, dz_mm=0.1, radius_mm=1.25)
    image = rng.normal(size=b.shape).astype(np.float32)
    turn = 2 * np.pi / n
    z_shift_mm = 1.9 if z_reversed else 0.0
    bend = Bend((0.94, 0.96), (0.0, 0.1), (0.0, 3 * turn), (0.0, 0.0), (0.0, 0.0))
    where = Alignment(5 * turn, z_shift_mm, 1.0, mirrored, z_reversed, bend=bend)
    placement, whole = Placement(b, where, common, 0.0), np.ones(b.shape, np.bool_)
    placed, known = placement.image(image, whole)
    assert np.array_equal(placement.known(image, whole), np.where(known, placed, np.nan), equal_nan=True)
    z_mm = where.z_to_a(b.z_mm)[:, None]
    row = np.rint(common.row_of(z_mm)).astype(int)
    column = np.rint(common.column_of(where.theta_to_a(b.theta_rad, b.z_mm[:, None]))).astype(int) % n
    assert known[row, column].all()
    assert placed[row, column] == pytest.approx(image, abs=1e-4)
    assert known.any(axis=1).sum() == 20
