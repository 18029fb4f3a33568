"""Two sides on one grid: what a comparison of two panoramas gives."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from endoct.base.arrays import Image, Mask, readonly
from endoct.base.doubt import Doubt
from endoct.fusion.evidence.light_alone import depth_of_side
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.alignment import Alignment, SearchOutcome
from endoct.fusion.geometry.placement import Sampling
from endoct.fusion.result import ByHand, CuttingPlane, Result
from endoct.fusion.scoring.cells import Cell
from endoct.fusion.scoring.overlap import BOTH, ONLY_A, ONLY_B, Surface, difference
from endoct.fusion.segmentation.segment import Segmentation
from endoct.fusion.segmentation.side_cells import contrast_of
from endoct.stitching.grid import SurfaceGrid, grid_attributes
from endoct.stitching.notebook import card, class_picture, draw_wall, new_wall_axes, wall_picture
from endoct.stitching.panorama import Panorama

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

IMAGES = ("intensity", "depth_mm", "mask", "valid")
"""What a comparison holds of either side, in its store and in xarray."""
COLOURS = ((0xF4, 0xF4, 0xF2), (0x3A, 0x3A, 0x3A), (0xE6, 0x9F, 0x00), (0x00, 0x72, 0xB2))
"""Red, green and blue for neither, both, only A and only B: Okabe and Ito's, for colour-blind readers too."""


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


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedSide(Surface):
    """One side on a common grid in side A's frame, arrays (n_z, n_theta), read-only.

    Attributes
    ----------
    name: the name of the side, numbered where both are of one modality ("oct-1", "oct-2").
    mask, valid: bool, its cells and what it observed. ``labels`` numbers the cells.
    intensity: float32, 0 where not valid.
    depth_mm: float32, NaN where the side has none.
    planes: those that cut the bore, such as fractures, which are no cells.
    source, cells: the side on its own samples, and its cells there. They are None where the comparison was read from
        a store, as are ``relief_mm``, ``relief_error_mm`` and ``contrast``.
    """

    intensity: Image
    depth_mm: Image
    planes: tuple[CuttingPlane, ...] = ()
    source: Side | None = None
    cells: Segmentation | None = None

    def __repr__(self) -> str:
        cells = (self.mask & self.valid).sum() / max(1, self.valid.sum())
        return f"<PlacedSide {self.name}: {cells:.1%} of it cells, {self.valid.mean():.1%} valid>"

    def __post_init__(self) -> None:
        dtypes = {"intensity": np.float32, "depth_mm": np.float32, "mask": np.bool_, "valid": np.bool_}
        for name, dtype in dtypes.items():
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))


