"""What is known of the cone-mirror endoscope without loading it: its name, its files, its sidecar."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from endoct.modalities.acquisition import Acquisition, Travel
from endoct.modalities.contract import Manifest
from endoct.modalities.recording import IMAGE_SUFFIXES
from endoct.modalities.video import VIDEO_SUFFIXES

Rim = Literal["ahead", "behind"]


class AnnulusKeys(BaseModel):
    """The table ``annulus`` of the sidecar: where the mirror's ring lies in the image, pixels of the files."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    x: float = Field(description="column of its centre")
    y: float = Field(description="row of its centre")
    inner_px: float = Field(gt=0, description="radius of its inner edge")
    outer_px: float = Field(gt=0, description="radius of its outer edge")

    @model_validator(mode="after")
    def _inner_lies_inside(self) -> "AnnulusKeys":
        if self.inner_px >= self.outer_px:
            raise ValueError("an inner_px below outer_px")
        return self


class EndoscopeAcquisition(Acquisition):
    """The sidecar of a cone-mirror endoscope's recording."""

    modality: Literal["endoscope"] = Field(default="endoscope", description="the plug-in that reads this recording")
    travel: Travel = Field(default="in", description="which way the endoscope moved: in, out or unknown")
    feed_pitch_mm: float | None = Field(
        default=None, gt=0, description="nominal feed between frames; the measured feed is judged against it"
    )
    frame_rate_hz: float | None = Field(default=None, gt=0, description="of a video; with feed_speed_mm_s the pitch")
    feed_speed_mm_s: float | None = Field(default=None, gt=0, description="of a video; with frame_rate_hz the pitch")
    visible_length_mm: float | None = Field(
        default=None, gt=0, description="axial length of this bore's wall that the annulus spans; sets mm along z"
    )
    outer_rim: Rim | None = Field(
        default=None,
        description="the wall that the annulus' outer rim shows: ahead (farther in, apex toward the camera) or behind",
    )
    annulus: AnnulusKeys | None = Field(
        default=None, description="x, y, inner_px, outer_px of the mirror's ring, where finding it fails"
    )
    cone_half_angle_deg: float | None = Field(
        default=None,
        gt=0,
        lt=90,
        description="of the mirror; with focal_px and mirror_distance_mm it sets z of a radius",
    )
    focal_px: float | None = Field(default=None, gt=0, description="focal length of the camera, in pixels of the files")
    mirror_distance_mm: float | None = Field(
        default=None, gt=0, description="from the camera's pupil to the cone's apex"
    )
    distortion: tuple[float, ...] = Field(
        default=(), max_length=3, description="radial k1, k2, k3 of the camera, with r/focal_px as the radius"
    )

    @property
    def pitch_mm(self) -> float | None:
        """Nominal feed between frames, mm, > 0; None where the sidecar does not say."""
        if self.feed_pitch_mm is not None:
            return self.feed_pitch_mm
        if self.frame_rate_hz is not None and self.feed_speed_mm_s is not None:
            return self.feed_speed_mm_s / self.frame_rate_hz
        return None


MANIFEST = Manifest(
    name="endoscope",
    title="Cone-mirror endoscope",
    suffixes=(*IMAGE_SUFFIXES, *VIDEO_SUFFIXES),
    acquisition=EndoscopeAcquisition,
    provides=frozenset({"intensity"}),
    frame_dim="frame",
    implementation="endoct.modalities.endoscope.plugin:ENDOSCOPE",
)
