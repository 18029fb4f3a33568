"""Every parameter of a specimen, with its unit, what it is drawn from and where that comes from.

A :class:`Sample` is all that the renderer reads: the same sample gives the same bytes. A field made by
``_drawn`` is drawn uniformly between its first two numbers by :mod:`endoct.synthetic.draw`, unless its text
says otherwise; a wish may take it as far as ``allowed``. Sources: "§9" and "§6" are those of the project's
design, "rig" is the measured OCT rig, "chosen" has no source but plausibility.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from endoct.synthetic.presets import PRESETS, Bone, PresetName

Travel = Literal["in", "out"]
Stated = Literal["in", "out", "unknown"]
Filling = Literal["air", "dust", "fluid"]
Offset = Annotated[float, Field(ge=0, le=0.5)]
Harmonic = tuple[float, float]  # factors of the cosine and of the sine


def _drawn(low: float, high: float, about: str, allowed: tuple[float, float] | None = None) -> Any:
    return _range(*(allowed or (low, high)), about, draw=[low, high])


def _range(least: float, most: float, about: str, **more: Any) -> Any:
    return Field(ge=least, le=most, description=about, json_schema_extra=more)


class _Parameters(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Cell(_Parameters):
    """One cavity that the drill has opened: a hole drilled across the bore, or an air cell.

    Its axis starts on the nominal wall at (``z_mm``, ``theta_rad``) and leans off the radial direction. With
    (u, v) across the axis, u along the long direction, and w along it, counted from the widest part, the
    cavity is (s^p + |w/c|^p)^(1/p) < 1 with p = ``squareness``, s = 1 on an outline of ``diameter_mm`` and
    ``aspect`` with the ``outline`` harmonics, and c = ``depth_mm`` − ``bulge_mm``. With ``bulge_mm`` = 0 it is a
    shaft, open towards the bore: there max(w, 0) stands in for the absolute value of w.
    """

    z_mm: float = Field(description="of its axis at the wall, mm from the mouth")
    theta_rad: float = _range(0, 6.2832, "of its axis at the wall, rad")
    diameter_mm: float = _range(0.2, 2.0, "of the circle of equal area at its widest, mm (§9: opening 0.2–1.5)")
    depth_mm: float = _range(0.05, 1.5, "of its floor below the nominal wall, along its axis, mm (§9)")
    bulge_mm: float = _range(0, 1.0, "of its widest part below the nominal wall, mm; 0 for a drilled hole")
    aspect: float = _range(0.6, 1.0, "short over long diameter (chosen)")
    tilt_rad: float = _range(0, 3.1416, "direction of the long diameter against z, rad")
    lean_rad: float = _range(0, 0.8, "of its axis off the radial direction, rad (paper: different orientations)")
    lean_direction_rad: float = _range(0, 6.2832, "of that lean in the wall's plane, against z, rad")
    squareness: float = _range(2, 12, "exponent of its shape: 2 an ellipsoid, 12 a drilled shaft (chosen)")
    outline: tuple[Harmonic, ...] = Field(description="its departure from an ellipse, relative, harmonics 2, 3, …")
    edge_mm: float = _range(0.005, 0.15, "length over which its rim is rounded; large under a lining, mm (chosen)")
    lining: float = _range(0.55, 1.0, "albedo of its inside over that of bone; 1 hides the edge (chosen)")
    rim_gain: float = _range(0, 0.8, "extra brightness of its rim; 0 for most cells (chosen)")
    filling: Filling = Field(description="what is in it below fill_mm")
    fill_mm: float = _range(0, 1.5, "of the surface of the filling below the nominal wall, along the axis, mm")


class Bore(_Parameters):
    """The drill hole and its cells."""

    bone: Bone = Field(description="drilled bone substitute, or a pneumatised mastoid")
    diameter_mm: float = _drawn(2.4, 2.6, "nominal, stands in both sidecars, mm (paper: 2.5)", (1.6, 4.0))
    length_mm: float = Field(gt=0, lt=100, description="of the simulated wall, from the mouth, mm")
    taper_mm: float = _drawn(-0.015, 0.015, "change of radius from mouth to end, mm (chosen)", (-0.2, 0.2))
    tilt_rad: float = _drawn(0, 0.001, "of the bore against the capillary in it, rad (chosen)", (0, 0.01))
    tilt_direction_rad: float = _drawn(0, 6.2832, "towards which the bore leans, θ, rad")
    wander_mm: float = _drawn(0.004, 0.015, "rms of the smooth departures from a cylinder, mm (chosen)", (0, 0.05))
    roughness_mm: float = _drawn(0.001, 0.004, "rms of cut bone, mm (chosen)", (0, 0.02))
    drill_mark_depth_mm: float = _drawn(0.001, 0.006, "amplitude of the drill's helical mark, mm (chosen)", (0, 0.05))
    drill_mark_pitch_mm: float = _drawn(0.08, 0.25, "feed of the drill a turn, mm (chosen)", (0.02, 2))
    texture: float = _drawn(0.08, 0.16, "rms of the albedo of bone, relative (chosen)", (0, 0.6))
    smear: float = _drawn(0.10, 0.30, "albedo lost under smears of bone dust and blood, 6 % of it (chosen)", (0, 1))
    cell_fraction: float = _drawn(0.10, 0.27, "wall to be cut away by cells; lands within 0.08–0.30 (§9)", (0, 0.4))
    septum_mm: float = _drawn(0.03, 0.12, "bone left between neighbours, mastoid only, mm (chosen)", (0, 0.5))
    communicating: float = _drawn(0.1, 0.3, "share of cells that run into a neighbour, mastoid only (chosen)", (0, 1))
    lining: float = _drawn(0.0, 0.1, "share of cells under a lining that hides the edge (chosen)", (0, 1))
    dust: float = _drawn(0.0, 0.0, "share of cells with bone dust on their floor; none in the phantom (chosen)", (0, 1))
    fluid: float = _drawn(0.0, 0.0, "share of cells with fluid on their floor; none in the phantom (chosen)", (0, 1))
    cells: tuple[Cell, ...] = ()


class SheathLine(_Parameters):
    """One of the circles that the catheter's own sheath draws into every B-scan."""

    radius_mm: float = _range(0.10, 0.44, "mm (Dragonfly: 0.45 outside)")
    wobble_mm: float = _range(0.0147, 0.0255, "sine amplitude: the core turns 3–5 px off its axis (rig), mm")
    phase_rad: float = _range(0, 6.2832, "of that sine, rad")
    level_db: float = _drawn(22, 38, "dB (chosen)", (0, 60))


