"""Outlines of cells, as lines on the wall."""

import cv2
import numpy as np
from contourpy import contour_generator

from endoct.workbench.page.plane import Plane

TOLERANCE_SAMPLES = 0.25
"""How far a line may depart from the outline, in samples of the image that it is drawn from."""
DECIMALS = 5
"""Of rad and mm: a hundredth of a micrometre."""


def outlines(mask: Plane) -> tuple[tuple[float, ...], ...]:
    """Return the outlines of what ``mask`` shows, each as flat (θ rad, z mm, θ, z, …).

    Drawn from the overview of the mask. An outline over θ = 0 ends a sample beyond it, on either side.
    """
    overview = mask.overview()
    down, across, averaged = overview.down, overview.across, overview.averaged
    share = np.where(averaged.known, averaged.values, np.float32(0))
    padded = np.pad(np.pad(share, ((0, 0), (1, 1)), mode="wrap"), ((1, 1), (0, 0)))
    placing = mask.placing
    starts = np.arange(0, placing.row_mm.size, down)
    middle = (starts + np.minimum(starts + down, placing.row_mm.size) - 1) / 2
    row_mm = np.interp(middle, np.arange(placing.row_mm.size), placing.row_mm)
    # the mask ends half a sample beyond its first and last row
    step_mm = placing.row_height_mm * down
    ends_mm = np.concatenate([[row_mm[0] - step_mm], row_mm, [row_mm[-1] + step_mm]])
    lines = []
    for contour in contour_generator(z=padded).lines(0.5):
        points = cv2.approxPolyDP(np.asarray(contour, np.float32), TOLERANCE_SAMPLES, closed=False)[:, 0]
        if len(points) < 2:
            continue
        z_mm = np.interp(points[:, 1], np.arange(ends_mm.size), ends_mm)
        column = (points[:, 0] - 1) * across + (across - 1) / 2
        theta_rad = placing.theta0_rad + column * placing.dtheta_rad
        flat = np.round(np.stack([theta_rad, z_mm], axis=1), DECIMALS).ravel()
        lines.append(tuple(flat.tolist()))
    return tuple(lines)
