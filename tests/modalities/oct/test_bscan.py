"""B-scans averaged over sectors, and a pullback that is read once."""

import cv2
import numpy as np
import pytest

from endoct.modalities.contract import Frame
from endoct.modalities.oct.bscan import (
    ReducedBscan,
    logarithmic,
    mean_between,
    reduce_theta,
    reduced,
    reduced_pullback,
    rows_from,
    sector_angles_rad,
    sector_means,
    share_brightening,
    varying,
)
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


def test_the_centre_of_a_sector_is_the_middle_of_its_ascans() -> None:
    # two A-scans a sector: 0.5, 2.5 … of 8; three sectors of 8/3 A-scans begin at 0
    assert sector_angles_rad(8, 4) == pytest.approx(np.array([0.5, 2.5, 4.5, 6.5]) * 2 * np.pi / 8)
    assert sector_angles_rad(8, 3) == pytest.approx((np.array([0, 8 / 3, 16 / 3]) + 5 / 6) * 2 * np.pi / 8)
    assert sector_angles_rad(8, 8) == pytest.approx(np.arange(8) * 2 * np.pi / 8)


def test_means_are_over_rows_that_are_there() -> None:
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    means = mean_between(image, np.array([1, -5, 3]), np.array([3, 2, 9]))
    assert means.tolist() == [1.5, 4.5, 11]
    assert mean_between(image, np.array([2, 4, 0]), np.array([2, 9, 0])).tolist() == [0, 0, 0]


def test_rows_are_those_that_are_there_and_nan_beyond() -> None:
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    rows = rows_from(image, np.array([-1, 1, 3]), 3)
    np.testing.assert_array_equal(rows, [[np.nan, 0, 1], [5, 6, 7], [11, np.nan, np.nan]])
    assert rows.dtype == np.float32


def test_an_ascan_varies_where_a_sample_differs_from_its_first() -> None:
    image = np.array([[3, 3, 3], [3, 3, 4], [4, 3, 3], [0, 0, 0]], np.uint8)
    assert varying(image).tolist() == [False, True, True, False]


def test_linear_intensity_is_taken_in_decibels_down_to_a_floor() -> None:
    image = np.array([[1.0, 10.0, 100.0, 0.0]], np.float32)
    assert logarithmic(image, "log") is image
    # the floor is a millionth of the mean, 27.75
    assert logarithmic(image, "linear")[0] == pytest.approx([0, 10, 20, 10 * np.log10(27.75e-6)], rel=1e-5)
    assert np.isfinite(logarithmic(np.zeros((1, 3), np.uint8), "linear")).all()


@pytest.mark.parametrize("turned", [False, True])
def test_most_sectors_brighten_or_darken_with_depth(turned: bool) -> None:
    """Bone begins suddenly and fades; upside down it grows and ends suddenly. Half a sector's share is nothing's."""
    rng = np.random.default_rng(4)
    start = 60 + (20 * np.sin(np.linspace(0, 2 * np.pi, 128, endpoint=False))).astype(int)
    below = np.arange(200) - start[:, None]
    image = np.where(below > 0, 100 * np.exp(-np.maximum(below, 0) / 25), 0) + rng.normal(0, 2, (128, 200))
    share = share_brightening((image[:, ::-1] if turned else image).astype(np.float32))
    assert share > 0.9 if not turned else share < 0.1
    assert share_brightening(np.full((128, 200), 7.0, np.float32)) == 0.5
