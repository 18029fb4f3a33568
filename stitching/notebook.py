"""What notebooks show of panoramas and comparisons: a few lines of HTML with small pictures in them."""

import base64
import html
import io
import math
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from endoct.base.arrays import Image, Mask
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.wall_plot import evenly_spaced_rows

WIDTH_PX, HEIGHT_PX = 180, 160
COLOURS = 16
"""Colours in a picture: so few that it takes some kB."""
NOT_OBSERVED_RGB = np.array([0xB9, 0xD0, 0xF2], dtype=np.uint8)


def wall_picture(grid: SurfaceGrid, values: Image, valid: Mask) -> bytes:
    """Return a small PNG of ``values`` (n_z, n_theta), dark to bright: θ across, z inward from the top down."""
    mean, observed = _coarse(grid, values, valid)
    low, high = np.percentile(mean[observed], [1, 99]) if observed.any() else (0.0, 1.0)
    grey = np.clip(255 * (mean - low) / max(high - low, 1e-12), 0, 255).astype(np.uint8)
    return _png(np.where(observed[..., None], grey[..., None], NOT_OBSERVED_RGB))


def class_picture(
    grid: SurfaceGrid, classes: NDArray[np.int8], colours: Sequence[tuple[int, int, int]], valid: Mask
) -> bytes:
    """Return a small PNG of ``classes`` (n_z, n_theta), each in its colour of ``colours`` (red, green, blue)."""
    parts = [_coarse(grid, (classes == k).astype(np.float32), valid) for k in range(len(colours))]
    shares, observed = np.stack([share for share, _ in parts], axis=-1), parts[0][1]
    mixed = np.rint(shares @ np.array(colours, dtype=np.float32))
    return _png(np.where(observed[..., None], mixed, NOT_OBSERVED_RGB).astype(np.uint8))


def card(title: str, facts: Mapping[str, str], pictures: Sequence[tuple[str, bytes]]) -> str:
    """Return HTML of a title, a table of facts and captioned PNG pictures; every text is escaped."""
    rows = "".join(
        f'<tr><td style="text-align:left;color:gray">{html.escape(name)}</td>'
        f'<td style="text-align:left">{html.escape(value)}</td></tr>'
        for name, value in facts.items()
    )
    figures = "".join(
        f'<figure style="margin:0 1em 0 0;max-width:{WIDTH_PX}px"><img alt="{html.escape(caption)}" '
        f'src="data:image/png;base64,{base64.b64encode(png).decode()}">'
        f'<figcaption style="font-size:smaller">{html.escape(caption)}</figcaption></figure>'
        for caption, png in pictures
    )
    return (
        f'<div><strong>{html.escape(title)}</strong><div style="display:flex;flex-wrap:wrap;align-items:flex-start">'
        f"{figures}<table>{rows}</table></div></div>"
    )


def _coarse(grid: SurfaceGrid, values: Image, valid: Mask) -> tuple[Image, Mask]:
    """Return the mean of the valid values on the pixels of a small picture, and where it has any."""
    rows = evenly_spaced_rows(grid)
    turn = round(grid.theta0_rad / grid.dtheta_rad)
    usable = np.roll(valid[rows], turn, axis=1) & np.isfinite(values := np.roll(values[rows], turn, axis=1))
    length_mm, around_mm = rows.size * grid.dz_mm, 2 * math.pi * grid.radius_mm
    height_px = round(min(HEIGHT_PX, max(40, WIDTH_PX * length_mm / around_mm)))
    size = WIDTH_PX, height_px
    total = cv2.resize(np.where(usable, values, np.float32(0)), size, interpolation=cv2.INTER_AREA)
    share = cv2.resize(usable.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    observed: Mask = share > 0.5
    return np.where(observed, total / np.maximum(share, 1e-6), 0).astype(np.float32), observed


def _png(rgb: NDArray[np.uint8]) -> bytes:
    png = io.BytesIO()
    Pillow.fromarray(rgb).quantize(COLOURS).save(png, "PNG", optimize=True)
    return png.getvalue()
