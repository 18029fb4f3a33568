"""How one would find the depth behind an endoscope's wall with what is at hand.

All of them know where the strips lie and how the view slants. Two know brightness alone.
"""

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from scipy import ndimage
from skimage.filters import threshold_li

from endoct.base.arrays import Coordinates, Image
from endoct.base.numeric.circle import gaussian
from endoct.workbench.bench.tasks.depth import Views

DEPTHS_MM: Coordinates = np.arange(-0.1, 1.55, 0.05)
WINDOW_MM = 0.15
LEAST_HEIGHT, FEWEST_ROWS = 64, 6
"""DIS compares pictures of at least this height, and two frames share at least so many rows."""
LIGHT_MM = 0.6
"""Brightness is divided by the light: by itself, blurred over this width."""
LEAST_SPARE = 0.8
TYPICAL_MM = 0.2
"""Median depth of true cells of the simulator's tuning seeds 0 to 5, preset quick."""
DARKNESS = (
    (0.15, 0.225, 0.275, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 1.1),
    (0.0, 0.07, 0.112, 0.168, 0.278, 0.402, 0.457, 0.515, 0.602, 0.724),
)
"""Evened darkness, and the median depth of such samples, mm, of the same seeds."""


def flat(views: Views) -> Image:
    """The nominal wall everywhere: what an endoscope without depth knows."""
    return np.zeros(views.panorama.grid.shape, np.float32)


def li_constant(views: Views) -> Image:
    """Cells by Li's threshold of the evened brightness (scikit-image), all of one typical depth."""
    dark, valid = _darkness(views), views.panorama.valid
    cells = valid & (dark > threshold_li(dark[valid])) if np.ptp(dark[valid]) > 0 else np.zeros_like(valid)
    return np.where(ndimage.binary_opening(cells, iterations=2), TYPICAL_MM, 0.0).astype(np.float32)


def darkness(views: Views) -> Image:
    """The darker the deeper: a curve from evened brightness to depth, learnt on the simulator's tuning seeds."""
    grid = views.panorama.grid
    smooth = gaussian(_darkness(views), 0.04 / grid.dz_mm, 0.04 / grid.dtheta_mm)
    return np.asarray(np.interp(smooth, *DARKNESS), dtype=np.float32)


def plane_sweep(views: Views) -> Image:
    """The depth at which frames agree best: variance of evened brightness over a window, the least one wins."""
    textures = list(_textures(views))
    grid = views.panorama.grid
    costs = np.full((DEPTHS_MM.size, *grid.shape), np.inf, np.float32)
    for k, depth_mm in enumerate(DEPTHS_MM):
        count, total, squares = (np.zeros(grid.shape, np.float32) for _ in range(3))
        for texture, middle_mm in zip(textures, views.frame_z_mm, strict=True):
            place = np.interp(
                grid.z_mm - middle_mm,
                views.from_middle_mm + views.slant * depth_mm,
                views.from_middle_mm,
                left=np.nan,
                right=np.nan,
            )
            moved, known = _at_rows(texture, grid.row_of(place + middle_mm))
            count += known
            total += moved
            squares += moved**2
        between = _windowed((squares - total**2 / np.maximum(count, 1)).astype(np.float32), views)
        spare = _windowed(np.maximum(count - 1, 0), views)  # frames more than one
        costs[k] = np.where(spare > LEAST_SPARE, between / np.maximum(spare, LEAST_SPARE), np.inf)
    best = DEPTHS_MM[np.argmin(costs, axis=0)]
    return np.where(np.isfinite(costs.min(axis=0)), best, np.nan).astype(np.float32)


