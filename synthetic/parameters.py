"""Every parameter that is drawn for a specimen, with its unit, its range and where the range comes from.

A :class:`Sample` is all that the renderer reads: the same sample gives the same bytes. The range of a field
is what :mod:`endoct.synthetic.draw` draws from, uniformly unless it says otherwise. Sources: "§9" and "§6"
are those of the project's design, "rig" is the measured OCT rig, "chosen" has no source but plausibility.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from endoct.synthetic.presets import PRESETS, PresetName

Travel = Literal["in", "out"]
Stated = Literal["in", "out", "unknown"]
Offset = Annotated[float, Field(ge=0.06, le=0.30)]
Harmonic = tuple[float, float]  # factors of the cosine and of the sine


def _range(low: float, high: float, about: str) -> Any:
    return Field(ge=low, le=high, description=about)


class _Parameters(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Cell(_Parameters):
    """One air cell that the drill has opened: a pit with an irregular outline in the bore's wall."""

    z_mm: float = Field(description="centre along the bore, mm from the mouth")
    theta_rad: float = _range(0, 6.2832, "centre around the bore, rad")
    diameter_mm: float = _range(0.2, 1.5, "diameter of the circle of equal area, mm; log-uniform (§9)")
    depth_mm: float = _range(0.05, 1.5, "depth of its floor below the wall, mm; grows with the diameter (§9)")
    aspect: float = _range(0.6, 1.0, "short over long axis (chosen)")
    tilt_rad: float = _range(0, 3.1416, "direction of the long axis against z, rad")
    steepness: float = _range(3, 9, "exponent of its profile: 3 a bowl, 9 a shaft (chosen)")
    outline: tuple[Harmonic, ...] = Field(description="its departure from an ellipse, relative, harmonics 2, 3, …")
    lining: float = _range(0.55, 0.95, "albedo of its lining over that of bone (chosen)")
    rim_gain: float = _range(0, 0.8, "extra brightness of its rim; 0 for most cells (chosen)")


class Bore(_Parameters):
    """The drill hole and its cells."""

    diameter_mm: float = _range(2.4, 2.6, "nominal, stands in both sidecars, mm (paper: 2.5)")
    length_mm: float = Field(gt=0, lt=100, description="of the simulated wall, from the mouth, mm")
    taper_mm: float = _range(-0.015, 0.015, "change of radius from mouth to end, mm (chosen)")
    wander_mm: float = _range(0.004, 0.015, "rms of the smooth departures from a cylinder, mm (chosen)")
    roughness_mm: float = _range(0.001, 0.004, "rms of cut bone, mm (chosen)")
    drill_mark_depth_mm: float = _range(0.001, 0.006, "amplitude of the drill's helical mark, mm (chosen)")
    drill_mark_pitch_mm: float = _range(0.08, 0.25, "feed of the drill a turn, mm (chosen)")
    texture: float = _range(0.08, 0.16, "rms of the albedo of bone, relative (chosen)")
    smear: float = _range(0.10, 0.30, "albedo lost under smears of bone dust and blood, 6 % of it (chosen)")
    cell_fraction: float = _range(0.10, 0.27, "wall to be cut away by cells; lands within 0.08–0.30 (§9)")
    cells: tuple[Cell, ...] = ()


class SheathLine(_Parameters):
    """One of the circles that the catheter's own sheath draws into every B-scan."""

    radius_mm: float = _range(0.10, 0.44, "mm (Dragonfly: 0.45 outside)")
    wobble_mm: float = _range(0.0147, 0.0255, "sine amplitude: the core turns 3–5 px off its axis (rig), mm")
    phase_rad: float = _range(0, 6.2832, "of that sine, rad")
    level_db: float = _range(22, 38, "dB (chosen)")


class Shadow(_Parameters):
    """A speck of dirt on the capillary, a soft-edged ellipse that weakens the wall behind it."""

    z_mm: float = Field(description="centre, mm from the mouth")
    theta_rad: float = _range(0, 6.2832, "centre, rad")
    sigma_z_mm: float = _range(0.1, 0.5, "half length, mm (chosen)")
    sigma_theta_rad: float = _range(0.012, 0.052, "half width, 0.7–3° (chosen)")
    loss_db: float = _range(5, 18, "dB (chosen)")


