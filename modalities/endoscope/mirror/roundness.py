"""How far the outer rim is from a circle: an ellipse along the image's axes tells of pixels that are not square."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.modalities.endoscope.mirror.annulus import locate_outer_rim
from endoct.modalities.endoscope.mirror.edges import edge_points
from endoct.modalities.endoscope.mirror.rings import Ring

REACH = 0.14
"""The rim is looked for within this part of the radius, since a circle through part of an ellipse misses the rest."""
LEAST_SEEN = 0.7
"""At least this part of the rim must be visible. An ellipse fitted to less is arbitrary."""
NEAR = 0.012
"""Points farther from the ellipse than this part of the radius do not belong to the rim."""
NOT_ROUND = 0.01
"""A ring is not round from this relative difference of its axes on. It is below 0.002 in both simulators."""


@dataclass(frozen=True)
class Roundness:
    """``wide``: the rim's extent along columns over that along rows; ``oblique``: the same along the diagonals."""

    wide: float
    oblique: float

    @property
    def pixels(self) -> float:
        """Height over width of a pixel that makes a circle of the rim; 1 for a round rim, or an oblique ellipse."""
        along, across = abs(self.wide - 1), abs(self.oblique - 1)
        return self.wide if along > NOT_ROUND and across < 0.5 * along else 1.0

    @property
    def out_of_round(self) -> float:
        """Relative excess of the rim's longest diameter over its shortest."""
        return float(np.hypot(self.wide - 1, self.oblique - 1))


ROUND = Roundness(1.0, 1.0)


def measure_roundness(images: Sequence[Image], outer: Ring) -> Roundness:
    """Return the roundness of the outer rim: the median over the grey images that show enough of it."""
    measured = [one for image in images if (one := _of_image(image, locate_outer_rim(image, outer)[0])) is not None]
    if 2 * len(measured) < len(images):
        return ROUND
    wide, oblique = np.median(measured, axis=0)
    return Roundness(float(wide), float(oblique))


def squared(image: Image, pixels: float) -> Image:
    """Return an image with pixels ``pixels`` times as high as wide as one of square pixels, with the same rows."""
    if pixels == 1:
        return image
    # pixel centres are at integers in both
    shift = np.array([[pixels, 0, 0.5 * pixels - 0.5], [0, 1, 0]])
    size = max(1, round(image.shape[1] / pixels)), image.shape[0]
    return np.asarray(
        cv2.warpAffine(
            image, shift, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
        ),
        np.float32,
    )


def _of_image(image: Image, outer: Ring) -> tuple[float, float] | None:
    x, y = edge_points(image, outer, REACH * outer.radius_px)
    if x.size < 8:
        return None
    angle = np.arctan2(y - outer.y_px, x - outer.x_px)
    radius = np.hypot(x - outer.x_px, y - outer.y_px)
    basis = np.stack([np.ones_like(angle), *(f(k * angle) for k in (1, 2) for f in (np.cos, np.sin))], axis=1)
    fitted, misfit = _robust_fit(basis, radius, NEAR * outer.radius_px)
    # rays lie at whole degrees: to the nearest one, since the degree below is decided by rounding
    degrees = np.rint(np.degrees(angle[np.abs(misfit) < NEAR * outer.radius_px])) % 360
    seen = np.unique(degrees).size / 360
    if seen < LEAST_SEEN:
        return None
    mean, cos2, sin2 = fitted[0], fitted[3], fitted[4]
    return float((mean + cos2) / (mean - cos2)), float((mean + sin2) / (mean - sin2))


def _robust_fit(basis: Coordinates, values: Coordinates, scale: float) -> tuple[Coordinates, Coordinates]:
    """Return weights of ``basis`` (n, k) for ``values`` (n,) with Cauchy's weights, ever stricter, and the misfit."""
    weight: Coordinates = np.ones_like(values)
    fitted: Coordinates = np.zeros(basis.shape[1])
    for width in (8 * scale, 4 * scale, 2 * scale, *[scale] * 6):
        normal = (basis * weight[:, None]).T @ basis + 1e-9 * np.eye(basis.shape[1])
        fitted = np.asarray(np.linalg.solve(normal, basis.T @ (weight * values)))
        weight = np.asarray(1 / (1 + ((values - basis @ fitted) / width) ** 2) ** 2)
    return fitted, values - basis @ fitted
