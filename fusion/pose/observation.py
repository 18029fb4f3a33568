"""What a recording shows of the air on the wall and behind it: the layers that a CT is compared with."""

from dataclasses import dataclass, replace

import numpy as np

from endoct.base.arrays import Coordinates, Image, Mask
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import masked_gaussian
from endoct.fusion.evidence.evidence import Evidence, on_grid
from endoct.fusion.evidence.side import Side
from endoct.fusion.geometry.placement import WIDEST_IN_BONE_MM
from endoct.fusion.segmentation.side_cells import segment

ROWS_MM, COLUMNS = 0.2, 64
BLUR_MM = 0.2
"""σ that makes the sharp edges of a recording about as soft as those of a clinical CT."""
LAYERS_MM = (0.1, 0.3, 0.5, 0.8)
"""Depths behind the wall at which a side with depth says whether there is air."""
HIDDEN_MM = 0.25
"""Nothing is known farther behind the surface than this."""
LEAST_KNOWN = 0.3
EVEN_STEPS = 0.03
"""Steps between frames with less relative spread were made by a drive, others found by stitching."""
DRIVEN_STRETCH_MM, STITCHED_STRETCH_MM = 0.02, 0.12
"""How far places along the bore may lie off, apart from the scale of the whole."""
ALIKE_BY_DEPTH_MM, ALIKE_BY_CELLS_MM = 0.5, 0.7
"""Edges err alike over this length: samples that lie closer count as about one. From 14 sparse and 4 other bores of
benchmarks/second_origin, tuning seeds."""
ALONG_BY_DEPTH_MM, ALONG_BY_CELLS_MM = 0.02, 0.075
"""How far the whole lies off along the bore: from twelve such bores, seeds 100 to 111."""
RIMS_BY_DEPTH_MM, RIMS_BY_CELLS_MM = 0.02, 0.15
"""How much farther in or out edges may lie that run across the bore: lamps light the rims away from them."""


@dataclass(frozen=True, eq=False)
class Layer:
    """Air on a cylinder ``behind_mm`` the wall: ``air`` and ``weight``, float32 (n_z, n_theta), 0 to 1 both."""

    behind_mm: float
    air: Image
    weight: Image


@dataclass(frozen=True, eq=False)
class Observation:
    """What one side shows of the air around the bore, columns from θ = 0 on.

    Attributes
    ----------
    stretch_mm: how far its places along the bore may be off, smoothly.
    alike_mm: the length over which its edges err alike.
    along_mm: how far all of its places together may be off along the bore, which no fit can tell.
    rims_mm: how far edges that run across the bore may lie off against others.
    handed, directed: whether the sense of θ and the direction of z are known.
    """

    name: str
    z_mm: Coordinates
    radius_mm: float
    layers: tuple[Layer, ...]
    stretch_mm: float
    alike_mm: float
    along_mm: float
    rims_mm: float
    handed: bool
    directed: bool

    @property
    def middle_mm(self) -> float:
        """The middle of its rows."""
        return float(self.z_mm[[0, -1]].mean())

    @property
    def length_mm(self) -> float:
        """The length from its first to its last row."""
        return float(np.ptp(self.z_mm))


def observe(side: Side, cells: Mask | None = None) -> Observation:
    """Return what ``side`` shows: where it has depth, the air at some depths, else the cells in its intensity.

    ``cells`` are the latter, bool (n_z, n_theta), if they are at hand. Raises :class:`EndoctError` for a bore far wider
    than in bone.
    """
    panorama = side.panorama
    if side.scale != 1:
        raise EndoctError(
            "a pose is found of a bore as wide as those in bone",
            found=f"{2 * panorama.grid.radius_mm:g} mm",
            expected=f"at most {2 * WIDEST_IN_BONE_MM:g} mm",
        )
    rows = np.arange(panorama.z_mm[0], panorama.z_mm[-1] + 1e-9, ROWS_MM)
    evidence = side.evidence
    if evidence.kind == "relief":
        layers = tuple(_layer_at(evidence, behind, rows) for behind in LAYERS_MM)
    else:
        shown = segment(side) if cells is None else cells
        layers = (_layer(evidence, shown.astype(np.float32), evidence.valid.astype(np.float32), rows, 0.0),)
    places = panorama.per_frame[f"{panorama.frame_dim}_z_mm"].values
    steps = np.diff(places)
    driven = steps.size > 1 and float(np.std(steps)) < EVEN_STEPS * float(np.mean(steps))
    return Observation(
        name=side.name,
        z_mm=rows,
        radius_mm=panorama.grid.radius_mm,
        layers=layers,
        stretch_mm=DRIVEN_STRETCH_MM if driven else STITCHED_STRETCH_MM,
        alike_mm=ALIKE_BY_DEPTH_MM if evidence.kind == "relief" else ALIKE_BY_CELLS_MM,
        along_mm=ALONG_BY_DEPTH_MM if evidence.kind == "relief" else ALONG_BY_CELLS_MM,
        rims_mm=RIMS_BY_DEPTH_MM if evidence.kind == "relief" else RIMS_BY_CELLS_MM,
        handed=panorama.handedness_known,
        directed=panorama.travel_known,
    )


def _layer_at(relief: Evidence, behind_mm: float, rows: Coordinates) -> Layer:
    known = relief.valid & (relief.values > behind_mm - HIDDEN_MM)
    return _layer(relief, (relief.values > behind_mm).astype(np.float32), known.astype(np.float32), rows, behind_mm)


def _layer(on: Evidence, air: Image, known: Image, rows: Coordinates, behind_mm: float) -> Layer:
    values = on_grid(replace(on, values=air * known, valid=known > 0), rows, COLUMNS)
    share = on_grid(replace(on, values=known, valid=np.ones(known.shape, np.bool_)), rows, COLUMNS)
    weight = np.where(values.valid, share.values, np.float32(0))
    sigmas = BLUR_MM / ROWS_MM, BLUR_MM / values.column_mm
    blurred = np.clip(masked_gaussian(values.values, weight > LEAST_KNOWN, *sigmas), 0, 1)
    return Layer(behind_mm, blurred, weight)
