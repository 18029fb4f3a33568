"""Frames kept without the colours that nobody looks at."""

import numpy as np
import pytest

from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.light import (
    full_scale,
    full_scale_of,
    green_frames,
    least_saturated,
    log_light,
    reduced_light,
)
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition


class Colours:
    """A stream of frames in colour, or in grey, that counts how often each is read; red needs one bit more."""

    def __init__(self, *, grey: bool) -> None:
        self.read, self.grey = [0] * 3, grey

    @property
    def acquisition(self) -> EndoscopeAcquisition:
        pytest.fail("what is kept of a frame does not depend on the sidecar")

    def __len__(self) -> int:
        return len(self.read)

    def __getitem__(self, index: int) -> Frame:
        self.read[index] += 1
        samples = np.full((40, 50, 3), (2000, 900 + index, 7), np.uint16)
        return Frame(index, samples[..., 1] if self.grey else samples, 0.2 * index)


@pytest.mark.parametrize("grey", [False, True])
def test_a_frame_is_read_once_and_its_green_kept_with_the_full_scale_of_all(grey: bool) -> None:
    stream = Colours(grey=grey)
    with green_frames(stream) as once:
        for index in (2, 0, 2, 1, 0):
            frame = once[index]
            assert (frame.index, frame.z_mm) == (index, 0.2 * index)
            assert full_scale_of(frame) == full_scale_of(Colours(grey=grey)[index]) == (1023 if grey else 4095)
            np.testing.assert_array_equal(frame.samples, np.full((40, 50), 900 + index, np.uint16))
    assert stream.read == [1, 1, 1]


@pytest.mark.parametrize(
    ("largest", "dtype", "scale"),
    [
        (255, np.uint8, 255), (3, np.uint8, 255), (256, np.uint16, 1023), (1023, np.uint16, 1023),
        (1024, np.uint16, 4095), (4096, np.uint16, 16383), (16384, np.uint16, 65535), (0.7, np.float32, 1),
        (2.5, np.float32, 2.5),
    ],
)  # fmt: skip
def test_full_scale_is_that_of_the_fewest_bits(largest: float, dtype: type, scale: float) -> None:
    samples = np.array([[0, largest]]).astype(dtype)
    assert full_scale(samples) == scale
    # 0.99 of 255, 1023, 4095, …, to the next whole number; of floats as it is
    least = {255: 253, 1023: 1013, 4095: 4055, 16383: 16220, 65535: 64880, 1: 0.99, 2.5: 2.475}
    assert least_saturated(samples.dtype, scale) == pytest.approx(least[scale])


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_light_is_the_mean_of_so_many_pixels_with_the_share_that_is_saturated(factor: int) -> None:
    rng = np.random.default_rng(factor)
    samples = rng.integers(0, 250, (7, 11, 3)).astype(np.uint8)
    samples[:2, :3, 1] = 254
    light, share = reduced_light(samples, 255.0, factor)
    rows, columns = 7 // factor, 11 // factor
    plane = samples[: rows * factor, : columns * factor, 1].reshape(rows, factor, columns, factor)
    np.testing.assert_allclose(light, plane.mean(axis=(1, 3)) / 255, rtol=1e-5)
    assert share is not None
    np.testing.assert_allclose(share, (plane >= 253).mean(axis=(1, 3)), rtol=1e-6)
    dim, none = reduced_light(samples[3:], 255.0, factor)
    assert none is None
    assert dim.shape == (4 // factor, columns)


def test_the_darkest_has_a_logarithm() -> None:
    np.testing.assert_allclose(
        log_light(np.array([[1.0, 0.002, 0.0]], np.float32)), [[0, np.log(0.002), np.log(0.002)]]
    )
