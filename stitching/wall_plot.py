"""Plots of a bore wall for notebooks and scripts: z in mm against θ in degrees."""

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image, Mask
from endoct.stitching.grid import SurfaceGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

NOT_OBSERVED = "#b9d0f2"
TALLEST_IN, NARROWEST_IN = 7.0, 2.2
COLUMNS = 1024
"""Most pixels a plot has across; more cannot be told apart on a screen."""


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
    low, high = limits or _percentiles(drawn)
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


def _percentiles(values: "np.ma.MaskedArray[tuple[int, ...], np.dtype[np.float32]]") -> tuple[float, float]:
    observed = values.compressed()
    observed = observed[np.isfinite(observed)]
    if not observed.size:
        return 0.0, 1.0
    low, high = (float(value) for value in np.percentile(observed, [0.5, 99.5]))
    return (low, high) if high > low else (low - 0.5, low + 0.5)