def optical_flow(views: Views) -> Image:
    """OpenCV's dense flow (DIS) from each frame to the next, over the change of slant that explains it."""
    grid = views.panorama.grid
    textures = list(_textures(views))
    flow: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    weighted, weight = np.zeros(grid.shape, np.float64), np.zeros(grid.shape, np.float64)
    for k in range(len(textures) - 1):
        both = np.isfinite(textures[k]) & np.isfinite(textures[k + 1])
        rows = np.flatnonzero(both.any(axis=1))
        if rows.size < FEWEST_ROWS:
            continue
        # 8 bits, grey where it is not known
        grey = [np.clip(128 + 160 * np.nan_to_num(texture[rows]), 0, 255) for texture in textures[k : k + 2]]
        # θ is a circle; and DIS wants some height
        edge = max(0, LEAST_HEIGHT - rows.size)
        wide = [
            np.pad(np.tile(picture.astype(np.uint8), 3), ((0, edge), (0, 0)), "reflect" if edge < rows.size else "edge")
            for picture in grey
        ]
        along = flow.calc(wide[0], wide[1], None)[: rows.size, grid.n_theta : 2 * grid.n_theta, 1] * grid.dz_mm
        slants = [
            np.interp(grid.z_mm[rows] - views.frame_z_mm[at], views.from_middle_mm, views.slant) for at in (k, k + 1)
        ]
        # what lies behind the wall by d is seen at z − slant · d
        change = (slants[0] - slants[1])[:, np.newaxis]
        depth = along / np.where(np.abs(change) > 0.02, change, np.nan)
        good = both[rows] & np.isfinite(depth)
        seen_at = np.clip(rows[:, np.newaxis] + np.rint(slants[0][:, np.newaxis] * depth / grid.dz_mm), 0, grid.n_z - 1)
        columns = np.broadcast_to(np.arange(grid.n_theta), depth.shape)
        np.add.at(weighted, (seen_at[good].astype(np.intp), columns[good]), (change**2 * depth)[good])
        np.add.at(weight, (seen_at[good].astype(np.intp), columns[good]), np.broadcast_to(change**2, depth.shape)[good])
    smooth = [_windowed(one.astype(np.float32), views) for one in (weighted, weight)]
    return np.where(smooth[1] > 1e-5, smooth[0] / np.maximum(smooth[1], 1e-9), np.nan).astype(np.float32)


def _darkness(views: Views) -> Image:
    """Return minus the logarithm of the brightness over that of the wall around, float32 (n_z, n_theta)."""
    panorama = views.panorama
    logs = np.log(np.where(panorama.valid, np.maximum(panorama.intensity, 1e-3), 1.0)).astype(np.float32)
    wall = np.array(
        [np.percentile(row[ok], 70) if ok.any() else 0.0 for row, ok in zip(logs, panorama.valid, strict=True)]
    )
    sigma = LIGHT_MM / panorama.grid.dz_mm, LIGHT_MM / panorama.grid.dtheta_mm
    bright = gaussian(np.maximum(logs, wall[:, np.newaxis]).astype(np.float32), *sigma)
    return np.asarray(np.where(panorama.valid, bright - logs, 0.0), dtype=np.float32)


def _textures(views: Views) -> Iterator[Image]:
    """Yield each strip's evened logarithm on the panorama's samples, float32 (n_z, n_theta), NaN where not known."""
    grid = views.panorama.grid
    first = grid.row_of([strip.z_mm[0] for strip in views.strips])
    for strip, row in zip(views.strips, np.rint(first).astype(int), strict=True):
        texture = np.full(grid.shape, np.nan, np.float32)
        logs = np.log(np.where(strip.valid, np.maximum(strip.intensity, 1e-3), 1.0)).astype(np.float32)
        light = gaussian(logs, LIGHT_MM / grid.dz_mm, LIGHT_MM / grid.dtheta_mm)
        low, high = max(row, 0), min(row + len(logs), grid.n_z)
        texture[low:high] = np.where(strip.valid, logs - light, np.nan)[low - row : high - row]
        yield texture


def _at_rows(texture: Image, rows: Coordinates) -> tuple[Image, Image]:
    """Return a texture at fractional rows, 0 where it is not known, and 1 where it is."""
    inside = np.isfinite(rows)
    places = np.where(inside, rows, 0.0)
    low = np.clip(places.astype(np.intp), 0, texture.shape[0] - 2)
    share = (places - low)[:, np.newaxis].astype(np.float32)
    moved = texture[low] * (1 - share) + texture[low + 1] * share
    known = np.isfinite(moved) & inside[:, np.newaxis]
    return np.where(known, moved, 0).astype(np.float32), known.astype(np.float32)


def _windowed(image: Image, views: Views) -> Image:
    grid = views.panorama.grid
    return gaussian(image, WINDOW_MM / 2 / grid.dz_mm, WINDOW_MM / 2 / grid.dtheta_mm)
