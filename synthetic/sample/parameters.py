"""Every parameter of a specimen, with its unit, what it is drawn from and where that comes from.

A :class:`Sample` is all that the renderer reads: the same sample gives the same bytes. A field made by ``drawn`` is
drawn uniformly between its first two numbers by :mod:`endoct.synthetic.draw`, unless its text says otherwise. Users may
have it drawn from any range within ``allowed``. Sources: "required" is the least difficulty that every preset must
have, "typical" the usual value of such an instrument. "rig" is the measured OCT rig, "paper" Laves et al. 2019, and
"chosen" has no source but plausibility.
"""

from typing import Literal, Self

from pydantic import Field, model_validator

from endoct.synthetic.sample.bone_parameters import Bore, Cell, Ct, Density, Network, Tube, Volume
from endoct.synthetic.sample.oct_parameters import LostAscans, Oct, Shadow, SheathLine
from endoct.synthetic.sample.parameter_fields import (
    LARGEST_SEED,
    MOST_LISTED,
    Angle,
    Harmonic,
    Parameters,
    Pixel,
    Place,
    Shift,
    Stated,
    Travel,
    drawn,
)
from endoct.synthetic.sample.presets import PRESETS, PresetName

__all__ = [
    "Bore",
    "Cell",
    "Ct",
    "Debris",
    "Density",
    "Droplet",
    "Endoscope",
    "Harmonic",
    "LostAscans",
    "Network",
    "Oct",
    "Sample",
    "Shadow",
    "SheathLine",
    "Speck",
    "Travel",
    "Tube",
    "Volume",
]


class Speck(Parameters):
    """A dark spot fixed to the endoscope."""

    x_px: Pixel = Field(description="columns from the annulus' centre")
    y_px: Pixel = Field(description="rows from the annulus' centre")
    sigma_px: float = drawn(1.5, 5, "σ of the spot (chosen)", (0.5, 50))
    loss: float = drawn(0.2, 0.8, "share of the light lost (chosen)", (0, 1))


class Droplet(Parameters):
    """A drop of fluid on the mirror: it bends the view, as a weak lens does, and shines."""

    x_px: Pixel = Field(description="columns from the annulus' centre")
    y_px: Pixel = Field(description="rows from the annulus' centre")
    radius_px: float = drawn(4, 14, "its radius (chosen)", (1, 100))
    bend_px: float = drawn(1, 5, "largest displacement of the image behind it (chosen)", (0, 50))
    shine: float = drawn(0.1, 0.5, "light of its highlight, 1 is saturation (chosen)", (0, 3))


class Debris(Parameters):
    """A crumb of bone on the wall in the endoscope's recording; washed away before the OCT's."""

    z_mm: Place = Field(description="centre, from the mouth")
    theta_rad: float = drawn(0, 6.2832, "centre")
    size_mm: float = drawn(0.03, 0.12, "radius (chosen)", (0.005, 1))
    gain: float = drawn(0.6, 1.5, "albedo over that of bone (chosen)", (0, 3))


