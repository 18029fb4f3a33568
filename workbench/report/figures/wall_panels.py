"""Panels of the unrolled wall: θ across, z down, drawn to scale, hatched where nothing was observed.

To scale: one millimetre of arc is as long as one millimetre of z.
"""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import PcolorImage
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.transforms import blended_transform_factory
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.base.numeric.circle import largest_divisor
from endoct.stitching.grid import SurfaceGrid
from endoct.workbench.report.figures.drawing import (
    DPI,
    HATCH,
    NOT_OBSERVED,
    PAGE_WIDTH_IN,
    bar_under,
    hatch_not_observed,
    new_figure,
    place,
    width_of,
    wrapped,
)

MAX_PANEL_HEIGHT_IN = 6.6
LEFT_IN, GAP_IN = 0.5, 0.22
"""Room for the labels left of the first panel of the wall, and between two."""
ABOVE_PT = 21.0
"""Distance from a panel of the wall to its title: the arc's scale lies between."""


def z_stretch(grid: SurfaceGrid) -> float:
    """Return how many times longer z is drawn than the arc: 1 unless the wall is too short to be drawn to scale."""
    return max(1.0, 0.2 * 2 * math.pi * grid.radius_mm / (grid.n_z * grid.dz_mm))


def scale_text(grid: SurfaceGrid) -> str:
    """Return the words with which a caption says how a panel of ``grid`` is scaled."""
    stretch = z_stretch(grid)
    return "drawn to scale" if stretch == 1 else f"z drawn {stretch:.3g} times longer than the arc"


def panel_figure(grid: SurfaceGrid, n_panels: int) -> tuple[Figure, list[Axes]]:
    """Return a figure with ``n_panels`` panels of the wall side by side, as large as the page allows."""
    length_mm, around_mm = grid.n_z * grid.dz_mm * z_stretch(grid), 2 * math.pi * grid.radius_mm
    width_in = (PAGE_WIDTH_IN - LEFT_IN - 0.1 - (n_panels - 1) * GAP_IN) / n_panels
    width_in = min(width_in, MAX_PANEL_HEIGHT_IN * around_mm / length_mm, 3.6)
    width_in = max(width_in, 0.9)
    height_in = width_in * length_mm / around_mm
    figure = new_figure(LEFT_IN + n_panels * (width_in + GAP_IN), height_in + 0.3)
    return figure, [place(figure, LEFT_IN + k * (width_in + GAP_IN), 0.0, width_in, height_in) for k in range(n_panels)]


def wall_panel(axes: Axes, grid: SurfaceGrid, title: str, *, first: bool = True) -> None:
    """Set up ``axes`` as a panel of the wall: θ in degrees below, arc in mm above, z downwards; hatched = no data."""
    top, bottom = grid.z0_mm - grid.dz_mm / 2, grid.z0_mm + (grid.n_z - 0.5) * grid.dz_mm
    axes.set_xlim(0, 360)
    axes.set_ylim(bottom, top)
    axes.set_aspect(z_stretch(grid) / (math.radians(1) * grid.radius_mm))
    axes.set_xticks([0, 90, 180, 270, 360])
    axes.set_xlabel("θ (°)")
    if first:
        axes.set_ylabel("z, inward (mm)")
    else:
        axes.tick_params(labelleft=False)
    axes.set_title(wrapped(title, width_of(axes)), pad=ABOVE_PT)
    hatch_not_observed(axes)
    _arc_scale(axes, grid)
    _scale_bar(axes, grid)


def show_surface(
    axes: Axes,
    grid: SurfaceGrid,
    values: NDArray[Any],
    valid: Mask,
    colours: str | ListedColormap,
    low: float = 0.0,
    high: float = 1.0,
) -> ScalarMappable:
    """Draw ``values`` (n_z, n_theta) where ``valid`` into a :func:`wall_panel`; return what a colour bar needs."""
    mapping = ScalarMappable(Normalize(low, high), colours)
    # coloured here: matplotlib would hold several float copies of the image
    rgba = mapping.to_rgba(np.where(valid, values, low), bytes=True)
    rgba[..., 3] = np.where(valid, 255, 0)
    edges_deg = np.linspace(0.0, 360.0, grid.n_theta + 1)
    edges_mm = grid.z0_mm + grid.dz_mm * (np.arange(grid.n_z + 1) - 0.5)
    to_zero = round(float(np.mod(grid.theta0_rad, 2 * math.pi)) / grid.dtheta_rad)
    turned = np.roll(rgba, to_zero, axis=1)
    # the nearest sample of every pixel, as imshow has it too, which makes floats of all samples first
    axes.add_image(PcolorImage(axes, edges_deg, edges_mm, turned))
    return mapping


