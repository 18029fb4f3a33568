"""How cells are separated from the wall."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from endoct.base.entry_points import OURS

OUR_EYE, NO_EYE = "endoct", "off"


class SegmentParameters(BaseModel):
    """How cells are separated from the wall. Lengths in mm on the wall, areas in mm²."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    segmentation_method: str = Field(
        default=OURS, max_length=100, description="method that finds cells, by its name in `endoct bench segmentation`"
    )
    segment: Literal["relief", "intensity"] = Field(
        default="relief", description="what a side with depth is thresholded on; a side without has its intensity only"
    )
    relief_floor_mm: float = Field(default=0.0, ge=-10, le=10, description="relief below this counts as this")
    relief_cap_mm: float = Field(default=0.2, ge=1e-4, le=10, description="relief above this counts as this")
    contrast_floor_sigmas: float = Field(
        default=3.0, ge=0, le=100, description="contrast below this many times the wall's own spread counts as this"
    )
    contrast_cap: float = Field(
        default=0.7, ge=1e-3, le=100, description="|log| of intensity relative to the wall's above this counts as this"
    )
    eye: str = Field(
        default=OUR_EYE,
        max_length=4096,
        description="learned eye that finds an endoscope's cells: `endoct`, the weights of one that `endoct train` "
        "made, or `off`: threshold, outlines and depth do",
    )
    by_depth: bool = Field(
        default=True, description="find cells by an endoscope's depth too, where that is known by parallax"
    )
    outlines: bool = Field(
        default=True, description="take dark cells up to their clearest outline, and no planes for cells; else Li alone"
    )
    smooth_mm: float = Field(default=0.015, ge=0, le=2, description="sigma of the smoothing before the threshold")
    open_mm: float = Field(default=0.03, ge=0, le=2, description="cells narrower than twice this are removed")
    close_mm: float = Field(default=0.03, ge=0, le=2, description="gaps in cells narrower than twice this are closed")
    smallest_mm2: float = Field(
        default=0.01,
        ge=0,
        le=1e4,
        description="smaller cells, and holes in cells, are removed; of cells also those of one or two samples",
    )
