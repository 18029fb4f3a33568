"""The steepest edge on each ray across a circle, to a fraction of a pixel."""

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.compute.compiled import compiled
from endoct.base.numeric.ranks import median
from endoct.modalities.endoscope.mirror.rings import N_RAYS, Ring

STEP_PX = 0.5
MARGIN = 2
"""This many samples at both ends of a ray are not searched for edges."""
SIGMA = 2.0
_AWAY = np.arange(1, 9)
TAPS = _AWAY / SIGMA**2 * np.exp(-0.5 * (_AWAY / SIGMA) ** 2) / (1 + 2 * np.exp(-0.5 * (_AWAY / SIGMA) ** 2).sum())
"""One side of the derivative of a Gaussian, in samples."""


def edge_points(image: Image, ring: Ring, reach_px: float) -> tuple[Coordinates, Coordinates]:
    """Return x and y, float64 (n,), of the steepest edge on each ray within ``reach_px`` of ``ring``.

    A blurred edge is steepest in its middle only where the image is linear in light: its logarithm, or a camera's
    gamma, moves it towards the dark. As the gamma is not known, a little of a usual one is undone. Rays without a clear
    edge are left out.
    """
    margin_px = 2 * MARGIN * STEP_PX
    radii = ring.radius_px + np.arange(-reach_px - margin_px, reach_px + margin_px + STEP_PX / 2, STEP_PX)
    angle = 2 * np.pi / N_RAYS * np.arange(N_RAYS)
    cos, sin = np.cos(angle), np.sin(angle)
    radius, slope = _steepest(image, ring.x_px, ring.y_px, cos, sin, radii, 1.0 if ring.rising else -1.0)
    rising = slope[slope > 0]
    clear = slope > 0.3 * max(median(rising) if rising.size else 0.0, 1e-6)
    return (ring.x_px + radius * cos)[clear], (ring.y_px + radius * sin)[clear]


@compiled
def _steepest(
    image: Image, x_px: float, y_px: float, cos: Coordinates, sin: Coordinates, radii: Coordinates, sign: float
) -> tuple[Coordinates, Coordinates]:
    """Return radius and slope of the steepest edge of one ``sign`` on each ray; there is no edge outside the image."""
    n, reach, zero = radii.size, TAPS.size, np.float32(0)
    last_x, last_y = np.float32(image.shape[1] - 1), np.float32(image.shape[0] - 1)
    last_left, last_top = np.int32(image.shape[1] - 2), np.int32(image.shape[0] - 2)
    radius, steepest = np.empty(cos.size), np.empty(cos.size)
    line, slope, inside = np.empty(n + 2 * reach, np.float32), np.empty(n), np.empty(n, np.bool_)
    across, down = np.empty(n, np.float32), np.empty(n, np.float32)
    left, top = np.empty(n, np.int32), np.empty(n, np.int32)
    for i in range(cos.size):
        for k in range(n):  # apart from what reads the image, so that it is done as vectors
            x, y = np.float32(x_px + radii[k] * cos[i]), np.float32(y_px + radii[k] * sin[i])
            inside[k] = (x >= zero) & (y >= zero) & (x <= last_x) & (y <= last_y)
            x, y = min(max(x, zero), last_x), min(max(y, zero), last_y)
            left[k], top[k] = min(np.int32(x), last_left), min(np.int32(y), last_top)
            across[k], down[k] = x - np.float32(left[k]), y - np.float32(top[k])
        for k in range(n):
            above, below = image[top[k], left[k] : left[k] + 2], image[top[k] + 1, left[k] : left[k] + 2]
            upper = above[0] + across[k] * (above[1] - above[0])
            lower = below[0] + across[k] * (below[1] - below[0])
            line[reach + k] = upper + down[k] * (lower - upper)
        line[:reach], line[reach + n :] = line[reach], line[reach + n - 1]
        for k in range(line.size):
            light = max(line[k], zero)
            line[k] = light * np.sqrt(np.sqrt(light))
        slope[:] = 0
        for tap in range(reach):
            weight = sign * TAPS[tap]
            before, after = line[reach - 1 - tap : reach - 1 - tap + n], line[reach + 1 + tap : reach + 1 + tap + n]
            for k in range(n):
                slope[k] += weight * (after[k] - before[k])
        for k in range(n):
            slope[k] = slope[k] if inside[k] else 0.0
        at = MARGIN
        for k in range(MARGIN, n - MARGIN):
            if slope[k] > slope[at]:
                at = k
        at = min(max(at, MARGIN + 1), n - MARGIN - 2)
        bend = slope[at - 1] - 2 * slope[at] + slope[at + 1]
        shift = 0.5 * (slope[at - 1] - slope[at + 1]) / bend if bend < 0 else 0.0
        radius[i] = radii[at] + STEP_PX * min(max(shift, -1.0), 1.0)
        steepest[i] = slope[at]
    return radius, steepest
