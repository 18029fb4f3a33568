"""The plane sweep and the matching of its costs, by hand and on drawn frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tolerances import COORDINATE_ATOL, PARALLAX_WALL_MM

from endoct.base.arrays import Coordinates
from endoct.base.numeric.circle import gaussian
from endoct.modalities.endoscope.parallax.matching import best_depths
from endoct.modalities.endoscope.parallax.sweeping import COST, UNSEEN, Costs, places_seen, sweep
from endoct.modalities.endoscope.parallax.views import UNKNOWN

ALONG_MM = np.linspace(-0.4, 0.4, 81)
SLANT = 0.2 + 0.4 * ALONG_MM
STRIP = ALONG_MM, SLANT
ROW_MM, N_COLUMNS = 0.005, 128
FRAME_Z_MM = np.array([0.5, 0.7, 0.9, 1.1])
DEPTHS_MM = np.linspace(-0.1, 0.5, 25)


def test_a_ray_passes_the_wall_short_of_what_it_ends_at() -> None:
    z_mm = np.array([1.0])
    assert places_seen(z_mm, np.array([1.0]), 0.0, STRIP) == pytest.approx(1.0, abs=COORDINATE_ATOL)
    # s + 0.5·(0.2 + 0.4 s) = 0 where s = −0.1/1.2
    assert places_seen(z_mm, np.array([1.0]), 0.5, STRIP) == pytest.approx(1 - 0.1 / 1.2, abs=1e-4)
    assert np.isnan(places_seen(z_mm, np.array([2.0]), 0.0, STRIP)).all()


@given(depth_mm=st.floats(0, 1), from_middle_mm=st.floats(-0.3, 0.3))
def test_what_a_place_is_seen_by_ends_at_that_place(depth_mm: float, from_middle_mm: float) -> None:
    passed_mm = places_seen(np.array([from_middle_mm]), np.zeros(1), depth_mm, STRIP)
    ended = passed_mm + np.interp(passed_mm, ALONG_MM, SLANT) * depth_mm  # the ends reach from −0.36 to 0.4 mm at least
    assert ended == pytest.approx(from_middle_mm, abs=1e-6)


def drawn(depth_mm: Coordinates, rng: np.random.Generator) -> tuple[NDArray[np.int8], Coordinates]:
    """Return what four frames show of a textured surface ``depth_mm`` (n_columns,) behind the wall, with noise."""
    fine_mm = ROW_MM * np.arange(400)
    texture = gaussian(rng.normal(size=(400, N_COLUMNS)).astype(np.float32), 2, 2)
    texture *= 30 / texture.std()
    frames = np.empty((4, ALONG_MM.size * 2 - 1, N_COLUMNS), np.int8)
    rows_mm = np.linspace(-0.4, 0.4, frames.shape[1])
    for k, z_mm in enumerate(FRAME_Z_MM):
        for j in range(N_COLUMNS):
            ends_mm = z_mm + rows_mm + np.interp(rows_mm, ALONG_MM, SLANT) * depth_mm[j]
            passed_mm = np.interp(ends_mm, fine_mm, texture[:, j]) + rng.normal(0, 5, rows_mm.size)
            frames[k, :, j] = np.clip(np.rint(passed_mm), -127, 127)
    return frames, FRAME_Z_MM - 0.4


def costs_of(frames: NDArray[np.int8], first_mm: Coordinates) -> Costs:
    z_mm = (0.6 + ROW_MM * np.arange(160)).reshape(40, 4)
    return sweep(frames, first_mm, ROW_MM, FRAME_Z_MM, STRIP, z_mm, DEPTHS_MM)


def test_a_step_in_the_surface_is_found_where_it_lies_and_across_the_seam() -> None:
    depth_mm = np.zeros(N_COLUMNS)
    depth_mm[-30:] = depth_mm[:20] = 0.25
    costs = costs_of(*drawn(depth_mm, np.random.default_rng(3)))
    assert costs.shape == (40, N_COLUMNS // 2, DEPTHS_MM.size)
    found = best_depths(costs, COST // 5, COST, DEPTHS_MM)
    truth = depth_mm.reshape(-1, 2).mean(axis=1)
    error = np.abs(found - truth)[:, np.r_[2:8, 12:47, 51:62]]  # away from the two steps
    assert np.median(error) < PARALLAX_WALL_MM
    assert (error < 0.05).mean() > 0.9
    seam = found[:, np.r_[-3:0, 0:3]]
    assert np.abs(seam - 0.25).mean() < 0.05


def test_turning_the_bore_turns_the_depths() -> None:
    depth_mm = np.where(np.arange(N_COLUMNS) < 40, 0.2, 0.0)
    frames, first_mm = drawn(depth_mm, np.random.default_rng(4))
    costs = costs_of(frames, first_mm)
    turned = costs_of(np.roll(frames, 50, axis=2), first_mm)
    np.testing.assert_array_equal(turned, np.roll(costs, 25, axis=1))
    one, other = (best_depths(each, COST // 5, COST, DEPTHS_MM) for each in (costs, turned))
    # a path begins at the seam, and two laps nearly forget where
    assert (np.abs(other - np.roll(one, 25, axis=1)) < 1e-6).mean() > 0.97


def test_what_one_frame_alone_sees_is_not_known() -> None:
    frames, first_mm = drawn(np.zeros(N_COLUMNS), np.random.default_rng(5))
    frames[:, :, 10:20] = UNKNOWN
    frames[1:, :, 40:50] = UNKNOWN
    costs = costs_of(frames, first_mm)
    assert (costs[:, 5:10] == UNSEEN).all()
    assert (costs[:, 20:25] == UNSEEN).all()
    assert (costs[10:30, 30:] <= COST).all()


def test_noise_alone_costs_the_same_at_every_depth() -> None:
    rng = np.random.default_rng(6)
    frames = rng.integers(-60, 60, (4, 161, N_COLUMNS)).astype(np.int8)
    costs = costs_of(frames, FRAME_Z_MM - 0.4).astype(float)
    means = costs.mean(axis=(0, 1))
    assert np.ptp(means) < 0.1 * COST
    assert means.min() > 0.7 * COST


def test_textures_are_interpolated_from_row_to_row() -> None:
    """Two frames see the place in their rows 2.0 and 2.6. Of the second, 0.4 and 0.6 of its rows 2 and 3 are alike."""
    textures = np.full((2, 6, 2), 60, np.int8)
    textures[0, 2] = [50, -40]
    textures[1, 2:4] = [[20, -16], [70, -56]]
    strip = np.linspace(-1, 1, 21), np.zeros(21)
    costs = sweep(textures, np.array([0.0, -0.06]), 0.1, np.zeros(2), strip, np.array([[0.2]]), np.zeros(1))
    assert costs.tolist() == [[[0]]]
    textures[1, 2] = UNKNOWN
    costs = sweep(textures, np.array([0.0, -0.06]), 0.1, np.zeros(2), strip, np.array([[0.2]]), np.zeros(1))
    assert costs.tolist() == [[[UNSEEN]]]  # then fewer than two see it
