"""Parameters of the OCT: catheter, capillary, interferometer, motion; see :mod:`endoct.synthetic.sample.parameters`."""

from typing import Annotated, Literal

from pydantic import Field

from endoct.synthetic.sample.parameter_fields import (
    MOST_HARMONICS,
    MOST_LISTED,
    Angle,
    Factor,
    Harmonic,
    Parameters,
    Place,
    Shift,
    Stated,
    Travel,
    between,
    drawn,
)

N_BANDS = 3
Length = Annotated[float, Field(ge=0.5, le=2)]
Error = Annotated[tuple[Harmonic, ...], Field(max_length=MOST_HARMONICS)]
Offset = Annotated[float, Field(ge=0, le=0.5)]


class SheathLine(Parameters):
    """One of the circles that the catheter's own sheath draws into every B-scan."""

    radius_mm: float = between(0.10, 0.44, "radius of the line (Dragonfly: 0.45 outside)")
    wobble_mm: float = between(0.0147, 0.0255, "amplitude of its sine: the core turns 3–5 px off its axis (rig)")
    phase_rad: float = between(0, 6.2832, "phase of that sine")
    level_db: float = between(-20, 80, "brightness where it does not fade")
    thickness_mm: float = drawn(0.025, 0.06, "thickness of the polymer behind it (chosen; Dragonfly: 0.05)", (0, 0.2))
    band_db: float = between(-40, 80, "scattering of that polymer where it does not fade")


class Shadow(Parameters):
    """A speck of dirt on the capillary, a soft-edged ellipse that weakens the wall behind it."""

    z_mm: Place = Field(description="centre, from the mouth")
    theta_rad: float = drawn(0, 6.2832, "centre")
    sigma_z_mm: float = drawn(0.1, 0.5, "half length (chosen)")
    sigma_theta_rad: float = drawn(0.012, 0.052, "half width, 0.7–3° (chosen)")
    loss_db: float = drawn(5, 18, "loss at its centre (chosen)", (0, 40))


class LostAscans(Parameters):
    """A block of A-scans the recorder dropped: a jump in angle within one B-scan (rig)."""

    slice_index: int = Field(ge=0, le=MOST_LISTED, description="slice, in the order recorded")
    ascan: int = Field(ge=1, le=1_000_000, description="the first A-scan recorded after the gap")
    count: int = Field(ge=1, le=1_000_000, description="A-scans lost")


