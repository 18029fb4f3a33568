"""Bringing images onto other rows and columns, and distances to outlines, against what libraries say of the same."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from endoct.fusion.geometry.placement import FARTHEST_OUTLINE_MM, signed_distance
from endoct.fusion.geometry.resample import column_weights, resample, row_weights


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99, 1.0])
@pytest.mark.parametrize("shape", [(1, 7), (5, 1), (40, 64), (3, 200)])
def test_the_distance_to_an_outline_is_the_exact_one_around_the_circle(shape: tuple[int, int], share: float) -> None:
    mask, sample_mm = np.random.default_rng(0).random(shape) < share, (0.07, 0.031)
    thrice = np.tile(mask, (1, 3))
    inside, outside = (
        np.full(thrice.shape, np.inf) if of.all() else distance_transform_edt(of, sampling=sample_mm)
        for of in (thrice, ~thrice)
    )
    wanted = np.where(thrice, inside, -outside)[:, shape[1] : 2 * shape[1]]
    found = signed_distance(mask, sample_mm)
    assert found.dtype == np.float32
    assert found == pytest.approx(np.clip(wanted, -FARTHEST_OUTLINE_MM, FARTHEST_OUTLINE_MM), abs=1e-6)


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