class Speck(_Parameters):
    """A dark spot fixed to the endoscope."""

    x_px: float = Field(description="columns from the annulus' centre, pixels")
    y_px: float = Field(description="rows from the annulus' centre, pixels")
    sigma_px: float = _range(1.5, 5, "pixels (chosen)")
    loss: float = _range(0.2, 0.8, "of the light, relative (chosen)")


class Oct(_Parameters):
    """The catheter in its capillary, the interferometer, and how they moved."""

    # geometry
    capillary_outer_diameter_mm: float = _range(1.65, 1.75, "mm (§6: 1.7)")
    glass_mm: float = _range(0.10, 0.30, "wall of the capillary, mm; as thick as the catheter leaves room for")
    glass_index: float = _range(1.455, 1.465, "refractive index of the capillary, group, near 1300 nm")
    sheath: tuple[SheathLine, ...] = Field(description="3 or 4 lines, from the inside")
    # sampling
    axial_pixel_mm: float = _range(0.0049, 0.0051, "in air, mm (rig)")
    first_sample_mm: float = _range(-0.30, 0.05, "optical path of depth sample 0 from the catheter, mm (chosen)")
    # signal; 0 dB is the noise floor before roll-off
    axial_resolution_mm: float = _range(0.0070, 0.0120, "full width at half maximum in air, mm (rig: 6.5–15 µm)")
    lateral_resolution_mm: float = _range(0.020, 0.030, "full width at half maximum, mm (Ilumien class)")
    roll_off_db: float = _range(6, 10, "loss at full depth, dB (rig)")
    wall_db: float = _range(14, 22, "bone, mean at its surface seen squarely, dB (rig: barely seen in places)")
    outer_face_db: float = _range(30, 38, "capillary's outer face seen squarely, dB (chosen)")
    inner_face_db: float = _range(26, 36, "capillary's inner face seen squarely, dB (chosen)")
    glint_rad: float = _range(0.10, 0.20, "incidence at which a face has lost 8.7 dB, rad (chosen)")
    matt_db: float = _range(-22, -16, "what a face returns obliquely, against squarely, dB (chosen)")
    detector_line_px: float = _range(130, 330, "depth row of the detector's fixed line (rig: 218–227)")
    detector_line_db: float = _range(16, 26, "dB (chosen)")
    attenuation_mm: float = _range(0.10, 0.25, "depth in bone at which the intensity falls to 1/e, mm (chosen)")
    tail_db: float = _range(-18, -12, "multiple scattering against the wall's surface, dB (chosen)")
    tail_mm: float = _range(0.4, 0.9, "decay of that tail, mm (chosen)")
    patchiness_db: float = _range(1.5, 3.0, "rms of the wall's slow changes of brightness, dB (chosen)")
    shadows: tuple[Shadow, ...] = Field(description="of dirt on the capillary, one for each 2 mm of bore")
    n_glints: int = Field(ge=0, description="specular spots on the wall, six for each mm of bore")
    db_per_count: float = _range(0.25, 0.35, "of the logarithmic u8 samples, dB")
    floor_count: float = _range(45, 70, "count of the mean noise floor")
    # motion
    travel: Travel = Field(description="of the catheter during the recording")
    sense: Literal[-1, 1] = Field(description="+1: A-scans run with θ, −1: against it")
    theta_origin_rad: float = _range(0, 6.2832, "θ of A-scan 0 of a perfect turn, rad")
    z_mm: tuple[float, ...] = Field(description="of every slice in the order recorded, mm from the mouth")
    offset_mm: tuple[Offset, ...] = Field(description="of the catheter from the axis, every slice, 0.06–0.3 mm (§9)")
    offset_direction_rad: tuple[float, ...] = Field(description="of that offset, θ in the bore frame, rad")
    start_angle_rad: tuple[float, ...] = Field(description="jitter of where a turn starts, σ 0.3°, rad")
    rotation_error_rad: tuple[tuple[Harmonic, ...], ...] = Field(
        description="every slice, harmonics 1, 2, … of the turn, rad; peak 0.5–2.5° over the scan (rig)"
    )
    # what the sidecar says
    states_first_sample: bool = Field(description="whether the sidecar gives first_sample_mm")
    stated_travel: Stated = Field(description="travel in the sidecar: right, or unknown")
    states_handedness: bool = Field(description="whether the sidecar gives the handedness, or 'unknown'")


