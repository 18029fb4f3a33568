"""Pictures of a frame, with where places of the wall are seen in them, if the plug-in knows."""

from dataclasses import replace
from typing import Any

import numpy as np

from endoct.modalities.contract import Frame, Modality, Picture, Places, Seen
from endoct.stitching.strip import Strip

COLUMNS = 1440
"""Number of places around a row where a frame shows a single row of the wall. Several have a quarter each."""
ROWS = 9


def illustrated(modality: Modality[Any, Any], frame: Frame, calibration: Any) -> tuple[Picture, ...]:
    """Return the pictures of ``frame``, each with the places that are :class:`~endoct.modalities.contract.Seen` in it.

    Without them where the plug-in does not offer ``locate``.
    """
    pictures = modality.illustrate(frame, calibration)
    locate = getattr(modality, "locate", None)
    if locate is None:
        return pictures
    strip = modality.unroll(frame, calibration)
    z_mm, places = places_of(strip)
    found = locate(frame.index, places, calibration)
    shape = z_mm.size, places.theta_rad.size // z_mm.size, 2
    return tuple(
        replace(one, seen=Seen(z_mm, np.asarray(found[one.name], np.float64).reshape(shape)))
        if one.name in found
        else one
        for one in pictures
    )


def places_of(strip: Strip) -> tuple[np.ndarray[Any, Any], Places]:
    """Return rows at which a frame shows the wall, float64 (n_z,), and places all around each of them, row by row."""
    n_rows = strip.z_mm.size
    rows = np.unique(np.round(np.linspace(0, n_rows - 1, min(ROWS, n_rows))).astype(np.intp))
    n_theta = COLUMNS if rows.size == 1 else COLUMNS // 4
    theta_rad = 2 * np.pi / n_theta * np.arange(n_theta)
    step_rad = 2 * np.pi / strip.theta_rad.size
    nearest = np.round((theta_rad - strip.theta_rad[0]) / step_rad).astype(np.intp) % strip.theta_rad.size
    depth_mm = np.full((rows.size, n_theta), np.nan)
    if strip.depth_mm is not None:
        at = np.ix_(rows, nearest)
        depth_mm = np.where(strip.valid[at], strip.depth_mm[at], np.nan).astype(np.float64)
    z_mm = np.asarray(strip.z_mm[rows], np.float64)
    places = Places(np.tile(theta_rad, rows.size), np.repeat(z_mm, n_theta), depth_mm.ravel())
    return z_mm, places
