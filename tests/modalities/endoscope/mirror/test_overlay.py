"""What is drawn into the picture is found by what it is; what belongs to the probe is not taken for it."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from tolerances import OVERLAY_EXCESS, OVERLAY_FOUND

from endoct.base.arrays import Image, Mask
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.overlay import find_overlay, in_pixels_of_files, share_of_ring

SIDE = 200
RING = Annulus(101.0, 99.0, 30.0, 99.0, 100.0, 88.0)
ROW, COLUMN = np.indices((SIDE, SIDE)).astype(np.float32)
RADIUS, ANGLE = np.hypot(COLUMN - 99, ROW - 100), np.arctan2(ROW - 100, COLUMN - 99)
ANNULUS = (RADIUS < 88) & (np.hypot(COLUMN - 101, ROW - 99) > 30)
Picture = NDArray[np.uint8]
Draw = Callable[[Picture, int], None]


def frames(draw: Draw | None = None, n: int = 12, seed: int = 0) -> list[Image]:
    """A wall that goes by outward in a mirror's ring with a specular ring, a saturated spot and dirt, and noise."""
    rng = np.random.default_rng(seed)
    wall = cv2.GaussianBlur(rng.normal(size=(400, 720)).astype(np.float32), (0, 0), 3)
    wall = np.asarray(wall / wall.std(), np.float32)
    wall[:, 360:] = wall[:, :360]
    images = []
    for k in range(n):
        rows = RADIUS + 12 * k
        columns = (np.rad2deg(ANGLE) % 360).astype(np.float32)
        bright = 0.5 + 0.08 * cv2.remap(wall, columns, rows.astype(np.float32), cv2.INTER_LINEAR)
        bright *= 1 - 0.9 * np.exp(-(((COLUMN - 60) ** 2 + (ROW - 140) ** 2) / 8**2))  # dirt, out of focus
        bright += 0.35 * np.exp(-(((RADIUS - 80) / 1.2) ** 2))  # a specular ring
        bright += 1.5 * np.exp(-(((COLUMN - 150) ** 2 + (ROW - 80) ** 2) / 9**2))  # light that saturates
        image = np.where(ANNULUS, bright, 0.03)
        image = cv2.GaussianBlur(image, (0, 0), 1.0) + rng.normal(0, 0.012, image.shape)
        counts = (np.clip(image, 0, 1) * 255).round().astype(np.uint8)
        if draw is not None:
            draw(counts, k)
        images.append(counts.astype(np.float32) / 255)
    return images


def text(image: Picture, k: int) -> None:
    cv2.putText(image, f"10:42:{k:02d}", (60, 160), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (255, 255, 255), 1)


def dark_text(image: Picture, k: int) -> None:
    cv2.putText(image, "ID 47", (24, 106), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 2)


def box(image: Picture, k: int) -> None:
    image[60:85, 0:60] = 0
    cv2.rectangle(image, (0, 60), (60, 85), (230, 230, 230), 1)


def mask(image: Picture, k: int) -> None:
    image[:, :24] = 0
    cv2.fillPoly(image, [np.array([[90, 195], [110, 195], [100, 165]])], (0, 0, 0))


def drawn(draw: Draw) -> Mask:
    """Where a recording differs from that without the overlay, within the ring and not at its rims."""
    apart = [one != other for one, other in zip(frames(), frames(draw), strict=True)]
    away = (RADIUS < 84) & (np.hypot(COLUMN - 101, ROW - 99) > 34)
    return np.asarray(np.any(apart, axis=0) & away)


def grown(mask: Mask, by_px: int) -> Mask:
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((2 * by_px + 1,) * 2)), np.bool_)


@pytest.mark.parametrize("draw", [text, dark_text, box, mask])
def test_what_is_drawn_is_found_and_little_else(draw: Draw) -> None:
    found = find_overlay(frames(draw), RING)
    assert found is not None
    there = drawn(draw)
    assert found[there].mean() >= OVERLAY_FOUND
    assert (found & ANNULUS & ~grown(there, 9)).sum() <= OVERLAY_EXCESS * ANNULUS.sum()
    assert share_of_ring(found, RING) == pytest.approx(found[ANNULUS].mean(), abs=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_what_belongs_to_the_probe_is_no_overlay(seed: int) -> None:
    assert find_overlay(frames(seed=seed), RING) is None


def test_outside_the_ring_nothing_is_looked_for() -> None:
    def corner(image: Picture, k: int) -> None:
        cv2.putText(image, f"{k}", (2, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1)

    assert find_overlay(frames(corner), RING) is None


def test_too_few_frames_show_nothing() -> None:
    assert find_overlay(frames(box, n=5), RING) is None


def test_pixels_of_the_files_are_those_that_were_reduced() -> None:
    reduced = np.zeros((4, 5), np.bool_)
    reduced[1, 3] = True
    whole = in_pixels_of_files(reduced, (9, 11), 2, 1.0)
    assert np.argwhere(whole).tolist() == [[2, 6], [2, 7], [3, 6], [3, 7]]
    wide = in_pixels_of_files(reduced, (4, 10), 1, 2.0)  # pixels twice as high as wide
    assert np.argwhere(wide).tolist() == [[1, 6], [1, 7]]
