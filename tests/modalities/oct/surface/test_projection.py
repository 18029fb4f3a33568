"""The projection along depth."""

import numpy as np

from endoct.modalities.oct.surface.wall import brightest, maximum_intensity


def test_the_maximum_is_taken_literally() -> None:
    image = np.zeros((3, 10), np.float32)
    image[:, 2], image[0, 5], image[1, 7], image[2, 9] = 9, 3, 4, 5
    np.testing.assert_array_equal(brightest(image, np.array([3, 3, 3])), [5, 7, 9])
    np.testing.assert_array_equal(maximum_intensity(image, np.array([3, 3, 3]), np.zeros(10, bool)), [3, 4, 5])
