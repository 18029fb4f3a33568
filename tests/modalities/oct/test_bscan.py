"""B-scans averaged over sectors, and a pullback that is read once."""

import cv2
import numpy as np
import pytest

from endoct.modalities.contract import Frame
from endoct.modalities.oct.bscan import ReducedBscan, reduce_theta, reduced, reduced_pullback, sector_means
from endoct.modalities.oct.manifest import OctAcquisition
from endoct.modalities.oct.parameters import OctParameters


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize(("n_ascans", "n_columns"), [(1400, 205), (504, 256), (512, 256), (300, 299), (300, 50)])
def test_sectors_are_the_area_averages_of_opencv(dtype: type, n_ascans: int, n_columns: int) -> None:
    page = (np.random.default_rng(n_ascans).random((50, n_ascans)) * 250).astype(dtype)
    expected = cv2.resize(page, (n_columns, 50), interpolation=cv2.INTER_AREA).T
    for samples in (page.T, np.ascontiguousarray(page.T)):  # as files hold them, and the other way round
        if dtype is np.float32:  # sums in another order
            np.testing.assert_allclose(sector_means(samples, n_columns), expected, rtol=1e-6)
        else:
            np.testing.assert_array_equal(sector_means(samples, n_columns), expected)
        assert reduce_theta(samples, n_columns).dtype == np.float32


def test_signed_samples_are_averaged_as_floats() -> None:
    samples = np.array([[-3], [-2], [5], [6]], np.int16)
    np.testing.assert_array_equal(sector_means(samples, 2), np.array([[-2.5], [5.5]], np.float32))


class Counted:
    """A stream that counts how often each frame is read."""

    def __init__(self) -> None:
        self.read = [0] * 5

    @property
    def acquisition(self) -> OctAcquisition:
        pytest.fail("what is kept of a B-scan does not depend on the sidecar")

    def __len__(self) -> int:
        return len(self.read)

    def __getitem__(self, index: int) -> Frame:
        self.read[index] += 1
        return Frame(index=index, samples=np.full((300, 60), 100 * index, np.uint16), z_mm=float(index))


def test_a_pullback_is_read_once() -> None:
    stream = Counted()
    with reduced_pullback(stream, OctParameters(n_theta=64)) as once:
        stream.read = [0] * 5
        for index in (3, 0, 3, 4, 0, 1, 2):
            frame = once[index]
            assert isinstance(frame, ReducedBscan)
            assert (frame.index, frame.z_mm, frame.n_ascans) == (index, index, 300)
            np.testing.assert_array_equal(frame.samples, np.full((64, 60), 100 * index, np.uint16))
    assert stream.read == [1] * 5


def test_saturation_is_judged_before_averaging() -> None:
    samples = np.full((300, 60), 255, np.uint8)
    samples[::16] = 0
    first = reduced(Frame(index=0, samples=samples, z_mm=0.0), 64)
    assert first.saturated
    assert reduced(first, 64) is first
    assert not reduced(Frame(index=0, samples=samples // 2, z_mm=0.0), 64).saturated
