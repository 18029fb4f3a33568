"""Feed and roll of strips cut out of one known wall."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from tolerances import FEED_ATOL_MM, ROLL_ATOL_RAD

from endoct.base.compute.memory import Computed, Kept
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import gaussian, wrap_rad
from endoct.stitching.motion import matching
from endoct.stitching.motion.feed import Feed, estimate_feed, robust_chain
from endoct.stitching.motion.warp import Motion, Texture, refine_motion

DZ_MM = 0.015
RADIUS_MM = 1.25
N_ROWS = 64
N_THETA = 256
Z_MM = np.array([0.0, 0.19, 0.42, 0.6, 0.78, 1.01, 1.2])
ROLL_RAD = np.array([0.0, 0.03, 0.05, 0.02, -0.04, -0.06, -0.02])


def wall(seed: int = 0, rows: int = 200) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    return 3 * gaussian(rng.standard_normal((rows, N_THETA)).astype(np.float32), 2.0, 3.0)


def strips_of(
    texture: NDArray[np.float32],
    z_mm: NDArray[np.float64],
    roll_rad: NDArray[np.float64],
    sway_rad: NDArray[np.float64] | None = None,
    stretch: float = 0.0,
) -> NDArray[np.float32]:
    """Strip i shows row k at z = z_mm[i] + k·DZ_MM and column j at θ = θ_j + roll + sway·(cos, sin).

    With ``stretch``, z of a row's u from −1 to 1 grows as 1 − stretch·u.
    """
    theta = 2 * np.pi / N_THETA * np.arange(N_THETA)
    sway = np.zeros((z_mm.size, 2)) if sway_rad is None else sway_rad
    strips = []
    for z, roll, (cos, sin) in zip(z_mm, roll_rad, sway, strict=True):
        ray = theta + roll
        columns = (ray + cos * np.cos(ray) + sin * np.sin(ray)) / (2 * np.pi) * N_THETA
        u = np.linspace(-1, 1, N_ROWS)
        rows = z / DZ_MM + np.arange(N_ROWS) - stretch * (u**2 - 1) / 2 * (N_ROWS - 1) / 2
        places = np.broadcast_arrays(rows[:, None], columns[None, :])
        strips.append(map_coordinates(texture, places, order=3, mode="grid-wrap"))
    return np.asarray(strips, dtype=np.float32)


def feed_of(strips: NDArray[np.float32], nominal_mm: NDArray[np.float64] | None) -> Feed:
    return estimate_feed(strips, DZ_MM, RADIUS_MM, nominal_mm)


NOMINAL_MM = 0.2 * np.arange(Z_MM.size)


def test_feed_and_roll_are_measured_not_taken_from_the_prior() -> None:
    feed = feed_of(strips_of(wall(), Z_MM, ROLL_RAD), NOMINAL_MM)
    assert feed.trusted.all()
    assert feed.direction == 1
    np.testing.assert_allclose(feed.z_mm, Z_MM, atol=FEED_ATOL_MM)
    np.testing.assert_allclose(feed.roll_rad, ROLL_RAD, atol=ROLL_ATOL_RAD)


@pytest.mark.parametrize("lost", [1, 2])
def test_a_gap_that_lost_frames_leave_is_measured(lost: int) -> None:
    """Two lost frames of 0.2 mm leave a third of 0.96 mm in common."""
    z_mm = np.where(np.arange(Z_MM.size) >= 3, Z_MM + 0.2 * lost, Z_MM)
    feed = feed_of(strips_of(wall(), z_mm, ROLL_RAD), NOMINAL_MM)
    np.testing.assert_allclose(feed.z_mm, z_mm, atol=FEED_ATOL_MM)


def test_without_a_nominal_feed_the_whole_overlap_is_searched() -> None:
    feed = feed_of(strips_of(wall(), Z_MM, ROLL_RAD), None)
    assert feed.trusted.all()
    np.testing.assert_allclose(feed.z_mm, Z_MM, atol=FEED_ATOL_MM)


@pytest.mark.parametrize("stretch", [-0.1, 0.0, 0.04])
def test_rows_that_are_not_even_are_told_by_the_feed(stretch: float) -> None:
    z_mm = 0.2 * np.arange(10) + 0.02 * np.sin(np.arange(10))
    feed = feed_of(strips_of(wall(), z_mm, np.zeros(10), stretch=stretch), 0.2 * np.arange(10))
    found, error = feed.stretch
    assert abs(found - stretch) < 0.1 * abs(stretch) + 3 * error
    assert error < 0.003
    np.testing.assert_allclose(feed.z_mm, z_mm, atol=4 * FEED_ATOL_MM)


def test_two_strips_do_not_tell_whether_rows_are_even() -> None:
    assert feed_of(strips_of(wall(), Z_MM[:2], ROLL_RAD[:2]), NOMINAL_MM[:2]).stretch == (0.0, np.inf)


def test_strips_that_move_against_the_nominal_feed_are_found_and_said() -> None:
    feed = feed_of(strips_of(wall(), Z_MM[::-1], ROLL_RAD), NOMINAL_MM)
    assert feed.direction == -1
    np.testing.assert_allclose(feed.z_mm, Z_MM[::-1] - Z_MM[-1], atol=FEED_ATOL_MM)


@hypothesis_settings(max_examples=8)
@given(st.integers(0, N_THETA - 1), st.floats(-np.pi, np.pi))
def test_theta_is_a_circle(columns: int, roll: float) -> None:
    rolls = np.array([0.0, roll, 2 * roll])
    strips = np.roll(strips_of(wall(1), Z_MM[:3], rolls), columns, axis=2)
    feed = feed_of(strips, NOMINAL_MM[:3])
    np.testing.assert_allclose(feed.z_mm, Z_MM[:3], atol=FEED_ATOL_MM)
    np.testing.assert_allclose(wrap_rad(feed.roll_rad - rolls), 0, atol=ROLL_ATOL_RAD)


def test_a_pattern_fixed_to_the_probe_does_not_hold_the_strips_in_place() -> None:
    z_mm = 0.2 * np.arange(10) + 0.02 * np.sin(np.arange(10))
    pattern = wall(7)[:N_ROWS] + 0.5 * np.linspace(-1, 1, N_ROWS)[:, None]
    strips = strips_of(wall(rows=260), z_mm, np.zeros(10)) + pattern.astype(np.float32)
    feed = feed_of(strips, 0.2 * np.arange(10))
    assert feed.trusted.all()
    np.testing.assert_allclose(feed.z_mm, z_mm - z_mm[0], atol=3 * FEED_ATOL_MM)


def test_pairs_of_different_walls_are_not_trusted_and_fall_back_on_the_nominal_feed() -> None:
    strips = np.concatenate([strips_of(wall(seed), Z_MM[:1], ROLL_RAD[:1]) for seed in range(4)])
    feed = feed_of(strips, NOMINAL_MM[:4])
    assert feed.trusted.tolist() == [True, False, False, False]
    assert not feed.measured
    np.testing.assert_allclose(np.abs(np.diff(feed.z_mm)), 0.2)
    assert (feed.correlation[1:] < 0.3).all()
    assert (feed.confidence[1:] < 2.0).all()


def test_one_frame_that_shows_nothing_spoils_only_its_own_pairs() -> None:
    strips = strips_of(wall(), Z_MM, ROLL_RAD)
    strips[3] = np.random.default_rng(5).standard_normal(strips[3].shape)
    feed = feed_of(strips, NOMINAL_MM)
    assert np.flatnonzero(~feed.trusted).tolist() == [3, 4]
    others = [0, 1, 2, 4, 5, 6]  # the pair that skips it carries across
    np.testing.assert_allclose(feed.z_mm[others], Z_MM[others], atol=FEED_ATOL_MM)


def test_a_first_harmonic_in_theta_does_not_pass_for_roll() -> None:
    texture = wall()
    texture[:, : N_THETA // 2] *= 0.15  # nearly all texture on one side
    sway = np.stack([0.02 * np.cos(np.arange(7)), 0.02 * np.sin(np.arange(7))], axis=1)
    feed = feed_of(strips_of(texture, Z_MM, ROLL_RAD, sway), NOMINAL_MM)
    np.testing.assert_allclose(feed.roll_rad, ROLL_RAD, atol=3 * ROLL_ATOL_RAD)
    line = np.stack([np.ones(7), feed.z_mm], axis=1)
    expected = sway - line @ np.linalg.lstsq(line, sway, rcond=None)[0]
    np.testing.assert_allclose(feed.sway_rad, expected, atol=3 * ROLL_ATOL_RAD)


def test_samples_that_are_missing_are_left_out() -> None:
    strips = strips_of(wall(), Z_MM, ROLL_RAD)
    strips[:, :, 40:70] = np.nan
    feed = feed_of(strips, NOMINAL_MM)
    np.testing.assert_allclose(feed.z_mm, Z_MM, atol=FEED_ATOL_MM)


def test_a_single_strip_is_a_recording() -> None:
    feed = feed_of(strips_of(wall(), Z_MM[:1], ROLL_RAD[:1]), NOMINAL_MM[:1])
    assert feed.z_mm.tolist() == [0.0]
    assert not feed.measured


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(EndoctError, match="one nominal place"):
        feed_of(strips_of(wall(), Z_MM, ROLL_RAD), NOMINAL_MM[:2])
    with pytest.raises(EndoctError, match="stack"):
        feed_of(np.zeros((4, 5), np.float32), None)


def test_a_strip_has_not_moved_against_itself() -> None:
    strip = strips_of(wall(), Z_MM[:1], ROLL_RAD[:1])[0]
    seen = np.ones(strip.shape, np.bool_)
    motion = refine_motion(strip, strip, seen, seen, Motion.even(0.4, -0.3))
    np.testing.assert_allclose([motion.rows, motion.columns], 0, atol=0.02)


def test_a_wrong_link_is_overruled_by_the_others() -> None:
    """Steps of 1; the third link says 3 but the longer links across it say 2."""
    steps = np.array([1.0, 1.0, 3.0, 1.0, 1.0])
    longer = np.full(4, 2.0)
    place, agree = robust_chain(
        np.ones(5), np.full(5, 0.5), [(1, steps, np.ones(5, bool)), (2, longer, np.ones(4, bool))], 0.01, cyclic=False
    )
    np.testing.assert_allclose(place, np.arange(6), atol=0.01)
    assert agree.tolist() == [True, True, False, True, True]


def textures_at_once(strips: NDArray[np.float32]) -> NDArray[np.float32]:
    """What :func:`matching.keep_textures` keeps, made of all strips at once, blurred by 2 rows and 3 columns."""
    seen = np.isfinite(strips)

    def median(values: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
        if seen.all():
            return np.median(values, axis=axis, keepdims=True).astype(np.float32)
        at = np.maximum((np.sum(~np.isnan(values), axis=axis, keepdims=True) - 1) // 2, 0)
        return np.nan_to_num(np.take_along_axis(np.sort(values, axis=axis), at, axis=axis))

    edges = np.where(seen, strips, np.nan).astype(np.float32)
    edges -= median(edges, 2)
    edges -= median(edges, 0)
    edges = np.where(seen, edges, np.float32(0))
    for edge, mask in zip(edges, seen, strict=True):
        edge -= gaussian(edge, 2.0, 3.0) / np.maximum(gaussian(mask.astype(np.float32), 2.0, 3.0), 0.01)
    return np.where(seen, edges, np.float32(0))


@pytest.mark.parametrize("n", [9, 12])
@pytest.mark.parametrize("missing", [0.0, 0.1])
@pytest.mark.parametrize("at_a_time", [1, 3 * 20 * 64 + 1, 2**20])
def test_strips_made_ready_a_few_at_a_time_are_those_of_all_at_once(
    n: int, missing: float, at_a_time: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit."""
    monkeypatch.setattr(matching, "AT_A_TIME", at_a_time)
    rng = np.random.default_rng(n)
    strips = rng.standard_normal((n, 20, 64)).astype(np.float32)
    strips[rng.random(strips.shape) < missing] = np.nan
    if missing:
        strips[:, 7, 9] = strips[2] = np.nan
    with Kept[Texture]() as ready:
        matching.keep_textures(ready, strips, None, 2.0, 3.0)
        edges, seen = (np.stack(parts) for parts in zip(*ready, strict=True))
    np.testing.assert_array_equal(edges, textures_at_once(strips))
    np.testing.assert_array_equal(seen, np.isfinite(strips))


def test_strips_may_be_made_one_by_one() -> None:
    strips = strips_of(wall(), Z_MM, ROLL_RAD)
    one_by_one = estimate_feed(Computed(len(strips), lambda k: strips[k]), DZ_MM, RADIUS_MM, NOMINAL_MM)
    at_once = feed_of(strips, NOMINAL_MM)
    np.testing.assert_array_equal(one_by_one.z_mm, at_once.z_mm)
    np.testing.assert_array_equal(one_by_one.roll_rad, at_once.roll_rad)