class Shadow(_Parameters):
    """A speck of dirt on the capillary, a soft-edged ellipse that weakens the wall behind it."""

    z_mm: float = Field(description="centre, mm from the mouth")
    theta_rad: float = _drawn(0, 6.2832, "centre, rad")
    sigma_z_mm: float = _drawn(0.1, 0.5, "half length, mm (chosen)")
    sigma_theta_rad: float = _drawn(0.012, 0.052, "half width, 0.7–3° (chosen)")
    loss_db: float = _drawn(5, 18, "dB (chosen)", (0, 40))


class LostAscans(_Parameters):
    """A block of A-scans the recorder dropped: a jump in angle within one B-scan (rig)."""

    slice_index: int = Field(ge=0, description="in the order recorded")
    ascan: int = Field(ge=1, description="the first A-scan recorded after the gap")
    count: int = Field(ge=1, description="A-scans lost")


class Oct(_Parameters):
    """The catheter in its capillary, the interferometer, and how they moved."""

    # geometry
    capillary_outer_diameter_mm: float = _drawn(1.65, 1.75, "mm (§6: 1.7; 1.2–1.8 plausible)", (1.2, 2.2))
    glass_mm: float = _drawn(0.10, 0.30, "wall of the capillary, mm; as thick as the catheter leaves room for")
    glass_index: float = _drawn(1.455, 1.465, "refractive index of the capillary, group, near 1300 nm", (1, 1.6))
    offset_mean_mm: float = _drawn(
        0.10, 0.25, "catheter off the capillary's axis, mm; less where there is no room (§9)", (0, 0.45)
    )
    offset_drift_mm: float = _drawn(0.02, 0.05, "largest departure from that mean over the scan, mm (§9)", (0, 0.2))
    sheath: tuple[SheathLine, ...] = Field(description="3 or 4 lines, from the inside")
    # sampling
    axial_pixel_mm: float = _drawn(0.0049, 0.0051, "in air, mm (rig)", (0.003, 0.01))
    first_sample_mm: float = _drawn(
        -0.30, 0.05, "optical path of depth sample 0 from the catheter, mm (chosen)", (-0.6, 0.5)
    )
    # the spectrometer
    axial_resolution_mm: float = _drawn(
        0.0075, 0.0120, "full width at half maximum in air, mm (rig: 6.5–15 µm)", (0.0075, 0.03)
    )
    lateral_resolution_mm: float = _drawn(0.020, 0.030, "full width at half maximum, mm (Ilumien class)", (0.005, 0.1))
    roll_off_db: float = _drawn(6, 10, "loss at full depth, sinc² × Gauss, dB (rig)", (4, 30))
    reference_counts: float = _drawn(
        1400, 2200, "of the reference light at the spectrum's peak, of 4095 (chosen)", (100, 4000)
    )
    electrons_per_count: float = _drawn(540, 540, "of the spectrometer's converter (rig)", (1, 5000))
    excess_noise_db: float = _drawn(
        8, 16, "noise over shot noise; the more, the stronger the autocorrelation (chosen)", (0, 30)
    )
    # signal; 0 dB is the noise floor before roll-off
    wall_db: float = _drawn(
        14, 22, "bone, mean at its surface seen squarely, dB (rig: barely seen in places)", (-5, 40)
    )
    outer_face_db: float = _drawn(30, 38, "capillary's outer face seen squarely, dB (chosen)", (0, 60))
    inner_face_db: float = _drawn(26, 36, "capillary's inner face seen squarely, dB (chosen)", (0, 60))
    catheter_face_db: float = _drawn(
        20, 34, "the catheter's own exit, at a path of 0; often seen mirrored, dB (chosen)", (0, 60)
    )
    flare_db: float = _drawn(
        15, 32, "extra, of a face within a few A-scans of square, in flare slices, dB (chosen)", (0, 50)
    )
    flare_share: float = _drawn(0.0, 0.3, "of slices in which such a flare occurs (chosen)", (0, 1))
    glint_rad: float = _drawn(0.10, 0.20, "incidence at which a face has lost 8.7 dB, rad (chosen)", (0.02, 1))
    matt_db: float = _drawn(-22, -16, "what a face returns obliquely, against squarely, dB (chosen)", (-40, 0))
    detector_line_px: float = _drawn(130, 330, "depth row of the detector's fixed line (rig: 218–227)", (5, 500))
    detector_line_db: float = _drawn(16, 26, "dB (chosen)", (-20, 50))
    attenuation_mm: float = _drawn(
        0.10, 0.25, "depth in bone at which the intensity falls to 1/e, mm (chosen)", (0.01, 2)
    )
    tail_db: float = _drawn(-18, -12, "multiple scattering against the wall's surface, dB (chosen)", (-60, 0))
    tail_mm: float = _drawn(0.4, 0.9, "decay of that tail, mm (chosen)", (0.01, 3))
    patchiness_db: float = _drawn(1.5, 3.0, "rms of the wall's slow changes of brightness, dB (chosen)", (0, 10))
    shadows: tuple[Shadow, ...] = Field(description="of dirt on the capillary, one for each 2 mm of bore")
    n_glints: int = Field(ge=0, description="specular spots on the wall, six for each mm of bore")
    db_per_count: float = _drawn(0.25, 0.35, "of the logarithmic u8 samples, dB", (0.05, 2))
    floor_count: float = _drawn(45, 70, "count of the mean noise floor", (0, 200))
    # motion
    scan: Literal["step", "helical"] = Field(description="stops for every turn, or pulls on during it")
    start: Literal["triggered", "free"] = Field(description="where turns start: at one angle, or anywhere")
    travel: Travel = Field(description="of the catheter during the recording")
    sense: Literal[-1, 1] = Field(description="+1: A-scans run with θ, −1: against it")
    theta_origin_rad: float = _drawn(0, 6.2832, "θ of A-scan 0 of a perfect turn, rad")
    pullback_jitter_mm: float = _drawn(0.004, 0.004, "rms error of a slice's place, mm (chosen)", (0, 0.1))
    z_mm: tuple[float, ...] = Field(description="of A-scan 0 of every slice in the order recorded, mm from the mouth")
    z_advance_mm: float = Field(description="along z during one turn, signed, mm; 0 for a stepped scan")
    offset_mm: tuple[Offset, ...] = Field(description="of the catheter from the capillary's axis, every slice, mm")
    offset_direction_rad: tuple[float, ...] = Field(description="of that offset, θ in the bore frame, rad")
    start_jitter_rad: float = _drawn(
        0.0052, 0.0052, "rms of where a triggered turn starts, rad (chosen: 0.3°)", (0, 0.5)
    )
    start_angle_rad: tuple[float, ...] = Field(description="of every slice's turn, rad")
    turn_jitter: float = _drawn(
        0.0005, 0.0025, "rms of a turn's period, relative (rig: to 0.01; others 0.01–0.03)", (0, 0.05)
    )
    turn_length: tuple[float, ...] = Field(description="turns that n_ascans A-scans span, every slice, about 1")
    rotation_error_peak_rad: float = _drawn(
        0.0087, 0.0436, "largest over the scan, 0.5–2.5° (a few degrees, 10° at bends), rad", (0, 0.2)
    )
    rotation_error_rad: tuple[tuple[Harmonic, ...], ...] = Field(
        description="every slice, harmonics 1, 2, … of the turn, rad"
    )
    lost_blocks: float = _drawn(0.0, 1.5, "mean number of blocks of A-scans lost in the recording (rig)", (0, 100))
    lost_ascans: tuple[LostAscans, ...] = ()
    # what the sidecar says
    states_first_sample: bool = Field(description="whether the sidecar gives first_sample_mm")
    stated_travel: Stated = Field(description="travel in the sidecar: right, or unknown")
    states_handedness: bool = Field(description="whether the sidecar gives the handedness, or 'unknown'")