@dataclass(frozen=True, eq=False)
class Placed:
    """Both sides on one ``grid`` in side A's frame, A first, before they are scored.

    Attributes
    ----------
    sides: as they lie on the grid; B by its nominal orientation where no ``outcome`` aligned it.
    both, cells, samplings: each on its own samples, its cells there, and how these lie in A's frame.
    outcome, by_hand, doubts: where B lies, what landmark pairs say of that, and what speaks against a method.
    notes: what is to be known, by side.
    """

    grid: SurfaceGrid
    sides: tuple[PlacedSide, PlacedSide]
    both: tuple[Side, Side]
    cells: tuple[Segmentation, Segmentation]
    samplings: tuple[Sampling, Sampling]
    outcome: SearchOutcome
    by_hand: ByHand | None = None
    doubts: tuple[Doubt, ...] = ()
    notes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Both sides on one grid in side A's frame.

    Attributes
    ----------
    grid: covers the rows of both sides.
    sides: A first.
    alignment: where B lies in A's frame; None where that could not be found.
    reason: why not, in a full sentence; None where it was found.
    result: what ``result.json`` says. :func:`~endoct.fusion.comparison.compare_panoramas` gives only what fusion knows.
    cells: the cells of both sides as objects, A's first. Empty where it was read from a store of a version without
        them.
    wall: the one wall of both sides (:meth:`~endoct.fusion.wall.wall.Wall.as_panorama`), depth behind the bore's wall;
        None where there is none.
    """

    grid: SurfaceGrid
    sides: tuple[PlacedSide, PlacedSide]
    alignment: Alignment | None
    reason: str | None
    result: Result
    cells: tuple[Cell, ...] = ()
    wall: Panorama | None = None

    @property
    def names(self) -> tuple[str, str]:
        """Names of the sides, A first."""
        return self.sides[0].name, self.sides[1].name

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """What speaks against the comparison, its alignment and its sides; empty where nothing does."""
        return self.result.doubts

    def __repr__(self) -> str:
        return f"<Comparison of {' and '.join(self.names)}: {self._agreement()}>"

    def _repr_html_(self) -> str:
        (a, b), both = self.sides, self.sides[0].valid & self.sides[1].valid
        pictures = [(side.name, wall_picture(self.grid, side.intensity, side.valid)) for side in self.sides]
        if self.alignment is not None:
            legend = f"cells: both grey, only {a.name} orange, only {b.name} blue"
            pictures.append((legend, class_picture(self.grid, difference(a.mask, b.mask, both), COLOURS, both)))
        facts = {
            "agreement": self._agreement(),
            "rows × columns": f"{self.grid.n_z} × {self.grid.n_theta} (z, θ)",
            "valid": ", ".join(f"{side.name} {side.valid.mean():.1%}" for side in self.sides),
        }
        if self.doubts:
            facts["doubts"] = " ".join(doubt.text for doubt in self.doubts)
        return card(f"Comparison of {' and '.join(self.names)}", facts, pictures)

    def _agreement(self) -> str:
        """Return how well the sides agree, or why that cannot be said, in a few words."""
        if self.alignment is None:
            return f"not aligned: {self.reason}"
        overlap = self.result.overlap
        if overlap is None or overlap.is_empty:
            return "aligned, nothing to score"
        low_high = overlap.jaccard_interval
        return f"Jaccard index {overlap.jaccard:.3f}" + (
            f" ({low_high[0]:.3f} to {low_high[1]:.3f})" if low_high else ""
        )

    def to_xarray(self) -> "xarray.Dataset":
        """Return the comparison as ``xarray.open_zarr`` reads its store: dims (side, z, theta), in mm and rad.

        Variables ``intensity``, ``depth_mm``, NaN where a side has none, ``mask``, its cells, and ``valid``.
        """
        import xarray

        dims = ("side", "z", "theta")
        images = {name: (dims, np.stack([getattr(side, name) for side in self.sides])) for name in IMAGES}
        places = {
            "z": ("z", self.grid.z_mm, {"units": "mm"}),
            "theta": ("theta", self.grid.theta_rad, {"units": "rad"}),
        }
        return xarray.Dataset(images, {"side": list(self.names), **places}, grid_attributes(self.grid))

    def plot(self) -> "list[Axes]":
        """Plot both sides, and where aligned their cells, in a new figure; return the axes, side A's first.

        z in mm against θ in degrees; what was not observed stays pale blue. Needs matplotlib only when it is called.
        """
        (a, b), both = self.sides, self.sides[0].valid & self.sides[1].valid
        axes = new_wall_axes(self.grid, 2 if self.alignment is None else 3)
        for side, one in zip(self.sides, axes, strict=False):
            draw_wall(one, self.grid, side.intensity, side.valid)
            one.set_title(side.name, loc="left")
        if self.alignment is not None:
            draw_difference(axes[2], self.grid, a.mask, b.mask, both, self.names)
        axes[0].figure.suptitle(self._agreement(), wrap=True)
        return axes


def place(side: Side, cells: Segmentation, sampling: Sampling, grid: SurfaceGrid) -> PlacedSide:
    """Return a side with its ``cells`` on ``grid``; ``sampling`` says where its samples lie."""
    panorama, placement = side.panorama, sampling.onto(grid)
    intensity, valid = placement.image(panorama.intensity, panorama.valid)
    relief_mm, relief_error_mm = (
        None if of is None else np.float32(side.scale) * placement.known(of, np.isfinite(of))
        for of in _own_relief(side, cells)
    )
    contrast, depth_mm = contrast_of(side, cells), panorama.depth_mm
    nowhere = np.full(grid.shape, np.nan, np.float32)
    return PlacedSide(
        name=side.name,
        mask=placement.mask(cells.mask, panorama.valid)[0],
        valid=valid,
        relief_mm=relief_mm,
        relief_error_mm=relief_error_mm,
        contrast=None if contrast is None else placement.known(contrast.values, contrast.valid),
        intensity=intensity,
        depth_mm=nowhere if depth_mm is None else placement.known(depth_mm, panorama.valid & np.isfinite(depth_mm)),
        planes=tuple(plane.moved(sampling.where) for plane in cells.planes),
        source=side,
        cells=cells,
    )


def _own_relief(side: Side, cells: Segmentation) -> tuple[Image | None, Image | None]:
    """Return relief ``in_reference`` on a side's own samples, and its standard error where it was not measured.

    Where parallax was looked for, the depth of dark cells is by all that light shows, in bores as wide as those in
    bone. NaN where it is not known; None where it is known nowhere.
    """
    own = side.in_reference
    if own.relief is not None:
        return np.where(own.relief.valid, own.relief.values, np.float32(np.nan)), None
    if own.panorama.parallax_depth_mm is None:
        return None, None
    by_light = side.scale == 1 and cells.polarity == "dark"
    relief_mm, error_mm = depth_of_side(own, cells.mask if by_light else np.zeros_like(cells.mask))
    return (relief_mm, error_mm) if np.isfinite(relief_mm).any() else (None, None)
