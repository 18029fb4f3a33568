"""Denoising shrinks noise, and leaves alone what has none; a column's highest peaks are its points."""

import numpy as np
import pytest
import pywt

from endoct.modalities.oct.face.points import POINTS_PER_COLUMN, _peaks, wavelet_denoise


def test_denoising_shrinks_noise() -> None:
    noise = np.random.default_rng(1).normal(size=(64, 96)).astype(np.float32)
    assert wavelet_denoise(noise, 1.0).std() < 0.6 * noise.std()


@pytest.mark.parametrize("sigmas", [0.0, 1.0])
def test_what_has_no_noise_stays(sigmas: float) -> None:
    dark = np.zeros((64, 96), np.float32)
    dark[:, 40:44] = 200.0 * (sigmas == 0)
    np.testing.assert_array_equal(wavelet_denoise(dark, sigmas), dark)


@pytest.mark.parametrize("shape", [(64, 96), (37, 91), (256, 510)])
def test_it_is_the_transform_of_pywavelets(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(2).gamma(2.0, 10.0, shape).astype(np.float32)
    low, *details = pywt.wavedec2(image, "db2", mode="periodization", level=2)
    threshold = 1.5 * float(np.median(np.abs(details[-1][2]))) / 0.6745
    shrunk = [tuple(pywt.threshold(band, threshold, mode="soft") for band in level) for level in details]
    expected = pywt.waverec2([low, *shrunk], "db2", mode="periodization")[: shape[0], : shape[1]]
    np.testing.assert_array_equal(wavelet_denoise(image, 1.5), expected)


def test_a_columns_highest_peaks_are_its_points() -> None:
    heights = np.array([5, 12, 3, 9, 4, 11, 6, 10, 8, 7, 13, 2], np.float32)
    ridge = np.zeros((3, 40), np.float32)
    ridge[0, 2:38:3] = heights  # rows 2, 5, 8 …
    ridge[1, 4:6] = 6.0  # one that is flat
    ridge[1, 9], ridge[1, 20], ridge[1, [0, 39]] = 1.0, 7.0, 9.0  # weak, in the dark, and at the ends
    ridge[2, 10:13] = 4.0, 8.0, 5.0
    bright = np.ones(ridge.shape, np.bool_)
    bright[1, 20] = False
    column, row, height = _peaks(ridge, bright, np.float32(1.5))
    highest = np.sort(np.argsort(-heights)[:POINTS_PER_COLUMN])
    assert column.tolist() == [0] * POINTS_PER_COLUMN + [1, 2]
    assert row.tolist() == [*(2 + 3 * highest).tolist(), 5, 11]
    assert height.tolist() == [*heights[highest].tolist(), 6.0, 8.0]