class Speck(_Parameters):
    """A dark spot fixed to the endoscope."""

    x_px: float = Field(description="columns from the annulus' centre, pixels")
    y_px: float = Field(description="rows from the annulus' centre, pixels")
    sigma_px: float = _drawn(1.5, 5, "pixels (chosen)", (0.5, 50))
    loss: float = _drawn(0.2, 0.8, "of the light, relative (chosen)", (0, 1))


class Droplet(_Parameters):
    """A drop of fluid on the mirror: it bends the view, as a weak lens does, and shines."""

    x_px: float = Field(description="columns from the annulus' centre, pixels")
    y_px: float = Field(description="rows from the annulus' centre, pixels")
    radius_px: float = _drawn(4, 14, "pixels (chosen)", (1, 100))
    bend_px: float = _drawn(1, 5, "largest displacement of what is seen through it, pixels (chosen)", (0, 50))
    shine: float = _drawn(0.1, 0.5, "light of its highlight, 1 is saturation (chosen)", (0, 3))


class Debris(_Parameters):
    """A crumb of bone on the wall while the endoscope looked; washed away before the OCT came."""

    z_mm: float = Field(description="centre, mm from the mouth")
    theta_rad: float = _drawn(0, 6.2832, "centre, rad")
    size_mm: float = _drawn(0.03, 0.12, "radius, mm (chosen)", (0.005, 1))
    gain: float = _drawn(0.6, 1.5, "albedo over that of bone (chosen)", (0, 3))