def thinned(grid: SurfaceGrid, *arrays: NDArray[Any]) -> list[Any]:
    """Return [a coarser grid, the arrays on it], as fine as a printed panel can show.

    Boolean arrays keep what the majority of a block is; numbers are averaged over a block's finite samples.
    """
    pixel_mm = max(grid.n_z * grid.dz_mm / 1650, 2 * math.pi * grid.radius_mm / 900)
    across = largest_divisor(grid.n_theta, at_most=max(1, math.floor(pixel_mm / grid.dtheta_mm)))
    down = min(grid.n_z, max(1, math.floor(pixel_mm / grid.dz_mm)))
    whole = grid.n_z // down * down
    coarse = SurfaceGrid.full_circle(
        grid.n_z // down,
        grid.n_theta // across,
        z0_mm=grid.z0_mm + (down - 1) / 2 * grid.dz_mm,
        dz_mm=grid.dz_mm * down,
        radius_mm=grid.radius_mm,
        theta0_rad=grid.theta0_rad + (across - 1) / 2 * grid.dtheta_rad,
    )

    def sums(of: NDArray[Any], dtype: type[np.generic]) -> NDArray[Any]:
        total = of[:whole, ::across].astype(dtype)
        for k in range(1, across):  # a few passes of plain addition, a third of the time of a sum over axes
            total += of[:whole, k::across]
        return total if down == 1 else total.reshape(coarse.n_z, down, coarse.n_theta).sum(axis=1)

    thin: list[Any] = [coarse]
    for array in arrays:
        if array.dtype == np.bool_:
            thin.append(2 * sums(array, np.int32) >= down * across)
            continue
        finite = np.isfinite(array)
        total, count = sums(np.where(finite, array, 0), np.float64), sums(finite, np.int32)
        thin.append(np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0))
    return thin


def colour_bar(axes: Axes, image: ScalarMappable, label: str) -> None:
    """Draw a horizontal colour bar with its unit under ``axes``; its ends stand for all beyond them."""
    figure, below_in = axes.figure, 0.47
    paper_in = figure.bbox.height / DPI
    frame = axes.get_position(original=True)
    room = (frame.x0 + 0.05 * frame.width, frame.y0 - (below_in + 0.1) / paper_in, 0.9 * frame.width, 0.1 / paper_in)
    bar_under(figure.add_axes(room), image, wrapped(label, 1.15 * width_of(axes)))


def not_observed_patch() -> Patch:
    """Return the legend's entry for samples that were not observed."""
    return Patch(facecolor=NOT_OBSERVED, edgecolor=HATCH, hatch="//////", label="not observed")


def _arc_scale(axes: Axes, grid: SurfaceGrid) -> None:
    """Draw the arc's length in mm above a panel of the wall, with lines and words: a second axis is far slower."""
    around_mm, wide = 2 * math.pi * grid.radius_mm, width_of(axes)
    step_mm = next((v for v in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50) if wide * v / around_mm >= 0.3), 200)
    at_mm = np.arange(0, around_mm, step_mm)
    above = blended_transform_factory(axes.transData, axes.transAxes)
    axes.plot(
        np.degrees(at_mm / grid.radius_mm), np.ones(at_mm.size), linestyle="none", marker=2, markersize=2.5,
        markeredgewidth=0.6, color="black", transform=above, clip_on=False,
    )  # fmt: skip
    for mm in at_mm:
        _above(axes, f"{mm:g}", float(np.degrees(mm / grid.radius_mm)), 3.5)
    _above(axes, "arc (mm)", 180, 11)


def _above(axes: Axes, text: str, theta_deg: float, points: float) -> None:
    axes.annotate(
        text, (theta_deg, 1), xycoords=("data", "axes fraction"), xytext=(0, points), textcoords="offset points",
        ha="center", va="bottom", fontsize=6, annotation_clip=False,
    )  # fmt: skip


def _scale_bar(axes: Axes, grid: SurfaceGrid) -> None:
    around_mm = 2 * math.pi * grid.radius_mm
    length_mm = max((v for v in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if v <= around_mm / 3.5), default=0.1)
    width = length_mm / around_mm
    bottom, top = axes.get_ylim()
    lift = 0.25 / abs(bottom - top) if abs(bottom - top) > 5 else 0.05
    axes.plot(
        [0.96 - width, 0.96], [lift, lift], transform=axes.transAxes, color="black", linewidth=2.0,
        solid_capstyle="butt", path_effects=[withStroke(linewidth=4.0, foreground="white")], zorder=5,
    )  # fmt: skip
    axes.annotate(
        f"{length_mm:g} mm", (0.96 - width / 2, lift), xytext=(0, 2.5), textcoords="offset points",
        xycoords="axes fraction", ha="center", va="bottom", fontsize=6.5, zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
    )  # fmt: skip


def draw_outline(axes: Axes, grid: SurfaceGrid, share: Image, colour: str) -> None:
    """Outline where ``share`` (n_z, n_theta) on ``grid`` exceeds one half."""
    # one column more on either side, so that outlines run on over the seam
    degrees = np.degrees(grid.theta0_rad + grid.dtheta_rad * np.arange(-1, grid.n_theta + 1))
    padded = np.pad(share, ((0, 0), (1, 1)), mode="wrap")
    if padded.max() > 0.5 > padded.min():
        axes.contour(degrees, grid.z_mm, padded, levels=[0.5], colors=[colour], linewidths=0.7)
