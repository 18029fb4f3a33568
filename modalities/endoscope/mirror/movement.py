"""What moves in the image while the probe stays: the wall does, and nothing that belongs to the probe.

The mirror's inner rim may be as bright as the wall around it. A reflection, or the end of the bore, may make a
clearer edge than the rim does. But whatever the light, the image changes from frame to frame outside the rim and stays
as it is inside.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.parallel import at_once, thread_map
from endoct.base.numeric.ranks import medians
from endoct.modalities.endoscope.mirror.annulus import Annulus, edge_points
from endoct.modalities.endoscope.mirror.rings import Ring, find_rings, fit_circle, rays

GRAIN = 1 / 320
"""Noise is averaged over this σ, as a part of the image's shorter side. The wall's texture is coarser."""
LEFT_PX = 0.3
"""Frames are still displaced by about this much when their outer rims coincide."""
CLEAR_RIM = 0.8
"""An edge of the movement with this support is the rim: it has 1.2 to 1.5 in the simulator, others below 0.55."""
NEARLY = 0.8
"""Edges with this part of the clearest edge's support count as nearly as clear."""
REFINED = 0.015
BRIGHT_SIDE, MOST_GAIN = 0.6, 2.0
"""This quantile of the bright pixels gives a frame's exposure, as part of them are cells; the gain is limited to the
second."""
NOISE_SHARE = 3.0
"""The wall must move this many times more than the noise outside the ring, or nothing is concluded."""


@dataclass(frozen=True, eq=False)
class Movement:
    """``light``: by how much each pixel of the probe changes, float32 (row, column), as parts of full scale.

    ``noise``: by how much it does where nothing moves. ``outer``: the rim by which the frames were superposed.
    """

    light: Image
    noise: float
    outer: Ring

    @property
    def above_noise(self) -> Image:
        """The movement plus the noise, so that the logarithm stays even where nothing moves."""
        return self.light + np.float32(self.noise)


def movement(images: Sequence[Image], places: Sequence[Ring], outer: Ring) -> Movement | None:
    """Return what moves in grey images whose outer rims lie at ``places``, with these laid on ``outer``.

    None for a single image. It is the mean absolute departure from the median, with each image at the brightness of the
    others. What a remaining displacement makes of still edges is taken off.
    """
    if len(images) < 2:
        return None
    sigma = max(1.0, GRAIN * min(images[0].shape))

    def laid(k: int) -> Image:
        moved = _moved(images[k], outer.x_px - places[k].x_px, outer.y_px - places[k].y_px)
        return np.asarray(cv2.GaussianBlur(moved, (0, 0), sigma))

    still = np.stack(list(thread_map(laid, range(len(images)))))
    median = _medians(still)
    within = _distance_px(median, outer) < outer.radius_px
    bright = within & (median > 0.25 * np.percentile(median[within], 90))
    typical = median[bright]
    gains = np.array(list(thread_map(lambda image: np.quantile(image[bright] / typical, BRIGHT_SIDE), still)))
    still = still / np.clip(gains, 1 / MOST_GAIN, MOST_GAIN).astype(np.float32)[:, None, None]
    median = _medians(still)
    light = np.mean(np.abs(still - median), axis=0)
    slope = np.hypot(*np.gradient(median))
    light = np.sqrt(np.maximum(light**2 - (LEFT_PX * slope) ** 2, 0)).astype(np.float32)
    outside = _distance_px(light, outer) > 1.15 * outer.radius_px
    noise = float(np.median(light[outside])) if outside.any() else 0.0
    return Movement(light, noise, outer)


def inner_rim_of(moving: Movement) -> Ring | None:
    """Return the circle inside the outer rim beyond which the image moves, or None where there is no clear one."""
    outer = moving.outer
    inside = [ring for ring in find_rings(moving.above_noise, rising=True, count=4) if _inside(ring, outer)]
    # a saturated reflection stands still in the midst of the wall; but nothing moves inside the rim
    most = max((ring.support for ring in inside), default=0.0)
    clear = sorted((ring for ring in inside if ring.support >= NEARLY * most), key=lambda ring: ring.radius_px)
    rim = _clearest(moving, clear[:1])
    if rim is None:
        return None
    return rim if max(movement_in_thirds(moving, Annulus.of(rim, outer))) >= NOISE_SHARE * moving.noise else None


def outer_rim_of(moving: Movement, inner: Ring) -> Ring | None:
    """Return the circle around the inner rim beyond which nothing moves any more, or None where none is clear."""
    around = [ring for ring in find_rings(moving.above_noise, rising=False, count=4) if _inside(inner, ring)]
    return _clearest(moving, around)


def _clearest(moving: Movement, rings: Sequence[Ring]) -> Ring | None:
    """Return the circle of the clearest edge, put where that is steepest, or None where none is clear."""
    best = max(rings, key=lambda ring: ring.support, default=None)
    if best is None or best.support < CLEAR_RIM:
        return None
    reach_px = max(2.0, REFINED * moving.outer.radius_px)
    x, y = edge_points(moving.above_noise, best, reach_px)
    fit = Ring(*fit_circle(x, y, best.circle), best.rising)
    return fit if fit.differs_px(best) <= 2 * reach_px else best


def movement_in_thirds(moving: Movement, annulus: Annulus) -> tuple[float, float, float]:
    """Return the median movement in the inner, the middle and the outer third of the ring."""
    low_px, high_px = annulus.inner_px, annulus.outer_px

    def of_third(k: int) -> float:
        radii: Coordinates = low_px + (high_px - low_px) * (k + np.linspace(0.05, 0.95, 24)) / 3
        x, y = (float(c[0]) for c in annulus.centre_at(radii[[radii.size // 2]]))
        return _median_along(moving, x, y, radii)

    return of_third(0), of_third(1), of_third(2)


def movement_within(moving: Movement, annulus: Annulus) -> float:
    """Return the median movement well inside the inner rim: between 0.4 and 0.9 of its radius."""
    rim = annulus.rings[0]
    return _median_along(moving, rim.x_px, rim.y_px, rim.radius_px * np.linspace(0.4, 0.9, 24))


def _median_along(moving: Movement, x_px: float, y_px: float, radii_px: Coordinates) -> float:
    profile, seen = rays(moving.light, x_px, y_px, radii_px)
    return float(np.median(profile[seen])) if seen.any() else 0.0


def _inside(ring: Ring, outer: Ring) -> bool:
    return ring.apart_px(outer) + ring.radius_px < 0.9 * outer.radius_px


def _medians(images: Image) -> Image:
    """Return the median over ``images`` (n, row, column), by two threads."""
    halves = np.array_split(images.reshape(len(images), -1), 2, axis=1)
    return np.concatenate(at_once(*(partial(medians, half) for half in halves))).reshape(images.shape[1:])


def _moved(image: Image, dx_px: float, dy_px: float) -> Image:
    shift = np.array([[1, 0, dx_px], [0, 1, dy_px]], np.float32)
    return np.asarray(
        cv2.warpAffine(image, shift, image.shape[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        np.float32,
    )


def _distance_px(image: Image, ring: Ring) -> Coordinates:
    row, column = np.indices(image.shape)
    return np.asarray(np.hypot(column - ring.x_px, row - ring.y_px))