class Endoscope(_Parameters):
    """The pinhole camera with the cone before it, its light, and how they moved."""

    # optics
    width_px: int = Field(gt=0, description="of the image, pixels")
    height_px: int = Field(gt=0, description="of the image, pixels")
    colour: bool = Field(description="RGB, or grey")
    half_angle_deg: float = _drawn(42, 48, "of the cone, degrees (§6: 45)", (30, 60))
    mirror_distance_mm: float = _drawn(
        1.0, 2.0, "pinhole to the cone's apex, mm; so that the mirror fits the bore (chosen)", (0.5, 50)
    )
    focal_px: float = Field(gt=0, description="such that the annulus spans visible_length_mm, pixels")
    distortion: float = _drawn(
        -0.02, 0.02, "shift of the outer rim, relative, r_d = r(1 + k1·(r/f)²) (chosen)", (-0.2, 0.2)
    )
    visible_length_mm: float = _drawn(
        0.75, 0.90, "of the nominal bore in the annulus, mm; so that the mirror fits (§6: 1.0)", (0.2, 5)
    )
    inner_px: float = Field(gt=0, description="inner radius of the annulus, pixels")
    outer_px: float = Field(gt=0, description="outer radius of the annulus, pixels")
    inner_shift_px: tuple[float, float] = Field(description="centre of the inner boundary off the annulus', pixels")
    defocus_px: float = _drawn(0.6, 1.2, "σ of the blur where the focus is, pixels (chosen)", (0, 10))
    defocus_slope_px: float = _drawn(
        0.0, 0.6, "added to σ at the rim that is farther from focus, pixels (chosen)", (0, 10)
    )
    focus_at_outer: bool = Field(description="whether the outer rim of the annulus is in focus, or the inner")
    # light, as a fraction of saturation
    exposure: float = _drawn(0.6, 0.9, "of bone seen squarely (chosen)", (0.02, 3))
    bright_side: float = _drawn(0.15, 0.4, "first harmonic of the light around the probe, relative (§9)", (0, 0.9))
    bright_side_rad: float = _drawn(0, 6.2832, "where it is brightest, image angle, rad")
    vignetting: float = _drawn(0.2, 0.5, "loss from the middle of the annulus to its rims (§9)", (0, 1))
    fall_off_mm: float = _drawn(0.25, 0.5, "depth in a cell at which the light falls to 1/e, mm (chosen)", (0.05, 10))
    stray: float = _drawn(0.02, 0.05, "light scattered into dark places (chosen)", (0, 0.5))
    gloss: float = _drawn(0.0, 0.25, "specular light of the wet wall, against the diffuse (chosen)", (0, 3))
    gloss_rad: float = _drawn(0.10, 0.25, "width of the specular lobe, rad (chosen)", (0.01, 1))
    ring_px: float = Field(gt=0, description="radius of the probe's specular ring, pixels")
    ring_gain: float = _drawn(0.1, 0.35, "of that ring, added (chosen)", (0, 3))
    dirt: tuple[Speck, ...] = Field(description="8–25 specks on the optics")
    droplets: tuple[Droplet, ...] = Field(description="0–3 on the mirror")
    debris: tuple[Debris, ...] = Field(description="on the wall, one for each 1 mm of bore")
    full_well: float = _drawn(4000, 12000, "electrons at saturation, for shot noise (chosen)", (100, 100000))
    read_noise: float = _drawn(8, 25, "electrons rms (chosen)", (0, 500))
    jpeg_quality: float = _drawn(80, 98, "of the compression the frames have been through, of 100 (chosen)", (5, 100))
    storage: Literal["png", "video"] = Field(description="a folder of PNG, or one video")
    # motion
    travel: Travel = Field(description="of the endoscope during the recording")
    feed_jitter: float = _drawn(0.10, 0.10, "rms of the feed between frames, relative (§9)", (0, 0.4))
    dropped: float = _drawn(0.0, 0.03, "share of frames that were lost, each leaves a double step (chosen)", (0, 0.5))
    roll_wander_rad: float = _drawn(
        0.017, 0.14, "largest slow change of roll over the scan, 1–8°, rad (chosen)", (0, 3.2)
    )
    roll_jitter_rad: float = _drawn(0.0122, 0.0122, "rms of the roll from frame to frame, 0.7°, rad (chosen)", (0, 0.5))
    centre_wander_px: float = _drawn(1, 5, "of the annulus over the scan, pixels (chosen)", (0, 50))
    z_mm: tuple[float, ...] = Field(description="of the visible band's centre in every frame, mm from the mouth")
    roll_rad: tuple[float, ...] = Field(description="every frame, θ_wall = θ_image + roll, rad")
    centre_px: tuple[tuple[float, float], ...] = Field(description="of the annulus in every frame, column and row")
    offset_mm: tuple[tuple[float, float], ...] = Field(
        description="of the cone's apex off the bore's axis, x and y, mm"
    )
    probe_tilt_rad: float = _drawn(0, 0.006, "of the probe's axis against the bore's, to 0.35° (chosen)", (0, 0.1))
    probe_tilt_direction_rad: float = _drawn(0, 6.2832, "towards which the probe leans going inward, θ, rad")
    # what the sidecar says
    states_optics: bool = Field(description="whether the sidecar gives the cone, the focal length and the distortion")
    states_annulus: bool = Field(description="whether the sidecar gives the annulus of the first frame")
    stated_travel: Stated = Field(description="travel in the sidecar: right, or unknown")

    @property
    def distortion_k1(self) -> float:
        """k1 of r_image = r·(1 + k1·(r/f)²) that shifts the outer rim by ``distortion``."""
        return self.distortion * (self.focal_px * (1 + self.distortion) / self.outer_px) ** 2


