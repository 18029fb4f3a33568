"""The capillary from slice to slice."""

import numpy as np
import pytest

from endoct.modalities.oct.face.face_circle import Capillary, Circle
from endoct.modalities.oct.face.faces import bridged, starts_anywhere, steady_slices


def capillary(offset: np.ndarray) -> Capillary:
    return Capillary(offset.real.copy(), offset.imag.copy(), np.where(np.isfinite(offset), 0.3, np.nan), 0.85)


def test_a_slice_that_strays_from_its_neighbours_is_not_steady() -> None:
    offset = 0.2 * np.exp(0.05j * np.arange(8))
    offset[3], offset[6] = -0.2, np.nan
    np.testing.assert_array_equal(np.flatnonzero(~steady_slices(capillary(offset), free=False)), [3, 6])


def test_where_turns_start_anywhere_only_the_distance_from_the_axis_counts() -> None:
    offset = 0.2 * np.exp(1j * np.random.default_rng(0).uniform(0, 2 * np.pi, 8))
    offset[3] *= 2
    np.testing.assert_array_equal(np.flatnonzero(~steady_slices(capillary(offset), free=True)), [3])


@pytest.mark.parametrize(("scatter_rad", "anywhere"), [(0.1, False), (3.0, True)])
def test_turns_start_anywhere_where_the_direction_jumps(scatter_rad: float, anywhere: bool) -> None:
    offset = 0.2 * np.exp(1j * scatter_rad * np.random.default_rng(1).uniform(-1, 1, 12))
    assert starts_anywhere(capillary(offset), "auto") == anywhere
    assert starts_anywhere(capillary(offset), "free")
    assert not starts_anywhere(capillary(offset), "triggered")


def test_an_unknown_slice_lies_between_its_neighbours() -> None:
    whole = Capillary.of([Circle(0.1, 0.0, 0.30, 0.85), None, Circle(0.3, 0.2, 0.32, 0.85)], 0.85)
    np.testing.assert_array_equal(whole.known, [True, False, True])
    middle = bridged(whole).circle(1)
    assert (middle.x_mm, middle.y_mm, middle.axis_depth_mm) == pytest.approx((0.2, 0.1, 0.31))
