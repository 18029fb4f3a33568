"""The steepest edge on each ray across a circle, to a fraction of a pixel."""

import numpy as np

from endoct.modalities.endoscope.mirror.rings import N_RAYS, Ring
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.compiled import compiled

STEP_PX = 0.5
MARGIN = 2
"""Samples at both ends of a ray where no edge is looked for."""
SIGMA = 2.0
_AWAY = np.arange(1, 9)
TAPS = _AWAY / SIGMA**2 * np.exp(-0.5 * (_AWAY / SIGMA) ** 2) / (1 + 2 * np.exp(-0.5 * (_AWAY / SIGMA) ** 2).sum())
"""Of the derivative of a Gaussian, in samples: those of one side."""


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
    clear = slope > 0.3 * max(float(np.median(rising)) if rising.size else 0.0, 1e-6)
    return (ring.x_px + radius * cos)[clear], (ring.y_px + radius * sin)[clear]


@compiled
def _steepest(
    image: Image, x_px: float, y_px: float, cos: Coordinates, sin: Coordinates, radii: Coordinates, sign: float
) -> tuple[Coordinates, Coordinates]:
    """Return radius and slope of the steepest edge of one ``sign`` on each ray from a centre; outside is no edge."""
    n_rows, n_columns = image.shape
    n, reach = radii.size, TAPS.size
    radius, steepest = np.empty(cos.size), np.empty(cos.size)
    line, slope, inside = np.empty(n + 2 * reach, np.float32), np.empty(n), np.empty(n, np.bool_)
    for i in range(cos.size):
        for k in range(n):
            x, y = np.float32(x_px + radii[k] * cos[i]), np.float32(y_px + radii[k] * sin[i])
            inside[k] = x >= 0 and y >= 0 and x <= n_columns - 1 and y <= n_rows - 1
            x, y = (
                min(max(x, np.float32(0)), np.float32(n_columns - 1)),
                min(max(y, np.float32(0)), np.float32(n_rows - 1)),
            )
            left, top = min(int(x), n_columns - 2), min(int(y), n_rows - 2)
            across, down = x - np.float32(left), y - np.float32(top)
            above = image[top, left] + across * (image[top, left + 1] - image[top, left])
            below = image[top + 1, left] + across * (image[top + 1, left + 1] - image[top + 1, left])
            line[reach + k] = above + down * (below - above)
        line[:reach], line[reach + n :] = line[reach], line[reach + n - 1]
        for k in range(line.size):
            light = max(line[k], np.float32(0))
            line[k] = light * np.sqrt(np.sqrt(light))
        slope[:] = 0
        for tap in range(reach):
            before, after = line[reach - 1 - tap : reach - 1 - tap + n], line[reach + 1 + tap : reach + 1 + tap + n]
            for k in range(n):
                slope[k] += sign * TAPS[tap] * (after[k] - before[k])
        at = MARGIN
        for k in range(n):
            slope[k] = slope[k] if inside[k] else 0.0
            if MARGIN <= k < n - MARGIN and slope[k] > slope[at]:
                at = k
        at = min(max(at, MARGIN + 1), n - MARGIN - 2)
        bend = slope[at - 1] - 2 * slope[at] + slope[at + 1]
        shift = 0.5 * (slope[at - 1] - slope[at + 1]) / bend if bend < 0 else 0.0
        radius[i] = radii[at] + STEP_PX * min(max(shift, -1.0), 1.0)
        steepest[i] = slope[at]
    return radius, steepest
