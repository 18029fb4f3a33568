"""Denoising shrinks noise, and leaves alone what has none."""

import numpy as np
import pytest

from endoct.modalities.oct.face.enhance import wavelet_denoise


def test_denoising_shrinks_noise() -> None:
    noise = np.random.default_rng(1).normal(size=(64, 96)).astype(np.float32)
    assert wavelet_denoise(noise, 1.0).std() < 0.6 * noise.std()


@pytest.mark.parametrize("sigmas", [0.0, 1.0])
def test_what_has_no_noise_stays(sigmas: float) -> None:
    dark = np.zeros((64, 96), np.float32)
    dark[:, 40:44] = 200.0 * (sigmas == 0)
    np.testing.assert_array_equal(wavelet_denoise(dark, sigmas), dark)