class Oct(Parameters):
    """The catheter in its capillary, the interferometer, and how they moved."""

    # geometry
    capillary_outer_diameter_mm: float = drawn(
        1.65, 1.75, "outer diameter of the capillary (typical: 1.7; 1.2–1.8 plausible)", (1.2, 2.2)
    )
    glass_mm: float = drawn(0.10, 0.30, "wall of the capillary; as thick as the catheter leaves room for")
    glass_index: float = drawn(1.455, 1.465, "refractive index of the capillary, group, near 1300 nm", (1, 1.6))
    offset_mean_mm: float = drawn(
        0.10, 0.25, "catheter off the capillary's axis; less where there is no room (required)", (0, 0.45)
    )
    offset_drift_mm: float = drawn(0.02, 0.05, "largest departure from that mean over the scan (required)", (0, 0.2))
    sheath: tuple[SheathLine, ...] = Field(max_length=32, description="3 or 4 lines, from the inside")
    # sampling
    axial_pixel_mm: float = drawn(0.0049, 0.0051, "depth sample in air (rig)", (0.003, 0.01))
    first_sample_mm: float = drawn(
        -0.30, 0.05, "optical path of depth sample 0 from the catheter (chosen)", (-0.6, 0.5)
    )
    # the spectrometer
    axial_resolution_mm: float = drawn(
        0.0075, 0.0120, "full width at half maximum in air (rig: 6.5–15 µm)", (0.0075, 0.03)
    )
    lateral_resolution_mm: float = drawn(
        0.020, 0.030, "full width at half maximum at the focus (Ilumien class)", (0.005, 0.1)
    )
    focus_mm: float = drawn(1.0, 1.5, "optical path from the catheter to the focus (chosen: about the wall)", (0.2, 5))
    wavelength_mm: float = drawn(0.001284, 0.001284, "centre of the spectrum, 1200–1368 nm (rig)", (0.0005, 0.003))
    diffuse_rayleigh: float = drawn(
        2, 2, "apparent Rayleigh length of a diffuse wall over the beam's (van Leeuwen 2003; 1 by Kübler 2021)", (1, 4)
    )
    roll_off_db: float = drawn(6, 10, "loss at full depth, sinc² × Gauss (rig)", (4, 30))
    reference_counts: float = drawn(1400, 2200, "reference light at the spectrum's peak, of 4095 (chosen)", (100, 4000))
    electrons_per_count: float = drawn(540, 540, "electrons for a count of the spectrometer (rig)", (1, 5000))
    excess_noise_db: float = drawn(
        8, 16, "noise over shot noise; the more, the stronger the autocorrelation (chosen)", (0, 30)
    )
    dark_counts: float = drawn(80, 80, "counts of the dark detector (chosen)", (0, 1000))
    dark_pattern_counts: float = drawn(3, 3, "rms of its fixed pattern (chosen)", (0, 100))
    floor_bands_db: float = drawn(
        2.2, 3.0, "difference of the noise floor between depths (a swept-source file: 2.6)", (0, 6)
    )
    floor_bands: tuple[Factor, ...] = Field(
        max_length=N_BANDS, description="relative weights of the waves over depth that make up that difference"
    )
    # signal; 0 dB is the noise floor before roll-off
    wall_db: float = drawn(
        14, 22, "bone at its surface at normal incidence, mean (rig: barely visible in places)", (-5, 40)
    )
    outer_face_db: float = drawn(30, 38, "capillary's outer face at normal incidence (chosen)", (0, 60))
    inner_face_db: float = drawn(26, 36, "capillary's inner face at normal incidence (chosen)", (0, 60))
    catheter_face_db: float = drawn(20, 34, "the catheter's own exit, at a path of 0; often mirrored (chosen)", (0, 60))
    flare_db: float = drawn(
        15, 32, "extra brightness of a face that the beam meets squarely, twice a turn (chosen)", (0, 50)
    )
    flare_rad: float = drawn(0.01, 0.01, "incidence at which that has fallen to 1/e (chosen)", (0.001, 0.1))
    ghost_db: float = drawn(
        -29.5,
        -28.5,
        "light that went once more through the glass, against the outer face (Fresnel: 3.5 % twice)",
        (-80, 0),
    )
    double_pass_db: float = drawn(
        -40,
        -32,
        "light that the sheath sent out again, against the face; Fresnel and a round sheath (chosen)",
        (-80, 0),
    )
    sheath_db: float = drawn(26, 34, "the sheath's lines, each within 4 dB of this (chosen)", (-20, 60))
    sheath_band_db: float = drawn(-20, -12, "scattering of the sheath's polymer, against its lines (chosen)", (-60, 0))
    sheath_fade_db: float = drawn(3, 7, "rms by which the sheath fades in and out over a turn (chosen)", (0, 30))
    glint_rad: float = drawn(0.10, 0.20, "incidence at which a face has lost 8.7 dB (chosen)", (0.02, 1))
    matt_db: float = drawn(-22, -16, "a face at oblique against normal incidence (chosen)", (-40, 0))
    detector_line_px: float = drawn(130, 330, "depth row of the detector's fixed line (rig: 218–227)", (5, 500))
    detector_line_db: float = drawn(16, 26, "brightness of that line (chosen)", (-20, 50))
    attenuation_mm: float = drawn(0.10, 0.25, "depth in bone at which the intensity falls to 1/e (chosen)", (0.01, 2))
    dust_db: float = drawn(2, 2, "scattering of bone dust over that of bone (chosen)", (-20, 20))
    dust_roughness_mm: float = drawn(0.008, 0.008, "rms of the surface of dust (chosen)", (0, 0.05))
    tail_db: float = drawn(-18, -12, "multiple scattering against the wall's surface (chosen)", (-60, 0))
    tail_mm: float = drawn(0.4, 0.9, "decay of that tail (chosen)", (0.01, 3))
    patchiness_db: float = drawn(1.5, 3.0, "rms of the wall's slow changes of brightness (chosen)", (0, 10))
    shadows: tuple[Shadow, ...] = Field(
        max_length=MOST_LISTED, description="dirt on the capillary, one for each 2 mm of bore"
    )
    n_glints: int = Field(ge=0, le=100_000, description="specular spots on the wall, six for each mm of bore")
    db_per_count: float = drawn(0.25, 0.35, "step of the logarithmic u8 samples", (0.05, 2))
    floor_count: float = drawn(45, 70, "count of the mean noise floor", (0, 200))
    # motion
    scan: Literal["step", "helical"] = Field(
        description="whether the catheter stops for every turn, or pulls on during it"
    )
    start: Literal["triggered", "free"] = Field(description="where turns start: at one angle, or anywhere")
    travel: Travel = Field(description="direction of the catheter")
    sense: Literal[-1, 1] = Field(description="+1: A-scans run with θ, −1: against it")
    theta_origin_rad: float = drawn(0, 6.2832, "θ of A-scan 0 of a perfect turn")
    pullback_jitter_mm: float = drawn(0.004, 0.004, "rms error of a slice's place (chosen)", (0, 0.1))
    z_mm: tuple[Place, ...] = Field(
        max_length=MOST_LISTED, description="place of A-scan 0 of every slice in the order recorded, from the mouth"
    )
    z_advance_mm: Shift = Field(description="way along z during one turn, signed; 0 for a stepped scan")
    offset_mm: tuple[Offset, ...] = Field(
        max_length=MOST_LISTED, description="catheter off the capillary's axis, every slice"
    )
    offset_direction_rad: tuple[Angle, ...] = Field(
        max_length=MOST_LISTED, description="θ of that offset in the bore frame"
    )
    start_jitter_rad: float = drawn(0.0052, 0.0052, "rms of where a triggered turn starts (chosen: 0.3°)", (0, 0.5))
    start_angle_rad: tuple[Angle, ...] = Field(max_length=MOST_LISTED, description="start of every slice's turn")
    turn_jitter: float = drawn(
        0.0005, 0.0025, "rms of a turn's period, relative (rig: to 0.01; others 0.01–0.03)", (0, 0.05)
    )
    turn_length: tuple[Length, ...] = Field(
        max_length=MOST_LISTED, description="turns that n_ascans A-scans span, every slice, about 1"
    )
    rotation_error_peak_rad: float = drawn(
        0.0087, 0.0436, "largest rotation error over the scan, 0.5–2.5° (a few degrees, 10° at bends)", (0, 0.2)
    )
    stick_slip: float = drawn(
        0.15, 0.4, "share of that peak by which the catheter sticks and slips, a few times a turn (chosen)", (0, 1)
    )
    rotation_error_rad: tuple[Error, ...] = Field(
        max_length=MOST_LISTED, description="rotation error of every slice, harmonics 1, 2, … of the turn"
    )
    lost_blocks: float = drawn(0.0, 1.5, "mean number of blocks of A-scans lost in the recording (rig)", (0, 100))
    lost_ascans: tuple[LostAscans, ...] = Field(default=(), max_length=MOST_LISTED, description="blocks that were lost")
    # what the sidecar says
    states_first_sample: bool = Field(description="whether the sidecar gives first_sample_mm")
    stated_travel: Stated = Field(description="travel in the sidecar: right, or unknown")
    states_handedness: bool = Field(description="whether the sidecar gives the handedness, or 'unknown'")