class Sample(_Parameters):
    """Everything drawn for one specimen. ``seed`` also keys the noise of every slice and frame.

    ``bore_seed`` keys the wall's texture, so that two specimens can show one and the same bore.
    """

    preset: PresetName
    seed: int = Field(ge=0)
    bore_seed: int = Field(ge=0)
    bore: Bore
    oct: Oct
    endoscope: Endoscope

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        size = PRESETS[self.preset]
        every_slice = (
            "z_mm",
            "offset_mm",
            "offset_direction_rad",
            "start_angle_rad",
            "turn_length",
            "rotation_error_rad",
        )
        for part, names, expected in (
            (self.oct, every_slice, size.n_slices),
            (self.endoscope, ("z_mm", "roll_rad", "centre_px", "offset_mm"), size.n_frames),
        ):
            for name in names:
                if (found := len(getattr(part, name))) != expected:
                    raise ValueError(f"{name} for each of the {expected} frames of '{self.preset}', not {found}")
            if not all(0 <= z <= self.bore.length_mm for z in part.z_mm):
                raise ValueError("every z_mm to lie within the bore")
        for lost in self.oct.lost_ascans:
            if lost.slice_index >= size.n_slices or lost.ascan >= size.n_ascans:
                raise ValueError("every block of lost_ascans to lie within the recording")
        return self
