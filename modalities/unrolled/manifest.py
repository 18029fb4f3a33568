"""What is known of unrolled images without loading what reads them: their name, their files, their sidecar."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from endoct.modalities.acquisition import Acquisition, Handedness, OneOf, Travel, positive
from endoct.modalities.contract import Manifest
from endoct.modalities.reading.recording import IMAGE_SUFFIXES
from endoct.stitching.panorama import AxialScale
from endoct.stitching.per_frame import Meaning

LARGEST_BORE_MM = 2000.0
TABLE_SUFFIXES = (".csv", ".tsv", ".txt")
LOG_SUFFIXES = (".las", ".dlis")
Pixel = Annotated[int, Field(ge=0, le=1_000_000)]


class UnrolledAcquisition(Acquisition):
    """The sidecar of an image whose columns run once around a bore and whose rows run along it."""

    alternatives: ClassVar[tuple[OneOf, ...]] = (
        OneOf((("intensity_file",), ("depth_file",)), "what the files show"),
        OneOf((("row_pitch_mm",), ("positions_mm",), ("z_column_mm",)), "the scale along the bore"),
    )

    modality: Literal["unrolled"] = Field(description="the plug-in that reads this recording")
    bore_diameter_mm: float = Field(
        ge=0.1, le=LARGEST_BORE_MM, description="nominal diameter of the drill hole; sets mm along θ"
    )
    travel: Travel = Field(description="which way rows run from the first on: in (away from the mouth), out or unknown")
    handedness: Handedness = Field(
        description="same: columns run with θ, clockwise for who looks in; mirrored: against it; unknown: comparing "
        "tries both"
    )
    theta_origin_rad: float = Field(ge=-1000, le=1000, description="θ of the first column; 0 where θ begins there")
    intensity_file: str | None = Field(
        default=None, max_length=255, description="name of the file beside the sidecar that shows brightness"
    )
    depth_file: str | None = Field(
        default=None, max_length=255, description="name of the file beside the sidecar that shows depth or distance"
    )
    intensity_curve: str | None = Field(
        default=None, max_length=255, description="of a log with several images: the one that shows brightness"
    )
    depth_curve: str | None = Field(
        default=None, max_length=255, description="of a log with several images: the one that shows depth or distance"
    )
    row_pitch_mm: float | None = Field(
        default=None, ge=1e-4, le=1000, description="distance between two rows along the bore"
    )
    z_column_mm: float | None = Field(
        default=None,
        ge=1e-4,
        le=1e6,
        description="the first column of a table, or a log's index, says where rows lie, in units of so many mm; 1000 "
        "for metres",
    )
    brighter: Literal["larger", "smaller"] = Field(
        default="larger", description="whether larger or smaller values of the intensity are brighter"
    )
    deeper: Literal["larger", "smaller"] | None = Field(
        default=None, description="whether larger or smaller values of the depth lie farther from the axis"
    )
    depth_mm_per_count: float | None = Field(
        default=None, ge=1e-9, le=1000, description="depth or distance that one count of the depth is"
    )
    travel_time_us_per_count: float | None = Field(
        default=None,
        ge=1e-9,
        le=1000,
        description="two-way travel time that one count of the depth is, in µs; with velocity_m_s it gives distance",
    )
    velocity_m_s: float | None = Field(
        default=None, ge=1, le=3e8, description="velocity of what travels, in what fills the bore: 1480 in water"
    )
    centred: bool | None = Field(
        default=None,
        description="true: depth counts from the bore's axis or wall; false: from a probe that may lie off the axis, "
        "whose sine is taken off every turn",
    )
    zero_depth_mm: float | None = Field(
        default=None,
        ge=-1e6,
        le=1e6,
        description="depth behind the nominal wall at a count of 0; left out, the typical wall has depth 0",
    )
    rows: tuple[Pixel, Pixel] | None = Field(
        default=None, description="first and last row that show the wall, counted from 0; the others are padding"
    )
    columns: tuple[Pixel, Pixel] | None = Field(
        default=None, description="first and last column of the turn, counted from 0; the others are padding"
    )
    dead_columns: tuple[Pixel, ...] = Field(
        default=(), max_length=100_000, description="columns of the files that show nothing, counted from 0"
    )
    invalid_values: tuple[float, ...] = Field(
        default=(), max_length=100, description="values that say that nothing was observed, such as -999.25"
    )

    @property
    def mm_per_count(self) -> float:
        """How much farther from the axis a count more is, mm; negative where smaller values lie deeper."""
        sign = -1.0 if self.deeper == "smaller" else 1.0
        if self.depth_mm_per_count is not None:
            return sign * self.depth_mm_per_count
        return sign * (self.travel_time_us_per_count or 0.0) * (self.velocity_m_s or 0.0) / 2000

    @property
    def axial_scale(self) -> AxialScale:
        """The pitch of rows, or the unit of their column; nothing in an unrolled image measures either."""
        if self.positions_mm is not None:
            return AxialScale()
        key = "row_pitch_mm" if self.row_pitch_mm is not None else "z_column_mm"
        value: float | None = getattr(self, key)
        return AxialScale({} if value is None else {key: value})

    @classmethod
    def measures(cls, keys: Mapping[str, Any], n_frames: int, shape: tuple[int, ...]) -> dict[str, str]:
        """Return the size of a column and the length of the image, as far as ``keys`` say them."""
        del n_frames
        said = {"a turn": f"{shape[1]} columns, {360 / shape[1]:.3g}° each"}
        if bore := positive(keys, "bore_diameter_mm"):
            said["a turn"] += f", {math.pi * bore[0] / shape[1]:.3g} mm on the wall"
        if pitch := positive(keys, "row_pitch_mm"):
            said["length"] = f"{(shape[0] - 1) * pitch[0]:.4g} mm, {pitch[0]:g} mm from row to row"
        return said

    @model_validator(mode="after")
    def _says_enough(self) -> Self:
        if self.intensity_file is None and self.depth_file is None:
            raise ValueError("intensity_file or depth_file, or both, to name what shows the wall")
        if sum(key is not None for key in (self.row_pitch_mm, self.positions_mm, self.z_column_mm)) != 1:
            raise ValueError("one of row_pitch_mm, positions_mm and z_column_mm, to say where rows lie")
        if self.depth_file is not None:
            in_time = self.travel_time_us_per_count is not None and self.velocity_m_s is not None
            if in_time == (self.depth_mm_per_count is not None):
                raise ValueError(
                    "for a depth_file depth_mm_per_count, or travel_time_us_per_count with velocity_m_s, but not both"
                )
            for key in ("deeper", "centred"):
                if getattr(self, key) is None:
                    raise ValueError(f"for a depth_file also {key}")
        for key in ("rows", "columns"):
            span: tuple[int, int] | None = getattr(self, key)
            if span is not None and span[0] > span[1]:
                raise ValueError(f"{key} whose first is not behind their last")
        return self


MANIFEST = Manifest(
    name="unrolled",
    title="Image that is already unrolled",
    suffixes=(*IMAGE_SUFFIXES, ".npy", *TABLE_SUFFIXES, *LOG_SUFFIXES),
    acquisition=UnrolledAcquisition,
    provides=frozenset({"intensity", "depth"}),
    frame_dim="row",
    implementation="endoct.modalities.unrolled.plugin:UNROLLED",
    per_frame={
        "sine_amplitude_mm": Meaning("amplitude A of the sine fitted to the wall", "mm"),
        "sine_phase_rad": Meaning("phase φ of the sine fitted to the wall", "rad"),
        "sine_offset_mm": Meaning("mean depth D of the sine fitted to the wall", "mm"),
        "residual_mm": Meaning("spread of the wall about its sine", "mm"),
        "beam_noise_mm": Meaning("noise from beam to beam", "mm"),
        "inlier_fraction": Meaning("share of beams that show the sine", usual=(0.5, 1.0)),
        "bridged": Meaning("bridged", trusted_when=False),
    },
)
