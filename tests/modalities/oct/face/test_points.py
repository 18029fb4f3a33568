"""Denoising shrinks noise, and leaves alone what has none."""

import numpy as np
import pytest
import pywt

from endoct.modalities.oct.face.points import wavelet_denoise


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
