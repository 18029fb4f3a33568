"""Evidence: the wall found between the cells, in depth and in light; resampling that knows what was seen."""

from collections.abc import Callable

import numpy as np
import pytest
from bore_pairs import Pair
from hypothesis import given
from hypothesis import strategies as st

from endoct.fusion.evidence.evidence import Evidence, correlation, on_grid, prepare
from endoct.fusion.evidence.relief import relief
from endoct.fusion.geometry.placement import column_weights, resample, row_weights

THETA = 2 * np.pi / 512 * np.arange(512)


@pytest.mark.parametrize("slope", [0.0, 0.02])
def test_the_wall_is_found_where_most_of_a_slice_is_cells(slope: float) -> None:
    rng = np.random.default_rng(0)
    z = 0.2 * np.arange(40)
    wall = 0.2 * np.cos(THETA - 1)[np.newaxis] + 0.02 * np.cos(2 * THETA) + 0.05 * np.sin(z / 3)[:, np.newaxis]
    wall += slope * z[:, np.newaxis]
    cells = np.zeros((40, 512))
    cells[18:23, 40:460] = 0.06  # 82 % of these slices
    cells[5:9, 100:200] = 0.4
    depth = wall + cells + 0.005 * rng.normal(size=cells.shape)
    valid = np.ones(cells.shape, np.bool_)
    valid[30] = False
    depth[30] = np.nan
    found = relief(depth.astype(np.float32), valid, z)
    assert found.dtype == np.float32
    assert np.all(found[30] == 0)
    error = (found - cells)[valid]
    assert np.abs(np.median(error)) < 0.003
    assert np.abs(found[18:23, 60:440].mean() - 0.06) < 0.01
    assert np.percentile(np.abs(error), 99) < 0.03


@pytest.mark.parametrize("column", [1, 17, 256, 511])
def test_the_relief_does_not_know_the_seam(column: int) -> None:
    rng = np.random.default_rng(1)
    depth = (0.1 * np.cos(THETA) + 0.005 * rng.normal(size=(20, 512))).astype(np.float32)
    depth[8:12, 300:380] += 0.3
    valid, z = np.ones(depth.shape, np.bool_), 0.2 * np.arange(20)
    expected = np.roll(relief(depth, valid, z), column, axis=1)
    assert np.allclose(relief(np.roll(depth, column, axis=1), valid, z), expected, atol=2e-3)


def test_light_is_taken_off_and_cells_stay(panorama_of: Callable) -> None:
    z = 0.05 * np.arange(120)
    light = (1 + 0.5 * np.cos(THETA)) * (1 + 0.1 * np.sin(z / 2))[:, np.newaxis]
    image = 200 * light
    image[40:70, 100:220] *= np.exp(-0.8)
    found = prepare(panorama_of(image, dz_mm=0.05))
    assert found.kind == "darkness"
    assert np.abs(found.values[40:70, 100:220] - 0.8).max() < 0.1
    assert np.abs(np.delete(found.values, np.s_[40:70], axis=0)).max() < 0.1
    bright = prepare(panorama_of(1 / image, dz_mm=0.05), polarity="bright")
    assert bright.kind == "brightness"
    assert np.allclose(bright.values, found.values, atol=0.02)


def test_depth_is_used_whatever_the_modality_is_called(pair: Pair, panorama_of: Callable) -> None:
    assert prepare(pair.b).kind == "relief"
    assert prepare(pair.b, prefer="intensity").kind == "darkness"
    assert prepare(panorama_of(np.eye(64), dz_mm=0.1, modality="mask")).kind == "mask"


def test_linear_in_z_and_nothing_across_gaps() -> None:
    z = np.array([0.0, 0.2, 0.4, 1.0, 1.2])
    rows = row_weights(z, 0.2, np.array([-0.05, 0.1, 0.4, 0.7, 1.1, 1.25, 2.0]), 0.05)
    image = np.repeat((10 * z)[:, np.newaxis], 4, axis=1).astype(np.float32)
    values, seen = resample(image, np.ones(image.shape, np.bool_), rows, column_weights(4, np.arange(4.0), 1.0))
    assert seen[:, 0].tolist() == [True, True, True, False, True, True, False]
    assert values[[1, 2, 4], 0] == pytest.approx([1.0, 4.0, 11.0], abs=1e-5)


def test_finer_samples_are_averaged_and_invalid_ones_left_out() -> None:
    image = np.array([[1.0, 3.0, 5.0, 100.0]], np.float32)
    valid = np.array([[True, True, True, False]])
    rows = row_weights(np.zeros(1), 0.2, np.zeros(1), 0.2)
    values, seen = resample(image, valid, rows, column_weights(4, np.array([0.5, 2.5]), 2.0))
    assert seen.all()
    assert values[0] == pytest.approx([2.0, 5.0])


@given(columns=st.integers(8, 200), turns=st.floats(-3, 3))
def test_columns_go_round_the_circle(columns: int, turns: float) -> None:
    image = np.cos(2 * np.pi / 64 * np.arange(64))[np.newaxis].astype(np.float32)
    at = 64 / columns * np.arange(columns) + 64 * turns
    rows = row_weights(np.zeros(1), 0.2, np.zeros(1), 0.2)
    values, _ = resample(image, np.ones(image.shape, np.bool_), rows, column_weights(64, at, 64 / columns))
    averaged = np.sinc(max(1 / columns, 1 / 64))
    expected = np.cos(2 * np.pi * at / 64) * averaged
    assert np.abs(values[0] - expected).max() < 0.02


def test_a_common_grid_starts_at_theta_zero(pair: Pair) -> None:
    evidence = prepare(pair.a)
    found = on_grid(evidence, np.arange(0, 5, 0.1), 128)
    assert found.values.shape == (50, 128)
    assert found.theta0_rad == 0
    assert found.valid.all()


def test_evidence_correlates_as_far_as_it_says_something() -> None:
    """Where both are valid, within the bounds of their kinds; of what is the same everywhere, not at all."""

    def of(values: list[float], valid: list[bool]) -> Evidence:
        image = np.array([values], np.float32)
        return Evidence(image, np.array([valid]), np.zeros(1), 0.1, 0.0, 1.25, kind="relief")

    rising = of([0.0, 0.05, 0.1, 0.15, 9.0], [True] * 5)
    assert correlation(rising, of([0.0, 0.05, 0.1, 0.15, 0.15], [True] * 5)) == pytest.approx(1)
    assert correlation(rising, of([0.15, 0.1, 0.05, 0.0, 0.1], [True] * 4 + [False])) == pytest.approx(-1)
    for flat in (of([0.2, 0.3, 0.4, 0.5, 0.6], [True] * 5), of([0.1, 0, 0, 0, 0], [True] + [False] * 4)):
        assert correlation(rising, flat) == correlation(flat, rising) == 0
