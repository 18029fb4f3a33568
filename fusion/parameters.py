"""How two sides are compared."""

from typing import Literal

from pydantic import Field

from endoct.base.entry_points import OURS
from endoct.fusion.segmentation.parameters import SegmentParameters


class CompareParameters(SegmentParameters):
    """How two sides are compared: the parameters of segmentation, and those of alignment and of the grid."""

    alignment_method: str = Field(
        default=OURS, max_length=100, description="method that aligns, by its name in `endoct bench alignment`"
    )
    dz_mm: float | None = Field(
        default=None,
        ge=1e-4,
        le=10,
        description="row distance of the common grid; left out, the finer side's, not under 0.02 mm",
    )
    n_theta: int = Field(default=2048, ge=16, le=65536, description="columns of the common grid")
    z_scale_min: float = Field(default=0.95, gt=0.5, le=1, description="least scale of B's z against A's to search")
    z_scale_max: float = Field(default=1.05, ge=1, lt=2, description="largest scale of B's z against A's to search")
    polarity: Literal["auto", "dark", "bright"] = Field(
        default="auto",
        description="how cells look to a side without depth; auto: by its correlation with the other side",
    )
    tolerance_mm: float = Field(
        default=0.1, ge=1e-4, le=10, description="outlines nearer to each other than this count as one"
    )
    force: bool = Field(default=False, description="believe the best alignment however little it stands out")
