"""Bright spots and lines narrower than a disc, taken away."""

import cv2
import numpy as np
import pytest

from endoct.modalities.endoscope.mirror.disc_opening import opened


@pytest.mark.parametrize("size", [1, 3, 5, 9, 19, 43])
@pytest.mark.parametrize("shape", [(40, 57), (7, 90), (64, 5)])
def test_the_opening_is_that_of_opencv(size: int, shape: tuple[int, int]) -> None:
    image = np.random.default_rng(size).normal(size=shape).astype(np.float32)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    np.testing.assert_array_equal(opened(image, size), cv2.morphologyEx(image, cv2.MORPH_OPEN, disc))
