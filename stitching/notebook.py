"""What notebooks show of panoramas and comparisons: small pictures in a few lines of HTML, and plots of z against θ."""

import base64
import html
import io
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.ranks import robust_limits
from endoct.stitching.grid import SurfaceGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage


WIDTH_PX, HEIGHT_PX = 180, 160
COLOURS = 16
"""A picture has so few colours that it takes some kB."""
NOT_OBSERVED_RGB = np.array([0xB9, 0xD0, 0xF2], dtype=np.uint8)
NOT_OBSERVED = "#b9d0f2"
TALLEST_IN, NARROWEST_IN = 7.0, 2.2
COLUMNS = 1024
"""A plot has at most this many pixels across. More cannot be told apart on a screen."""


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
    from PIL import Image as Pillow  # for notebooks only

    png = io.BytesIO()
    Pillow.fromarray(rgb).quantize(COLOURS).save(png, "PNG", optimize=True)
    return png.getvalue()


def new_wall_axes(grid: SurfaceGrid, panels: int = 1) -> "list[Axes]":
    """Return axes of a new pyplot figure with ``panels`` side by side, in the proportions of the wall."""
    from matplotlib import pyplot as plt

    length_mm, around_mm = grid.z_mm[-1] - grid.z_mm[0] + grid.dz_mm, 2 * math.pi * grid.radius_mm
    width_in = min(4.0, max(NARROWEST_IN, TALLEST_IN * around_mm / length_mm))
    height_in = min(TALLEST_IN, max(1.5, width_in * length_mm / around_mm))
    _, axes = plt.subplots(
        1, panels, figsize=((width_in + 1.4) * panels, height_in + 0.9), squeeze=False, layout="constrained"
    )
    return list(axes[0])


def draw_wall(
    axes: "Axes",
    grid: SurfaceGrid,
    values: Image | NDArray[np.int8],
    valid: Mask,
    *,
    colours: object = "gray",
    limits: tuple[float, float] | None = None,
) -> "AxesImage":
    """Draw ``values`` (n_z, n_theta) into ``axes``: θ from 0° to 360° across, z inward from the top down.

    What is not ``valid`` stays pale blue. ``limits`` of the colours
    are the 0.5th and 99.5th percentile where left out. Returns the image, for a colour bar.
    """
    columns = np.roll(np.arange(grid.n_theta), round(grid.theta0_rad / grid.dtheta_rad) % grid.n_theta)
    columns = columns[:: max(1, grid.n_theta // COLUMNS)]
    cut = np.ix_(evenly_spaced_rows(grid), columns)
    drawn = np.ma.masked_array(np.asarray(values, dtype=np.float32)[cut], ~valid[cut])
    low, high = limits or robust_limits(drawn.data, valid[cut])
    bottom_mm, top_mm = grid.z_mm[-1] + grid.dz_mm / 2, grid.z_mm[0] - grid.dz_mm / 2
    axes.set_facecolor(NOT_OBSERVED)
    image = axes.imshow(
        drawn,
        cmap=colours,  # type: ignore[arg-type]  # a name or a Colormap, whose type only matplotlib knows
        vmin=low,
        vmax=high,
        extent=(0.0, 360.0, bottom_mm, top_mm),
        aspect="auto",
        interpolation="nearest",
    )
    axes.set_xticks([0, 90, 180, 270, 360])
    axes.set_xlabel("θ (°)")
    axes.set_ylabel("z, inward (mm)")
    return image


def evenly_spaced_rows(grid: SurfaceGrid) -> NDArray[np.intp]:
    """Return the indices of the rows nearest to places every ``dz_mm``, for pictures whose rows are even."""
    z_mm, dz_mm = grid.z_mm, grid.dz_mm
    places = np.linspace(z_mm[0], z_mm[-1], max(1, round((z_mm[-1] - z_mm[0]) / dz_mm) + 1))
    after = np.clip(np.searchsorted(z_mm, places), 1, max(1, z_mm.size - 1))
    if z_mm.size == 1:
        return np.zeros(1, dtype=np.intp)
    return np.where(places - z_mm[after - 1] <= z_mm[after] - places, after - 1, after)
