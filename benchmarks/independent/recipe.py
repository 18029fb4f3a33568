"""What a pair of recordings is made from: everything that is chosen rather than left to chance."""

from dataclasses import dataclass, field
from typing import Literal

Stated = Literal["optics", "half_angle", "visible_length", "feed"]
CatheterFault = Literal[
    "turn_step", "start_jump", "lost_slices", "swapped_slices", "pitch", "capillary", "upside_down", "no_catheter"
]
MirrorFault = Literal["far_rim", "non_square", "saturated", "pipe_end"]


@dataclass(frozen=True)
class BoreRecipe:
    """The bore and its cells. Ranges are (low, high), drawn evenly for each cell; sizes are equivalent diameters.

    ``cells_mm`` is the stretch of the bore in which cells have their centres.
    """

    diameter_mm: float = 2.5
    length_mm: float = 13.0
    cells: int = 16
    cells_mm: tuple[float, float] = (2.2, 10.0)
    size_mm: tuple[float, float] = (0.45, 1.4)
    depth_mm: tuple[float, float] = (0.2, 1.2)
    floor_slope: float = 0.5
    ragged: float = 0.16
    roughness_mm: float = 0.006
    texture: float = 0.12
    floor_brightness: tuple[float, float] = (0.3, 0.65)


@dataclass(frozen=True)
class CatheterRecipe:
    """The OCT pullback. ``offset_mm`` is the steady eccentricity, ``wander_mm`` what is added to it slowly.

    ``pitch_factor`` and ``capillary_factor`` are stated / true. ``fault_size`` is in the unit of the fault: rad for
    the angles, slices for lost and swapped ones, stated / true for pitch and capillary.
    """

    slices: int = 60
    pitch_mm: float = 0.16
    a_scans: int = 420
    depths: int = 400
    axial_pixel_mm: float = 0.005
    first_sample_mm: float = 0.2
    start_mm: float = 2.0
    start_rad: float = 1.0
    mirrored: bool = False
    travel: Literal["out", "in"] = "out"
    offset_mm: float = 0.15
    offset_rad: float = 0.7
    wander_mm: float = 0.0
    capillary_outer_mm: float = 1.7
    glass_mm: float = 0.15
    glass_index: float = 1.46
    sheath_mm: float = 0.84
    signal_db: float = 27.0
    attenuation_per_mm: float = 3.5
    linear: bool = False
    lines: tuple[int, ...] = ()
    states_handedness: bool = False
    states_travel: bool = True
    fault: CatheterFault | None = None
    fault_size: float = 0.0


@dataclass(frozen=True)
class MirrorRecipe:
    """The endoscope: a pinhole before a cone, its light, its motion and what its sidecar states.

    ``inner_share`` is the inner rim's radius in the image over the outer one's, ``rim_shift_px`` by how much the rims
    are shifted from the optical axis (px), ``bore_offset_mm`` how far the probe's axis lies from the bore's,
    ``length_mm`` the wall seen in all, ``start_mm`` where that begins.
    """

    half_angle_deg: float = 45.0
    distance_mm: float = 5.0
    mirror_radius_mm: float = 0.95
    size_px: int = 380
    outer_px: float = 165.0
    inner_share: float = 0.4
    rim_shift_px: float = 1.5
    bore_offset_mm: float = 0.03
    aspect: float = 1.0
    ahead: bool = True
    travel: Literal["in", "out"] = "in"
    length_mm: float = 8.0
    overlap: float = 0.75
    start_mm: float = 2.0
    start_rad: float = 0.3
    feed_jitter: float = 0.06
    feed_factor: float = 1.0
    roll_rad: float = 0.01
    exposure: float = 0.8
    light_around: float = 0.2
    light_along: float = 0.3
    ring: float = 0.4
    noise: float = 1.2
    stated: Stated = "optics"
    states_annulus: bool = False
    states_travel: bool = True
    fault: MirrorFault | None = None


@dataclass(frozen=True)
class Recipe:
    """A whole pair."""

    bore: BoreRecipe = field(default_factory=BoreRecipe)
    oct: CatheterRecipe = field(default_factory=CatheterRecipe)
    endoscope: MirrorRecipe = field(default_factory=MirrorRecipe)
