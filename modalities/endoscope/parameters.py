"""Settings of the endoscope's processing."""

from pydantic import BaseModel, ConfigDict, Field

from endoct.base.entry_points import OURS


class EndoscopeParameters(BaseModel):
    """Processing parameters of the endoscope, all with defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    dz_mm: float | None = Field(
        default=None,
        ge=1e-4,
        le=10,
        description="rows of the panorama; by default the image's own, within 0.02 to 0.05 mm",
    )
    n_theta: int | None = Field(
        default=None, ge=64, le=65536, description="columns of the panorama; by default 2048, 1024 for small images"
    )
    feed_method: str = Field(
        default=OURS,
        max_length=100,
        description="method that finds feed and roll, by its name in `endoct bench stitching`",
    )
    feed_sigma: float = Field(
        default=0.2, ge=1e-3, le=1, description="uncertainty of the nominal feed, relative; three of it are searched"
    )
    correct_feed: bool = Field(
        default=True, description="place frames along the bore by what they show; off: by the nominal feed"
    )
    correct_roll: bool = Field(default=True, description="undo the roll of the probe from frame to frame")
    least_transmission: float = Field(
        default=0.5, ge=0, lt=1, description="dirt on the probe that lets less light through makes a sample invalid"
    )
    taper: float = Field(
        default=0.3, ge=1e-3, le=1, description="part of the visible band over which weights rise and fall"
    )
    probe_offset: bool = Field(default=True, description="correct z and θ for a probe off the bore's axis")
    parallax: bool = Field(default=True, description="find depth by how places move from frame to frame")
    self_calibration: bool = Field(
        default=True, description="find the mirror's cone by the feed where the sidecar does not give its optics"
    )
