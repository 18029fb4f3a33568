"""Cells of one side: thresholded evidence, cleaned on the circle."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from endoct.fusion.evidence.evidence import Evidence, Polarity
from endoct.fusion.evidence.prepare import prepare
from endoct.fusion.segmentation.outlines import Outlining, clearest_regions
from endoct.fusion.segmentation.regions import morphology, remove_small
from endoct.fusion.segmentation.threshold import li_threshold
from endoct.stitching.arrays import Mask
from endoct.stitching.circle import masked_gaussian
from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama


class SegmentParameters(BaseModel):
    """How cells are told from wall. Lengths in mm on the wall, areas in mm²."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    segment: Literal["relief", "intensity"] = Field(
        default="relief", description="what a side with depth is thresholded on; a side without has its intensity only"
    )
    relief_floor_mm: float = Field(default=0.0, ge=-10, le=10, description="relief below this counts as this")
    relief_cap_mm: float = Field(default=0.2, ge=1e-4, le=10, description="relief above this counts as this")
    contrast_cap: float = Field(
        default=1.5, ge=1e-3, le=100, description="|log| of intensity relative to the wall's above this counts as this"
    )
    outlines: bool = Field(
        default=True, description="take dark cells up to where their outline is clearest; else Li alone"
    )
    smooth_mm: float = Field(default=0.015, ge=0, le=2, description="sigma of the smoothing before the threshold")
    open_mm: float = Field(default=0.03, ge=0, le=2, description="cells narrower than twice this are removed")
    close_mm: float = Field(default=0.03, ge=0, le=2, description="gaps in cells narrower than twice this are closed")
    smallest_mm2: float = Field(
        default=0.01, ge=0, le=1e4, description="smaller cells, and holes in cells, are removed"
    )


MOST_NOISE = 0.04
"""Above this ``noise_share``, Jaccard indices against the truth were under 0.7, mostly under 0.5."""

MOST_CELLS = 0.6
"""A wall of which more than this is cells is taken for one that was not found: bores have 0.08 to 0.3."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """Cells of one side on its own samples.

    ``mask`` is bool (n_z, n_theta), False where nothing was observed; ``threshold`` is in ``unit`` of ``of``, None
    where the mask was given; ``polarity`` is None where depth or a mask says what is a cell. ``noise_share``: samples
    as far in front of the wall as cells lie behind it, over those; ``cells_share``: cells, over what was observed.
    """

    mask: Mask
    threshold: float | None
    unit: str
    of: str
    polarity: Polarity | None
    noise_share: float = 0.0
    cells_share: float = 0.0

    @property
    def doubt(self) -> str | None:
        """Why these are not to be trusted as cells, in a full sentence; None where nothing speaks against them."""
        if self.noise_share > MOST_NOISE:
            return (
                f"What was taken for cells may be noise: {self.noise_share:.0%} as many samples lie as far in front of "
                "the wall, where nothing can be."
            )
        if self.cells_share > MOST_CELLS:
            return f"The wall may not have been found: {self.cells_share:.0%} of it was taken for cells."
        return None


def segment(panorama: Panorama, parameters: SegmentParameters | None = None, *, polarity: Polarity = "dark") -> Mask:
    """Return the cells of ``panorama`` on its own samples, bool (n_z, n_theta), False where it is not valid.

    ``polarity`` says whether cells are dark or bright where there is only intensity to tell them by. Raises
    :class:`EndoctError` where nothing is valid or the evidence is constant.
    """
    parameters = parameters or SegmentParameters()
    return find_cells(prepare(panorama, prefer=parameters.segment, polarity=polarity), parameters).mask


def find_cells(evidence: Evidence, parameters: SegmentParameters) -> Segmentation:
    """Return the cells that ``evidence`` shows: Li's threshold, then opening, closing, and small ones removed.

    Evidence that is a mask is taken as it is. Raises :class:`EndoctError` where all evidence is alike.
    """
    p = parameters
    polarity: Polarity | None = None
    if evidence.kind == "mask":
        return Segmentation(evidence.valid & (evidence.values > 0.5), None, "1", "mask as given", None)
    if evidence.kind == "relief":
        low, high, unit = p.relief_floor_mm, p.relief_cap_mm, "mm"
        of = f"relief behind the wall, floored at {low:g} and capped at {high:g} mm"
    else:
        polarity = "dark" if evidence.kind == "darkness" else "bright"
        low, high, unit = 0.0, p.contrast_cap, "1"
        sign = "−log" if polarity == "dark" else "log"
        of = f"{sign} of intensity relative to the wall's, floored at 0 and capped at {high:g}"
    smooth = masked_gaussian(
        evidence.values, evidence.valid, p.smooth_mm / evidence.dz_mm, p.smooth_mm / evidence.column_mm
    )
    prepared = np.clip(smooth, low, high)
    try:
        threshold = li_threshold(prepared[evidence.valid])
    except EndoctError as error:
        raise EndoctError(
            "a side shows no cells to threshold", found=error.found, expected="wall and cells that differ"
        ) from error
    mask = clean(evidence.valid & (prepared > threshold), evidence.dz_mm, evidence.column_mm, p) & evidence.valid
    if p.outlines and evidence.kind == "darkness":
        outlining = Outlining(p.open_mm, p.close_mm, p.smallest_mm2)
        clear = clearest_regions(evidence, prepared, threshold, outlining)
        if clear is not None:
            mask = clear
            of += ", cells up to their clearest outline"
    behind, before = (int(np.count_nonzero(evidence.valid & (side > threshold))) for side in (smooth, -smooth))
    cells_share = float(mask[evidence.valid].mean())
    return Segmentation(mask, threshold, unit, of, polarity, before / max(behind, 1), cells_share)


def clean(mask: Mask, dz_mm: float, column_mm: float, parameters: SegmentParameters) -> Mask:
    """Return ``mask`` opened, closed, and without cells and holes smaller than ``smallest_mm2``."""
    p = parameters
    mask = morphology(mask, "open", p.open_mm / dz_mm, p.open_mm / column_mm)
    mask = morphology(mask, "close", p.close_mm / dz_mm, p.close_mm / column_mm)
    smallest_px = p.smallest_mm2 / (dz_mm * column_mm)
    mask = remove_small(mask, smallest_px)
    return ~remove_small(~mask, smallest_px)
