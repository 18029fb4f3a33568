"""What moves in the ring and what stays: in pictures that are drawn so."""

import numpy as np
import pytest

from endoct.base.arrays import Image
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.movement import (
    Movement,
    inner_rim_of,
    movement,
    movement_in_thirds,
    movement_within,
    outer_rim_of,
)
from endoct.modalities.endoscope.mirror.rings import Ring

SHAPE = 240, 320
OUTER = Ring(160.0, 120.0, 100.0, rising=False)
ANNULUS = Annulus(163.0, 118.0, 40.0, OUTER.x_px, OUTER.y_px, OUTER.radius_px)
ROW, COLUMN = np.indices(SHAPE)


def distance(x_px: float, y_px: float) -> Image:
    return np.hypot(COLUMN - x_px, ROW - y_px).astype(np.float32)


def moving(noise: float = 0.002) -> Movement:
    """Nothing moves inside the inner rim and outside the outer one; between, ever more outwards, in three steps."""
    light = np.full(SHAPE, noise, np.float32)
    for k in range(3):
        light[distance(163 - k, 118 + 2 / 3 * k) >= 40 + 20 * k] = 0.02 * (k + 1)
    light[distance(160, 120) > 100] = noise
    return Movement(light, noise, OUTER)


def test_thirds_of_the_ring_and_its_inside_are_told_apart() -> None:
    assert movement_in_thirds(moving(), ANNULUS) == pytest.approx((0.02, 0.04, 0.06))
    assert movement_within(moving(), ANNULUS) == pytest.approx(0.002)
    assert moving().above_noise[0, 0] == pytest.approx(0.004)


def test_rims_are_where_movement_begins_and_ends() -> None:
    inner = inner_rim_of(moving())
    assert inner is not None
    assert (inner.x_px, inner.y_px, inner.radius_px) == pytest.approx((163, 118, 40), abs=1)
    outer = outer_rim_of(moving(), inner)
    assert outer is not None
    assert (outer.x_px, outer.y_px, outer.radius_px) == pytest.approx((160, 120, 100), abs=1)
    assert inner_rim_of(moving(noise=0.03)) is None, "not three times more than the noise"
    still = Movement(np.full(SHAPE, 0.002, np.float32), 0.002, OUTER)
    assert inner_rim_of(still) is None


def test_frames_are_laid_on_each_other_and_their_exposure_taken_off() -> None:
    """The wall's texture turns from frame to frame; the probe moves in the image with a still mark, as its rim does."""
    rng = np.random.default_rng(6)
    angle = np.arctan2(ROW - 120, COLUMN - 160)
    wall, images, places = rng.uniform(0.3, 0.9, 24), [], []
    for k in range(6):
        image = wall[((angle / (2 * np.pi) * 24).astype(int) + 5 * k) % 24]
        image[distance(163, 118) < 40] = 0.4
        image[100:106, 150:156] = 0.9
        image[distance(160, 120) > 100] = 0.02
        image = np.roll(image * (0.8 + 0.1 * k), (k, -2 * k), axis=(0, 1)).astype(np.float32)
        images.append(image)
        places.append(Ring(160.0 - 2 * k, 120.0 + k, 100.0, rising=False))
    found = movement(images, places, OUTER)
    assert found is not None
    ring = (distance(163, 118) > 50) & (distance(160, 120) < 90)
    inside = distance(163, 118) < 30
    assert np.median(found.light[ring]) > 0.08
    assert np.median(found.light[inside]) < 0.02
    assert found.light[103, 153] < 0.04, "the mark belongs to the probe"
    assert found.noise < 0.01
    assert movement(images[:1], places[:1], OUTER) is None
