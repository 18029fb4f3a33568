"""The plot of where the cells of two sides agree and where they differ, and its colours."""

from typing import TYPE_CHECKING

from endoct.base.arrays import Mask
from endoct.fusion.scoring.overlap import BOTH, ONLY_A, ONLY_B, difference
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.notebook import draw_wall

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ((0xF4, 0xF4, 0xF2), (0x3A, 0x3A, 0x3A), (0xE6, 0x9F, 0x00), (0x00, 0x72, 0xB2))
"""Red, green, blue of neither, both, only A, only B: Okabe and Ito's, which colour-blind readers can tell apart."""


def draw_difference(axes: "Axes", grid: SurfaceGrid, a: Mask, b: Mask, valid: Mask, names: tuple[str, str]) -> None:
    """Draw where the masks ``a`` and ``b`` (n_z, n_theta) differ into ``axes``, with a legend below."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colours = [(red / 255, green / 255, blue / 255) for red, green, blue in COLOURS]
    draw_wall(axes, grid, difference(a, b, valid), valid, colours=ListedColormap(colours), limits=(-0.5, 3.5))
    shares = zip((BOTH, ONLY_A, ONLY_B), ("both", f"only {names[0]}", f"only {names[1]}"), strict=True)
    handles = [Patch(facecolor=colours[k], label=label) for k, label in shares]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3, frameon=False, fontsize=8)
    axes.set_title("cells", loc="left")
