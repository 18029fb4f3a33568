"""The OCT plug-in as the registry sees it before loading it: the keys of its sidecar and what it provides."""

import math
from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from endoct.modalities.acquisition import Acquisition, Handedness, Travel, positive
from endoct.modalities.contract import Manifest
from endoct.modalities.oct.spectra.keys import COUNTS_PER_DB, SpectraKeys
from endoct.stitching.panorama import AxialScale
from endoct.stitching.per_frame import Meaning


class OctAcquisition(Acquisition):
    """The sidecar of a catheter-OCT pullback: pages of (depth, A-scan), one a slice."""

    modality: Literal["oct"] = Field(description="the plug-in that reads this recording")
    axial_pixel_mm: float = Field(
        ge=1e-4, le=0.2, description="distance between two depth samples in air; the scale of every depth"
    )
    pullback_pitch_mm: float = Field(
        ge=1e-4, le=10, description="pullback between two slices; the scale along the bore"
    )
    capillary_outer_diameter_mm: float = Field(
        ge=0.05,
        le=100,
        description="outer diameter of the capillary (or sheath) around the catheter; the ruler for all radii",
    )
    travel: Travel = Field(default="out", description="which way the catheter moved: out (a pullback), in or unknown")
    handedness: Handedness = Field(
        default="unknown", description="same: A-scans run with θ; mirrored: against it; unknown: comparing tries both"
    )
    intensity: Literal["log", "linear"] = Field(
        default="log", description="whether samples are logarithmic (decibels) or linear; never guessed"
    )
    db_per_count: float | None = Field(
        default=None, ge=1e-6, le=100, description="decibels a count, of logarithmic samples"
    )
    scan: Literal["step", "helical"] = Field(
        default="step", description="step: pulled back between turns; helical: pulled back while turning"
    )
    medium_index: float = Field(
        default=1.0, ge=1, le=2, description="refractive index of what fills bore and capillary; 1.33 where flushed"
    )
    first_sample_mm: float | None = Field(
        default=None,
        ge=-1000,
        le=1000,
        description="optical path from the catheter's axis to depth sample 0; only a check on the fit",
    )
    spectra: SpectraKeys | None = Field(
        default=None,
        description="a table: where the raw spectra of a spectrometer or swept source lie, in place of B-scans",
    )

    @property
    def mm_per_px(self) -> float:
        """Distance of two depth samples in the medium, mm."""
        return self.axial_pixel_mm / self.medium_index

    @property
    def axial_scale(self) -> AxialScale:
        """The pitch, unless positions beat it: nothing in a pullback measures it, but a calibration may have."""
        if self.positions_mm:
            return AxialScale()
        measured = "pullback_pitch_mm" in (self.standard_errors or {})
        return AxialScale({"pullback_pitch_mm": self.pullback_pitch_mm}, checked=measured)

    @classmethod
    def measures(cls, keys: Mapping[str, Any], n_frames: int, shape: tuple[int, ...]) -> dict[str, str]:
        """Return depth, turn and length of a pullback, as far as ``keys`` say them."""
        samples, ascans = shape[:2]
        said = {"a turn": f"{ascans} A-scans, {360 / ascans:.3g}° each"}
        if bore := positive(keys, "bore_diameter_mm"):
            said["a turn"] += f", {1000 * math.pi * bore[0] / ascans:.3g} µm on the wall"
        if axial := positive({"medium_index": 1.0, **keys}, "axial_pixel_mm", "medium_index"):
            step_mm, medium = axial[0] / axial[1], "air" if axial[1] == 1 else f"a medium of index {axial[1]:g}"
            said["depth"] = f"{samples * step_mm:.3g} mm in {medium}, {1000 * step_mm:.3g} µm a sample"
        if pitch := positive(keys, "pullback_pitch_mm"):
            said["length"] = f"{(n_frames - 1) * pitch[0]:.4g} mm, {pitch[0]:g} mm from slice to slice"
        return said

    @property
    def capillary_radius_mm(self) -> float:
        """Outer radius of the capillary, mm."""
        return self.capillary_outer_diameter_mm / 2

    @property
    def bore_radius_mm(self) -> float:
        """Nominal radius of the bore, mm."""
        return self.bore_diameter_mm / 2

    @property
    def gap_mm(self) -> float:
        """Distance from the capillary's outer face to the nominal wall, mm."""
        return self.bore_radius_mm - self.capillary_radius_mm

    @property
    def sense(self) -> int:
        """+1 where A-scans run with the panorama's θ, −1 where against it."""
        return -1 if self.handedness == "mirrored" else 1

    @model_validator(mode="after")
    def _capillary_fits_the_bore(self) -> Self:
        if self.capillary_outer_diameter_mm >= self.bore_diameter_mm:
            raise ValueError(
                f"capillary_outer_diameter_mm ({self.capillary_outer_diameter_mm:g}) must be smaller than "
                f"bore_diameter_mm ({self.bore_diameter_mm:g})"
            )
        return self

    @model_validator(mode="after")
    def _spectra_are_no_bscans(self) -> Self:
        if self.spectra and (self.intensity != "log" or self.db_per_count not in (None, 1 / COUNTS_PER_DB)):
            raise ValueError("intensity and db_per_count are those of B-scans; leave them out where spectra are stated")
        return self