class Endoscope(Parameters):
    """The pinhole camera with the cone before it, its light, and how they moved."""

    # optics
    width_px: int = Field(gt=0, le=4096, description="width of the image")
    height_px: int = Field(gt=0, le=4096, description="height of the image")
    colour: bool = Field(description="RGB, or grey")
    half_angle_deg: float = drawn(42, 48, "half angle of the cone (typical: 45)", (30, 60))
    mirror_distance_mm: float = drawn(
        1.0, 2.0, "pinhole to the cone's apex; so that the mirror fits the bore (chosen)", (0.5, 50)
    )
    focal_px: float = Field(gt=0, le=1e6, description="focal length, such that the annulus spans visible_length_mm")
    distortion: float = drawn(
        -0.02, 0.02, "shift of the outer rim, relative, r_d = r(1 + k1·(r/f)²) (chosen)", (-0.2, 0.2)
    )
    visible_length_mm: float = drawn(
        0.75, 0.90, "length of the nominal bore in the annulus; so that the mirror fits (typical: 1.0)", (0.2, 5)
    )
    outer_share: float = drawn(0.42, 0.46, "outer radius of the annulus over the image's height (chosen)", (0.2, 0.5))
    inner_share: float = drawn(
        0.18,
        0.35,
        "inner radius over the outer; less where only a smaller mirror passes the bore (chosen)",
        (0.08, 0.7),
    )
    inner_px: float = Field(gt=0, le=1e4, description="inner radius of the annulus")
    outer_px: float = Field(gt=0, le=1e4, description="outer radius of the annulus")
    inner_shift_px: tuple[Pixel, Pixel] = Field(description="centre of the inner boundary off the annulus'")
    defocus_px: float = drawn(0.6, 1.2, "σ of the blur where the focus is (chosen)", (0, 10))
    defocus_slope_px: float = drawn(0.0, 0.6, "added to σ at the rim that is farther from focus (chosen)", (0, 10))
    focus_at_outer: bool = Field(description="whether the outer rim of the annulus is in focus, or the inner")
    # light; what is added counts from bone in the middle of the annulus
    fibre_ring_mm: float = drawn(
        0.10,
        0.25,
        "radius of the ring of fibres about the lens; an endoscope of 1 mm has room for it (chosen)",
        (0, 0.3),
    )
    bone_albedo: float = drawn(
        0.5, 0.7, "share of the light that bone of mean brightness sends on, for light that bounces (chosen)", (0, 0.9)
    )
    saturated: float = drawn(
        0.002,
        0.02,
        "share of the annulus that saturates where a person sets the gain, on the first frames (chosen)",
        (0, 0.5),
    )
    exposure: float = drawn(1.0, 1.0, "gain of the camera over the one that a person would set (chosen)", (0.02, 5))
    bright_side: float = drawn(0.15, 0.4, "first harmonic of the light around the probe, relative (required)", (0, 0.9))
    bright_side_rad: float = drawn(0, 6.2832, "image angle where it is brightest")
    vignetting: float = drawn(
        0.2, 0.5, "loss from the middle of the image to the outer rim, as the radius squared (required)", (0, 1)
    )
    gloss: float = drawn(0.0, 0.25, "specular light of the wet wall, against the diffuse (chosen)", (0, 3))
    gloss_rad: float = drawn(0.10, 0.25, "width of the specular lobe (chosen)", (0.01, 1))
    ring_px: float = Field(gt=0, le=1e4, description="radius of the probe's specular ring")
    ring_gain: float = drawn(0.1, 0.35, "brightness of that ring, added (chosen)", (0, 3))
    dirt: tuple[Speck, ...] = Field(max_length=MOST_LISTED, description="8–25 specks on the optics")
    droplets: tuple[Droplet, ...] = Field(max_length=MOST_LISTED, description="0–3 on the mirror")
    debris: tuple[Debris, ...] = Field(max_length=MOST_LISTED, description="on the wall, one for each 1 mm of bore")
    fluid_loss: float = drawn(0.35, 0.35, "share of the matt light lost under fluid (chosen)", (0, 1))
    fluid_gloss: float = drawn(0.6, 0.6, "gloss that a fluid's surface adds (chosen)", (0, 3))
    full_well: float = drawn(4000, 12000, "electrons at saturation, for shot noise (chosen)", (100, 100000))
    read_noise: float = drawn(8, 25, "electrons rms (chosen)", (0, 500))
    gamma: float = drawn(1.8, 1.8, "gamma of the display, its inverse on the light; sRGB is about 2.2 (chosen)", (1, 3))
    jpeg_quality: float = drawn(80, 98, "quality of the frames' compression, of 100 (chosen)", (5, 100))
    storage: Literal["png", "video"] = Field(description="a folder of PNG, or one video")
    # motion
    travel: Travel = Field(description="direction of the endoscope")
    feed_jitter: float = drawn(0.10, 0.10, "rms of the feed between frames, relative (required)", (0, 0.4))
    dropped: float = drawn(0.0, 0.03, "share of frames that were lost, each leaves a double step (chosen)", (0, 0.5))
    roll_wander_rad: float = drawn(0.017, 0.14, "largest slow change of roll over the scan, 1–8° (chosen)", (0, 3.2))
    roll_jitter_rad: float = drawn(0.0122, 0.0122, "rms of the roll from frame to frame, 0.7° (chosen)", (0, 0.5))
    centre_wander_px: float = drawn(1, 5, "slow movement of the annulus over the scan (chosen)", (0, 50))
    centre_jitter_px: float = drawn(0.3, 0.3, "rms of the annulus' centre from frame to frame (chosen)", (0, 5))
    probe_offset_mm: float = drawn(0.0, 0.035, "cone's apex off the bore's axis, mean of the scan (chosen)", (0, 0.2))
    probe_drift_mm: float = drawn(
        0.02, 0.02, "largest departure from that along x and along y over the scan (chosen)", (0, 0.1)
    )
    z_mm: tuple[Place, ...] = Field(
        max_length=MOST_LISTED, description="centre of the visible band in every frame, from the mouth"
    )
    roll_rad: tuple[Angle, ...] = Field(
        max_length=MOST_LISTED, description="roll of every frame, θ_wall = θ_image + roll"
    )
    centre_px: tuple[tuple[Pixel, Pixel], ...] = Field(
        max_length=MOST_LISTED, description="centre of the annulus in every frame, column and row"
    )
    offset_mm: tuple[tuple[Shift, Shift], ...] = Field(
        max_length=MOST_LISTED, description="cone's apex off the bore's axis in every frame, x and y"
    )
    probe_tilt_rad: float = drawn(0, 0.006, "angle of the probe's axis to the bore's, to 0.35° (chosen)", (0, 0.1))
    probe_tilt_direction_rad: float = drawn(0, 6.2832, "θ towards which the probe leans going inward")
    # what the sidecar says
    states_optics: bool = Field(description="whether the sidecar gives the cone, the focal length and the distortion")
    states_annulus: bool = Field(description="whether the sidecar gives the annulus of the first frame")
    stated_travel: Stated = Field(description="travel in the sidecar: right, or unknown")

    @property
    def distortion_k1(self) -> float:
        """k1 of r_image = r·(1 + k1·(r/f)²) that shifts the outer rim by ``distortion``."""
        return self.distortion * (self.focal_px * (1 + self.distortion) / self.outer_px) ** 2


class Sample(Parameters):
    """Everything drawn for one specimen. ``seed`` also keys the noise of every slice and frame.

    ``bore_seed`` keys the wall's texture, so that two specimens can show one and the same bore. ``ct``: taken before
    drilling, ``cone_beam``: after it, where asked for.
    """

    preset: PresetName
    seed: int = Field(ge=0, le=LARGEST_SEED)
    bore_seed: int = Field(ge=0, le=LARGEST_SEED)
    bore: Bore
    oct: Oct
    endoscope: Endoscope
    ct: Ct | None = None
    cone_beam: Ct | None = None

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        if (self.ct or self.cone_beam) and self.bore.bone not in ("volume", "network"):
            raise ValueError("a CT of bone in three dimensions only")
        if self.bore.cells and self.bore.bone in ("volume", "network", "tube"):
            raise ValueError("planted cells in the bone 'phantom' or 'mastoid' only")
        for kind in ("volume", "network", "tube"):
            if (getattr(self.bore, kind) is not None) != (self.bore.bone == kind):
                raise ValueError(f"a {kind} with the bone '{kind}', and with no other")
        if self.bore.density and self.bore.bone not in ("volume", "network"):
            raise ValueError("a density of bone in three dimensions only")
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
