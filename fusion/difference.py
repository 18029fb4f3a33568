"""Where the cells of two sides agree and where they differ, as plots and pictures show it."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Mask
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.wall_plot import draw_wall

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NEITHER, BOTH, ONLY_A, ONLY_B = range(4)
COLOURS = ((0xF4, 0xF4, 0xF2), (0x3A, 0x3A, 0x3A), (0xE6, 0x9F, 0x00), (0x00, 0x72, 0xB2))
"""Red, green, blue of each, from the palette of Okabe and Ito, which colour-blind readers can tell apart."""


def classes_of(a: Mask, b: Mask) -> NDArray[np.uint8]:
    """Return where neither, both, or one of two masks has cells, uint8 of their shape."""
    return np.select([a & b, a, b], [BOTH, ONLY_A, ONLY_B], NEITHER).astype(np.uint8)


def draw_difference(axes: "Axes", grid: SurfaceGrid, a: Mask, b: Mask, valid: Mask, names: tuple[str, str]) -> None:
    """Draw where the masks ``a`` and ``b`` (n_z, n_theta) differ into ``axes``, with a legend below."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colours = [(red / 255, green / 255, blue / 255) for red, green, blue in COLOURS]
    draw_wall(axes, grid, classes_of(a, b), valid, colours=ListedColormap(colours), limits=(-0.5, 3.5))
    shares = zip((BOTH, ONLY_A, ONLY_B), ("both", f"only {names[0]}", f"only {names[1]}"), strict=True)
    handles = [Patch(facecolor=colours[k], label=label) for k, label in shares]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3, frameon=False, fontsize=8)
    axes.set_title("cells", loc="left")
