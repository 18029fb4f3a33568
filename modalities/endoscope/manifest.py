"""What is known of the cone-mirror endoscope without loading it: its name, its files, its sidecar."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from endoct.modalities.acquisition import Acquisition, OneOf, Travel, positive
from endoct.modalities.contract import Manifest
from endoct.modalities.reading.recording import IMAGE_SUFFIXES
from endoct.modalities.reading.video_container import VIDEO_SUFFIXES
from endoct.stitching.panorama import AxialScale
from endoct.stitching.per_frame import Meaning

Rim = Literal["ahead", "behind"]
MOST_PX = 1e5
LEAST_PITCH_MM, MOST_PITCH_MM = 1e-4, 10.0


class AnnulusKeys(BaseModel):
    """The table ``annulus`` of the sidecar: where the mirror's ring lies in the image, pixels of the files."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    x: float = Field(ge=-MOST_PX, le=MOST_PX, description="column of its centre")
    y: float = Field(ge=-MOST_PX, le=MOST_PX, description="row of its centre")
    inner_px: float = Field(gt=0, le=MOST_PX, description="radius of its inner edge")
    outer_px: float = Field(gt=0, le=MOST_PX, description="radius of its outer edge")

    @model_validator(mode="after")
    def _inner_lies_inside(self) -> "AnnulusKeys":
        if self.inner_px >= self.outer_px:
            raise ValueError("an inner_px below outer_px")
        return self


class EndoscopeAcquisition(Acquisition):
    """The sidecar of a cone-mirror endoscope's recording."""

    alternatives: ClassVar[tuple[OneOf, ...]] = (
        OneOf(
            (
                ("feed_pitch_mm",),
                ("visible_length_mm",),
                ("positions_mm",),
                ("frame_rate_hz", "feed_speed_mm_s"),
                ("cone_half_angle_deg", "focal_px", "mirror_distance_mm"),
            ),
            "the scale along the bore",
        ),
    )

    modality: Literal["endoscope"] = Field(default="endoscope", description="the plug-in that reads this recording")
    travel: Travel = Field(default="in", description="which way the endoscope moved: in, out or unknown")
    feed_pitch_mm: float | None = Field(
        default=None,
        ge=LEAST_PITCH_MM,
        le=MOST_PITCH_MM,
        description="nominal feed between frames; the measured feed is judged against it",
    )
    frame_rate_hz: float | None = Field(
        default=None,
        ge=0.01,
        le=1e5,
        description="frames a second, of a video; with feed_speed_mm_s it gives the pitch",
    )
    feed_speed_mm_s: float | None = Field(
        default=None,
        ge=1e-4,
        le=1000,
        description="speed of the feed, of a video; with frame_rate_hz it gives the pitch",
    )
    visible_length_mm: float | None = Field(
        default=None,
        ge=0.01,
        le=100,
        description="axial length of this bore's wall that the annulus spans; sets mm along z",
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
        ge=1,
        le=89,
        description="half angle of the mirror's cone; with focal_px and mirror_distance_mm it sets z of a radius",
    )
    focal_px: float | None = Field(
        default=None, ge=1, le=1e6, description="focal length of the camera, in pixels of the files"
    )
    mirror_distance_mm: float | None = Field(
        default=None, ge=0.01, le=1000, description="from the camera's pupil to the cone's apex"
    )
    distortion: tuple[Annotated[float, Field(ge=-100, le=100)], ...] = Field(
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

    @classmethod
    def measures(cls, keys: Mapping[str, Any], n_frames: int, shape: tuple[int, ...]) -> dict[str, str]:  # noqa: ARG003
        """Return duration, feed and field of view of a recording, as far as ``keys`` say them."""
        said = {}
        if rate := positive(keys, "frame_rate_hz"):
            said["duration"] = f"{n_frames / rate[0]:.4g} s, {rate[0]:.4g} frames a second"
        pitch = positive(keys, "feed_pitch_mm")
        if pitch is None and (speed := positive(keys, "feed_speed_mm_s", "frame_rate_hz")):
            pitch = (speed[0] / speed[1],)
        if pitch:
            said["length"] = f"{(n_frames - 1) * pitch[0]:.4g} mm of feed, {pitch[0]:.3g} mm from frame to frame"
        if view := positive(keys, "visible_length_mm"):
            said["view"] = f"{view[0]:g} mm of the bore in a frame"
        return said

    @property
    def axial_scale(self) -> AxialScale:
        """The visible length, or else the nominal feed; with the mirror's optics no single key. A feed checks both."""
        optics = None not in (self.cone_half_angle_deg, self.focal_px, self.mirror_distance_mm)
        has_feed = self.pitch_mm is not None or self.positions_mm is not None
        if optics or self.visible_length_mm is not None:
            stated = {} if optics or self.visible_length_mm is None else {"visible_length_mm": self.visible_length_mm}
            return AxialScale(stated, checked=has_feed)
        if self.positions_mm is not None:
            return AxialScale()
        key = "feed_pitch_mm" if self.feed_pitch_mm is not None else "feed_speed_mm_s"
        value: float | None = getattr(self, key)
        return AxialScale({} if value is None else {key: value})

    @model_validator(mode="after")
    def _pitch_is_plausible(self) -> Self:
        if self.pitch_mm is not None and not LEAST_PITCH_MM <= self.pitch_mm <= MOST_PITCH_MM:
            raise ValueError(
                f"feed_speed_mm_s over frame_rate_hz, the feed between frames ({self.pitch_mm:g} mm), must lie within "
                f"{LEAST_PITCH_MM:g} to {MOST_PITCH_MM:g} mm"
            )
        return self


MANIFEST = Manifest(
    name="endoscope",
    title="Cone-mirror endoscope",
    suffixes=(*IMAGE_SUFFIXES, *VIDEO_SUFFIXES, ".npy", ".dcm", ".zarr"),
    acquisition=EndoscopeAcquisition,
    provides=frozenset({"intensity"}),
    frame_dim="frame",
    implementation="endoct.modalities.endoscope.plugin:ENDOSCOPE",
    # usual: what 98 % of the frames have, rounded outward (`quick`, `hard`, `learning`, seeds 11–14)
    per_frame={
        "view_slant": Meaning("slant of the view"),
        "roll_rad": Meaning("roll", "rad"),
        "annulus_x_px": Meaning("centre of the outer rim, column", "px"),
        "annulus_y_px": Meaning("centre of the outer rim, row", "px"),
        "annulus_inner_px": Meaning("radius of the inner rim", "px"),
        "annulus_outer_px": Meaning("radius of the outer rim", "px"),
        "annulus_inner_x_px": Meaning("centre of the inner rim, column", "px"),
        "annulus_inner_y_px": Meaning("centre of the inner rim, row", "px"),
        "annulus_found": Meaning("annulus found", trusted_when=True),
        "feed_mm": Meaning("feed since the frame before", "mm"),
        "pair_correlation": Meaning("correlation with the frame before", usual=(0.4, 1.0)),
        "pair_confidence": Meaning("best match with the frame before, over the next best"),
        "pair_trusted": Meaning("pair trusted", trusted_when=True),
        "exposure": Meaning("brightness against the other frames", usual=(0.9, 1.1)),
        "saturated_fraction": Meaning("share of the wall that is saturated", usual=(0.0, 0.3)),
        "probe_offset_x_mm": Meaning("probe off the axis, towards 0°", "mm"),
        "probe_offset_y_mm": Meaning("probe off the axis, towards 90°", "mm"),
        "valid_fraction": Meaning("share of the frame that is valid", usual=(0.65, 1.0)),
    },
)
