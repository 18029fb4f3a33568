"""How large a simulated specimen is, and which ranges it draws otherwise than by default."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

PresetName = Literal["quick", "paper", "mastoid", "patient", "small-patient", "hard", "learning", "tube"]
Bone = Literal["phantom", "mastoid", "network", "volume", "tube"]
Ranges = Mapping[str, tuple[float, float]]
MASTOID_RANGES: Ranges = {"bore.dust": (0.0, 0.20), "bore.fluid": (0.0, 0.20), "bore.lining": (0.1, 0.5)}
# Bone is as it was before its density and larger cells: data sets made with one version go with those of another.
LEARNING_RANGES: Ranges = {
    **MASTOID_RANGES,
    "network.pneumatised": (0.4, 0.95),
    "network.cell_mm": (1.3, 2.6),
    "density.contrast": (0.0, 0.0),
    "density.channel_mm": (0.0, 0.0),
}
# One real B-scan of the rig (see the project's facts) has its "wall barely above the noise in places". Its sine has an
# amplitude of 77 px, its detector line lies at rows 218–227. Rotation errors and jitter are those of a catheter that
# bends and rubs.
HARD_RANGES: Ranges = {
    "oct.wall_db": (5.0, 10.0),
    "oct.patchiness_db": (2.5, 4.0),
    "oct.offset_mean_mm": (0.22, 0.34),
    "oct.capillary_outer_diameter_mm": (1.80, 1.95),
    "oct.detector_line_px": (215.0, 230.0),
    "oct.detector_line_db": (20.0, 28.0),
    "oct.rotation_error_peak_rad": (0.035, 0.087),
    "oct.turn_jitter": (0.003, 0.010),
    "oct.lost_blocks": (0.0, 4.0),
    "endoscope.exposure": (0.5, 0.7),
    "endoscope.full_well": (2000.0, 5000.0),
    "endoscope.defocus_px": (0.9, 1.6),
    "endoscope.jpeg_quality": (70.0, 85.0),
    "endoscope.dropped": (0.0, 0.08),
}
# A printed tube is smooth but for its layers, and seen by instruments of which little is known.
TUBE_RANGES: Ranges = {
    "bore.diameter_mm": (2.2, 2.6),
    "bore.taper_mm": (-0.004, 0.004),
    "bore.wander_mm": (0.001, 0.004),
    "bore.drill_mark_pitch_mm": (0.05, 0.05),
    "bore.drill_mark_depth_mm": (0.001, 0.004),
    "bore.smear": (0.0, 0.0),
    "bore.tilt_rad": (0.0, 0.004),
    "oct.capillary_outer_diameter_mm": (1.55, 1.75),
    "endoscope.half_angle_deg": (38.0, 52.0),
    "endoscope.mirror_distance_mm": (0.9, 4.0),
    "endoscope.outer_share": (0.40, 0.50),
    "endoscope.probe_offset_mm": (0.0, 0.06),
    "endoscope.probe_tilt_rad": (0.0, 0.015),
}


@dataclass(frozen=True)
class Preset:
    """Sizes and difficulty of one specimen.

    Attributes: ``n_slices`` and ``n_frames``, recorded by the OCT and by the endoscope; ``n_ascans`` a turn,
    a multiple of ``ascans_per_column``; ``ascans_per_column``, the A-scans between two independently drawn columns of
    the optical field, which is oversampled when a turn has 14 000 A-scans; ``bone``, the kinds drawn from;
    ``image_px``, width and height of the endoscope's images, drawn from; ``n_depth`` samples an A-scan, half as
    many as the spectrometer's; ``pitch_mm``, nominal, of both instruments (Laves 2019, Methods: 0.2 mm);
    ``wall_dz_mm`` and ``wall_n_theta``, the grid of the wall and of the truth; ``helical``, the share of
    pullbacks without a stop; ``shared``, the least share of the shorter recording that is in both, which the bore has
    room for; ``ranges``, "part.name" → (low, high), what is drawn otherwise than
    :mod:`endoct.synthetic.sample.parameters` says.
    """

    n_slices: int
    n_ascans: int
    n_frames: int
    ascans_per_column: int = 1
    bone: tuple[Bone, ...] = ("phantom",)
    image_px: tuple[tuple[int, int], ...] = ((640, 480), (640, 480), (640, 480), (800, 600), (800, 600))
    n_depth: int = 512
    pitch_mm: float = 0.2
    wall_dz_mm: float = 0.01
    wall_n_theta: int = 2048
    helical: float = 0.0
    shared: float = 0.6
    ranges: Ranges = field(default_factory=dict)


PRESETS: Mapping[PresetName, Preset] = {
    "quick": Preset(n_slices=40, n_ascans=2000, n_frames=40),
    # 30 mm of pullback, 390 turns a minute at 91 000 A-scans a second (Laves 2019, Methods)
    "paper": Preset(n_slices=150, n_ascans=14000, n_frames=150, ascans_per_column=7),
    "mastoid": Preset(n_slices=40, n_ascans=2000, n_frames=40, bone=("network",), ranges=MASTOID_RANGES),
    # 26 mm seen of a bore of 31 mm, as long as the way to the cochlea
    "patient": Preset(n_slices=130, n_ascans=2000, n_frames=130, bone=("network",), shared=0.9, ranges=MASTOID_RANGES),
    # the same, sampled as coarsely as `learning`
    "small-patient": Preset(
        n_slices=130,
        n_ascans=512,
        n_frames=130,
        bone=("network",),
        image_px=((320, 240),),
        wall_dz_mm=0.02,
        wall_n_theta=1024,
        shared=0.9,
        ranges=MASTOID_RANGES,
    ),
    "hard": Preset(n_slices=40, n_ascans=2000, n_frames=40, ranges=HARD_RANGES),
    "learning": Preset(
        n_slices=16,
        n_ascans=512,
        n_frames=16,
        bone=("phantom", "network"),
        image_px=((320, 240),),
        wall_dz_mm=0.02,
        wall_n_theta=1024,
        helical=0.25,
        ranges=LEARNING_RANGES,
    ),
    "tube": Preset(
        n_slices=30,
        n_ascans=768,
        n_frames=30,
        bone=("tube",),
        image_px=((480, 360),),
        pitch_mm=0.25,
        shared=0.9,
        ranges=TUBE_RANGES,
    ),
}