MANIFEST = Manifest(
    name="oct",
    title="Catheter OCT pullback",
    suffixes=(".tif", ".tiff", ".btf", ".npy", ".png", ".bin", ".oct", ".dcm", ".zarr"),
    acquisition=OctAcquisition,
    provides=frozenset({"intensity", "depth", "volume"}),
    frame_dim="slice",
    implementation="endoct.modalities.oct.plugin:OCT",
    # usual: what 98 % of the slices have, rounded outward (`quick`, `hard`, `learning`, seeds 11–14)
    per_frame={
        "sine_amplitude_mm": Meaning("amplitude A of the sine fitted to the capillary", "mm"),
        "sine_omega": Meaning("periods a turn ω of the sine fitted to the capillary"),
        "sine_phase_rad": Meaning("phase φ of the sine fitted to the capillary", "rad"),
        "sine_offset_mm": Meaning("mean depth D of the sine fitted to the capillary", "mm"),
        "offset_mm": Meaning("catheter off the axis of the capillary", "mm"),
        "offset_direction_rad": Meaning("direction in which the catheter is off the axis", "rad"),
        "glass_mm": Meaning("thickness of the glass", "mm"),
        "inlier_fraction": Meaning("share of A-scans that show the capillary", usual=(0.6, 1.0)),
        "residual_mm": Meaning("misfit of the capillary", "mm", usual=(0.0, 0.004)),
        "bridged": Meaning("bridged", trusted_when=False),
        "start_angle_rad": Meaning("angle at which the turn starts", "rad"),
        "start_angle_known": Meaning("start angle known", trusted_when=True),
        "start_angle_sigma_rad": Meaning("standard error of the start angle", "rad"),
        "turn_length": Meaning("length of the turn"),
        "rotation_amplitude_rad": Meaning("largest departure from even rotation", "rad", usual=(0.0, math.radians(6))),
        "rotation_known": Meaning("rotation known", trusted_when=True),
        "rotation_sigma_rad": Meaning("standard error of the rotation", "rad"),
        "rotation_harmonics_rad": Meaning("departure from even rotation, harmonics", "rad"),
        "lost_at_rad": Meaning("angle at which A-scans are missing", "rad"),
        "lost_rad": Meaning("angle over which A-scans are missing", "rad"),
        "surface_fraction": Meaning("share of A-scans that show the wall", usual=(0.95, 1.0)),
        "wall_sigmas": Meaning("wall over the noise (standard errors)", usual=(12.0, math.inf)),
        "opening_fraction": Meaning("share of A-scans that meet an opening"),
        "bone_before_fraction": Meaning("share of A-scans with bone before an opening", usual=(0.0, 0.01)),
        "dark_wall_fraction": Meaning("share of A-scans with darkness behind the wall", usual=(0.0, 0.1)),
    },
)