class Endoscope(_Parameters):
    """The pinhole camera with the cone before it, its light, and how they moved."""

    # optics
    width_px: int = Field(gt=0, description="of the image, pixels")
    height_px: int = Field(gt=0, description="of the image, pixels")
    colour: bool = Field(description="RGB, or grey")
    half_angle_deg: float = _range(42, 48, "of the cone, degrees (§6: 45)")
    mirror_distance_mm: float = _range(3, 6, "pinhole to the cone's apex, mm (chosen)")
    focal_px: float = Field(gt=0, description="such that the annulus spans visible_length_mm, pixels")
    visible_length_mm: float = _range(0.9, 1.1, "of the nominal bore in the annulus, mm (§6: 1.0)")
    inner_px: float = Field(gt=0, description="inner radius of the annulus, pixels")
    outer_px: float = Field(gt=0, description="outer radius of the annulus, pixels")
    inner_shift_px: tuple[float, float] = Field(description="centre of the inner boundary off the annulus', pixels")
    defocus_px: float = _range(0.6, 1.2, "σ of the blur, pixels (chosen)")
    # light, as a fraction of saturation
    exposure: float = _range(0.6, 0.9, "of bone seen squarely (chosen)")
    bright_side: float = _range(0.15, 0.4, "first harmonic of the light around the probe, relative (§9)")
    bright_side_rad: float = _range(0, 6.2832, "where it is brightest, image angle, rad")
    vignetting: float = _range(0.2, 0.5, "loss from the middle of the annulus to its rims (§9)")
    fall_off_mm: float = _range(0.25, 0.5, "depth in a cell at which the light falls to 1/e, mm (chosen)")
    stray: float = _range(0.02, 0.05, "light scattered into dark places (chosen)")
    ring_px: float = Field(gt=0, description="radius of the probe's specular ring, pixels")
    ring_gain: float = _range(0.1, 0.35, "of that ring, added (chosen)")
    dirt: tuple[Speck, ...] = Field(description="8–25 specks on the optics")
    full_well: float = _range(4000, 12000, "electrons at saturation, for shot noise (chosen)")
    read_noise: float = _range(8, 25, "electrons rms (chosen)")
    # motion
    travel: Travel = Field(description="of the endoscope during the recording")
    z_mm: tuple[float, ...] = Field(description="of the visible band's centre in every frame, mm from the mouth")
    roll_rad: tuple[float, ...] = Field(description="every frame, θ_wall = θ_image + roll, rad")
    centre_px: tuple[tuple[float, float], ...] = Field(description="of the annulus in every frame, column and row")
    offset_mm: tuple[tuple[float, float], ...] = Field(description="of the probe off the bore's axis, x and y, mm")
    # what the sidecar says
    states_optics: bool = Field(description="whether the sidecar gives the cone and the focal length")
    states_annulus: bool = Field(description="whether the sidecar gives the annulus of the first frame")
    stated_travel: Stated = Field(description="travel in the sidecar: right, or unknown")


class Sample(_Parameters):
    """Everything drawn for one specimen. ``seed`` also keys the noise of every slice and frame."""

    preset: PresetName
    seed: int = Field(ge=0)
    bore: Bore
    oct: Oct
    endoscope: Endoscope

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        size = PRESETS[self.preset]
        every_slice = ("z_mm", "offset_mm", "offset_direction_rad", "start_angle_rad", "rotation_error_rad")
        for part, names, expected in (
            (self.oct, every_slice, size.n_slices),
            (self.endoscope, ("z_mm", "roll_rad", "centre_px", "offset_mm"), size.n_frames),
        ):
            for name in names:
                if (found := len(getattr(part, name))) != expected:
                    raise ValueError(f"{name} for each of the {expected} frames of '{self.preset}', not {found}")
            if not all(0 <= z <= self.bore.length_mm for z in part.z_mm):
                raise ValueError("every z_mm to lie within the bore")
        return self
