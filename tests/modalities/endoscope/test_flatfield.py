"""Light, dirt and cells told apart, on strips made of known ones."""

import numpy as np
import pytest
from numpy.typing import NDArray

from endoct.base.numeric.circle import gaussian
from endoct.modalities.endoscope.flatfield import FlatField, estimate_flat_field, frame_exposure
from endoct.modalities.endoscope.light import full_scale, log_light, reduced_light

N_ROWS, N_THETA = 60, 512
ROW, THETA = np.mgrid[:N_ROWS, :N_THETA].astype(float)
LIGHT = -0.6 - 0.4 * ((ROW - 30) / 30) ** 2 + 0.3 * np.cos(2 * np.pi * THETA / N_THETA - 1.0)


def strips(
    n: int, *, cells: float = 0.25, dirt: float = 0.0, seed: int = 0
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Frames of a wall with cells that moves by 12 rows a frame, and the cells; dirt is a spot fixed to the probe."""
    rng = np.random.default_rng(seed)
    blobs = gaussian(rng.standard_normal((N_ROWS + 12 * n, N_THETA)).astype(np.float32), 8, 14)
    cell = blobs > np.quantile(blobs, 1 - cells)
    wall = 0.08 * rng.standard_normal(cell.shape) - 0.9 * cell
    spot = dirt * np.exp(-((ROW - 20) ** 2 + (THETA - 100) ** 2) / (2 * 3.0**2))
    windows = [slice(12 * k, 12 * k + N_ROWS) for k in range(n)]
    return (
        np.stack([wall[w] + LIGHT + np.log(1 - spot) for w in windows]).astype(np.float32),
        np.stack([cell[w] for w in windows]),
    )


@pytest.mark.parametrize("n", [1, 3, 25])
def test_the_light_on_bone_is_found_although_cells_cover_a_quarter(n: int) -> None:
    logs, cell = strips(n)
    flat = estimate_flat_field(logs, views=n / 4, least_transmission=0.5)
    bone = (logs - flat.log_light)[~cell]
    assert np.median(bone) == pytest.approx(0, abs=0.06)
    # what is left of the light is small against the depth of a cell in the image (0.9)
    assert np.std(flat.log_light - LIGHT) < 0.06


@pytest.mark.parametrize("n", [1, 3, 6, 25])
def test_cells_are_not_eaten(n: int) -> None:
    logs, cell = strips(n, seed=4)
    flat = estimate_flat_field(logs, views=n / 4, least_transmission=0.5)
    flattened = logs - flat.log_light
    assert np.median(flattened[cell]) == pytest.approx(-0.9, abs=0.12)


def test_dirt_is_evened_out_and_what_is_opaque_is_masked() -> None:
    logs, _ = strips(30, dirt=0.4)
    flat = estimate_flat_field(logs, views=8, least_transmission=0.5)
    assert flat.pattern[20, 100] == pytest.approx(np.log(0.6), abs=0.12)
    assert flat.usable.all()
    assert np.abs(flat.pattern[40:, 200:]).max() < 0.1
    logs, _ = strips(30, dirt=0.8)
    flat = estimate_flat_field(logs, views=8, least_transmission=0.5)
    assert not flat.usable[20, 100]
    assert flat.usable.mean() > 0.99


def test_a_short_recording_has_no_pattern_to_take_cells_for() -> None:
    logs, _ = strips(4, dirt=0.8)
    flat = estimate_flat_field(logs, views=1, least_transmission=0.5)
    assert not flat.pattern.any()


def test_a_change_of_exposure_is_seen_and_a_change_of_cells_is_not() -> None:
    logs, _ = strips(30)
    flat = estimate_flat_field(logs, views=8, least_transmission=0.5)
    assert not frame_exposure(logs, flat).any()
    logs[7] += 0.5
    exposure = frame_exposure(logs, flat)
    assert exposure[7] == pytest.approx(0.5, abs=0.08)
    assert np.flatnonzero(exposure).tolist() == [7]


def test_what_was_never_seen_is_not_usable() -> None:
    logs, _ = strips(3)
    logs[:, :, 100:150] = np.nan
    flat = estimate_flat_field(logs, views=1, least_transmission=0.5)
    assert not flat.usable[:, 100:150].any()
    assert flat.usable[:, 200:].all()
    assert np.isfinite(flat.log_light).all()


@pytest.mark.parametrize(
    ("dtype", "largest", "scale"), [("u1", 60, 255), ("u2", 4000, 4095), ("u2", 60000, 65535), ("f4", 0.7, 1.0)]
)
def test_full_scale_is_that_of_the_bit_depth(dtype: str, largest: float, scale: float) -> None:
    assert full_scale(np.array([[0, largest]], dtype)) == scale


def test_brightness_and_saturation_of_colours_are_those_of_green() -> None:
    frame = np.array([[[255, 60, 0], [30, 255, 90]]], np.uint8)
    light, saturated = reduced_light(frame, 255.0, 1)
    np.testing.assert_allclose(light, [[60 / 255, 1.0]], rtol=1e-6)
    assert saturated is not None
    assert saturated.tolist() == [[0.0, 1.0]]
    assert np.isfinite(log_light(np.zeros((1, 1), np.float32))).all()


def test_reducing_averages_whole_blocks() -> None:
    image = np.arange(20, dtype=np.float32).reshape(4, 5) / 20
    light, saturated = reduced_light(image, 1.0, 2)
    np.testing.assert_allclose(light, np.array([[3, 5], [13, 15]]) / 20, rtol=1e-6)
    assert saturated is None
    image[2, 1] = 0.995
    light, saturated = reduced_light(image, 1.0, 2)
    np.testing.assert_allclose(saturated, [[0, 0], [0.25, 0]])
    image = np.arange(48, dtype=np.uint8)[::-1].reshape(6, 8) * 5
    for factor in (1, 2, 3):
        light, saturated = reduced_light(image, 235.0, factor)
        blocks = image[:, : 8 // factor * factor].reshape(6 // factor, factor, 8 // factor, factor)
        np.testing.assert_allclose(light, blocks.mean(axis=(1, 3)) / 235, rtol=1e-6)
        assert saturated is not None
        np.testing.assert_allclose(saturated, np.mean(blocks >= 233, axis=(1, 3)), rtol=1e-6)


def test_light_between_rows_and_columns_goes_around_and_is_unknown_under_dirt() -> None:
    log_light = np.log(np.arange(1, 13, dtype=np.float32)).reshape(3, 4)
    usable = np.ones((3, 4), np.bool_)
    usable[2, 1] = False
    flat = FlatField(log_light, np.zeros_like(log_light), usable)
    at = flat.transmission(np.array([-5.0, 0.0, 0.4, 1.6]), np.array([0.0, 3.5, 4.0, -3.0, -1e-18]))
    expected = np.array([[1, 2, 1, 2, 1]] * 2, np.float32)
    np.testing.assert_allclose(at[:2], expected, rtol=1e-6)
    np.testing.assert_allclose(at[2, [0, 3]], [5**0.4, 2**0.6 * 6**0.4], rtol=1e-6)
    assert np.isnan(at[3]).tolist() == [False, False, False, True, False]
