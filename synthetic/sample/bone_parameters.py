"""Parameters of the bone: the bore and its cells; see :mod:`endoct.synthetic.sample.parameters`."""

import math
from typing import Annotated, Literal

from pydantic import Field

from endoct.synthetic.sample.parameter_fields import (
    MOST_HARMONICS,
    MOST_LISTED,
    STATED_ONLY,
    Factor,
    Harmonic,
    Parameters,
    Place,
    between,
    drawn,
)
from endoct.synthetic.sample.presets import Bone

Filling = Literal["air", "dust", "fluid"]
Millimetres = Annotated[float, Field(ge=-1e5, le=1e5)]
Point = tuple[Millimetres, Millimetres, Millimetres]


class Cell(Parameters):
    """One cavity that the drill has opened: a hole drilled across the bore, or an air cell.

    Its axis starts on the nominal wall at (``z_mm``, ``theta_rad``) and leans off the radial direction. Coordinates
    (u, v) run across the axis, u along the long direction; w runs along it, counted from the widest part. The cavity
    is (s^p + |w/c|^p)^(1/p) < 1 with p = ``squareness`` and c = ``depth_mm`` − ``bulge_mm``. Here s is 1 on an outline
    of ``diameter_mm`` and ``aspect`` with the ``outline`` harmonics. With ``bulge_mm`` = 0 the cavity is a shaft, open
    towards the bore: there max(w, 0) stands in for the absolute value of w.
    """

    z_mm: Place = Field(description="place of its axis on the wall, from the mouth")
    theta_rad: float = between(0, 6.2832, "place of its axis on the wall")
    diameter_mm: float = between(
        0.2, 2.0, "diameter of the circle of equal area at its widest (required: openings of 0.2–1.5)"
    )
    depth_mm: float = between(0.05, 1.5, "floor below the nominal wall, along its axis (required)")
    bulge_mm: float = between(0, 1.0, "widest part below the nominal wall; 0 for a drilled hole")
    aspect: float = between(0.6, 1.0, "short over long diameter (chosen)")
    tilt_rad: float = between(0, 3.1416, "direction of the long diameter against z")
    lean_rad: float = between(0, 0.8, "angle of its axis to the radial direction (paper: different orientations)")
    lean_direction_rad: float = between(0, 6.2832, "direction of that lean in the wall's plane, against z")
    squareness: float = between(2, 12, "exponent of its shape: 2 an ellipsoid, 12 a drilled shaft (chosen)")
    outline: tuple[Harmonic, ...] = Field(
        max_length=MOST_HARMONICS, description="its departure from an ellipse, relative, harmonics 2, 3, …"
    )
    edge_mm: float = between(0.005, 0.15, "length over which its rim is rounded; large under a lining (chosen)")
    lining: float = between(0.55, 1.0, "albedo of its inside over that of bone; 1 hides the edge (chosen)")
    rim_gain: float = between(0, 0.8, "extra brightness of its rim; 0 for most cells (chosen)")
    filling: Filling = Field(description="what fills it, up to fill_mm")
    fill_mm: float = between(0, 1.5, "surface of the filling below the nominal wall, along the axis")


class Volume(Parameters):
    """A CT of the user's, or a segmentation of one, that the bore is drilled into."""

    path: str = Field(max_length=4096, description="path of the file or the folder of DICOM")
    sha256: str = Field(
        pattern="^[0-9a-f]{64}$", description="sha256 of the file, or over names and sha256 of a folder's files"
    )
    coordinates: Literal["ras", "lps"] = Field(description="what x, y and z of entry and target mean")
    entry_mm: Point = Field(description="where the drill's axis enters the bone")
    target_mm: Point = Field(description="where it ends")
    bone_hu: float | None = Field(ge=-2000, le=10000, description="the least Hounsfield unit of bone; null for labels")
    bone_label: int | None = Field(ge=1, le=65535, description="the label of bone; null for every one but 0")
    detail_mm: float = Field(ge=0, le=0.05, description="rms of added roughness finer than the voxels")

    @property
    def length_mm(self) -> float:
        """Distance from entry to target."""
        return math.dist(self.entry_mm, self.target_mm)


class Network(Parameters):
    """A mastoid in three dimensions: a network of air cells, with what the drill must miss in it."""

    pneumatised: float = drawn(0.45, 1.0, "share of the network that is cells with their septa (chosen)", (0, 1))
    patchiness: float = drawn(0.5, 0.9, "how much pneumatisation differs between regions, 0 to 1 (chosen)", (0, 1))
    cell_mm: float = drawn(1.0, 3.6, "median diameter of the log-normal cells (Cros 2016; LT143)", (0.4, 4))
    cell_spread: float = drawn(0.3, 0.5, "spread (σ) of that, logarithmic (chosen)", (0, 0.7))
    septum_mm: float = drawn(0.10, 0.25, "median thickness of septa (chosen)", (0.02, 0.8))
    septum_spread: float = drawn(0.5, 0.5, "spread (σ) of that, logarithmic (chosen)", (0, 1))
    communicating: float = drawn(0.2, 0.5, "share of septa with a hole in them (chosen)", (0, 1))
    unevenness_mm: float = drawn(0.04, 0.09, "rms of the walls' unevenness over 0.2 mm (chosen)", (0, 0.12))
    detail_mm: float = drawn(0.003, 0.006, "rms of roughness on the walls of cells (chosen)", (0, 0.05))
    cortex_mm: float = drawn(0.5, 2.0, "bone without cells at the mouth (chosen)", (0, 10))
    nerve_mm: float = drawn(0.5, 1.3, "bone between bore and facial nerve (typical: 0.5 at least)", (0.1, 5))
    chorda_mm: float = drawn(0.3, 1.0, "bone between bore and chorda tympani (typical)", (0.05, 5))
    cochlea_mm: float = drawn(4.0, 7.0, "distance from the end of the bore to the basal turn (chosen)", (0.5, 20))
    antrum_mm: float = drawn(3.6, 6.0, "bone and cells between bore and antrum (chosen)", (3.6, 12))
    sinus_mm: float = drawn(4.0, 7.0, "bone and cells between bore and sigmoid sinus (chosen)", (4.0, 12))
    entry_mm: Point = Field(description="mouth of the bore in the patient, LPS; x > 0 is the left ear")
    inward: tuple[Factor, Factor, Factor] = Field(description="direction of the bore in the patient, LPS, unit vector")


class Density(Parameters):
    """How dense the bone is from place to place, in three dimensions; CT, OCT and endoscope all show it.

    No figures of the mastoid were found. ``scale_mm`` is that of dense jaw bone (Lee 2017, J Periodontal Implant Sci
    47:20). ``channel_mm`` lies between canals of compact bone, too small to see, and the emissary canal of 1.3 mm
    (Özen 2019, doi 10.5505/vtd.2019.69077).
    """

    contrast: float = drawn(0.08, 0.2, "rms of the density over its mean (chosen)", (0, 0.3))
    scale_mm: float = drawn(0.3, 0.9, "distance over which its correlation falls to 1/e (Lee 2017, of jaws)", (0.3, 2))
    channel_mm: float = drawn(0.1, 0.4, "median diameter of channels of vessels; 0 for none (chosen)", (0, 1))
    channels_per_mm2: float = drawn(0.03, 0.1, "channels that cross a mm² of any plane (chosen)", (0.03, 0.3))
    marrow_db: float = drawn(-15, -6, "scattering of what channels hold against bone (chosen)", (-40, 0))
    albedo: float = drawn(0.2, 0.5, "share of a change of density that the albedo changes by (chosen)", (0, 1))


class Ct(Parameters):
    """A CT of the bone: a clinical one before drilling, or one by a cone-beam scanner after it."""

    voxel_mm: float = drawn(0.15, 0.3, "size of the voxels (typical)", (0.1, 1))
    psf_mm: float = drawn(0.35, 0.6, "full width at half maximum of the point spread (typical)", (0.05, 2))
    noise_hu: float = drawn(30, 100, "rms of the noise (typical)", (0, 1000))
    bone_hu: float = drawn(1300, 1900, "dense bone (typical)", (300, 3000))
    slice_mm: float | None = Field(default=None, ge=0.1, le=2, description="distance of the slices; null for voxel_mm")


class Tube(Parameters):
    """A printed tube to calibrate by, in place of bone: an axial and a helical groove, and two rings.

    The grooves have their widths along the circumference, and are inked. ``sigma_*``: the standard errors that
    are stated of it; ``*_error``: by how many of these it is off. The capillary is that of the OCT.
    """

    groove_width_mm: float = drawn(0.35, 0.35, "of the axial groove at θ = 0 (chosen)", (0.1, 1))
    helix_width_mm: float = drawn(0.5, 0.5, "of the helical groove (chosen)", (0.1, 1))
    groove_depth_mm: float = drawn(0.3, 0.3, "of both grooves (chosen)", (0.05, 1))
    helix_theta_rad: float = drawn(1.5708, 1.5708, "of the helical groove at the mouth (chosen)", (-6.2832, 6.2832))
    helix_lead_mm: float = drawn(7.0, 7.0, "length over which it goes once around, with θ inward (chosen)", (2, 50))
    ring_depth_mm: float = drawn(0.4, 0.4, "of both rings (chosen)", (0.05, 1))
    narrow_z_mm: float = drawn(3.6, 3.6, "of the narrow ring's middle, from the mouth (chosen)", (0.5, 50))
    narrow_width_mm: float = drawn(0.6, 0.6, "of the narrow ring (chosen)", (0.1, 5))
    wide_z_mm: float = drawn(7.2, 7.2, "of the wide ring's middle, from the mouth (chosen)", (0.5, 50))
    wide_width_mm: float = drawn(1.8, 1.8, "of the wide ring (chosen)", (0.1, 5))
    edge_mm: float = drawn(0.02, 0.05, "over which edges are rounded (a printer of 50 µm)", (0.005, 0.2))
    ink: float = drawn(0.25, 0.5, "albedo of ink over that of the tube (chosen)", (0, 1))
    brim_mm: float = drawn(0.0, 0.03, "depth from which grooves are inked, filled and wiped (chosen)", (0, 0.3))
    sigma_bore_mm: float = drawn(0.001, 0.005, "of the bore's diameter (a pin gauge)", (0, 0.1))
    sigma_depth_mm: float = drawn(0.001, 0.010, "of the depths, one error for all (measured, or printed)", (0, 0.1))
    sigma_z_mm: float = drawn(0.002, 0.020, "of the distance of the rings (measured, or printed)", (0, 0.2))
    sigma_capillary_mm: float = drawn(0.001, 0.004, "of the capillary's outer diameter (a micrometer)", (0, 0.1))
    bore_error: float = between(-5, 5, "of the bore's diameter, standard errors")
    depth_error: float = between(-5, 5, "of the depths, standard errors")
    z_error: float = between(-5, 5, "of the distance of the rings, standard errors")
    capillary_error: float = between(-5, 5, "of the stated diameter of the capillary, standard errors")
    axial_pixel_factor: float = drawn(0.97, 1.03, "stated over true axial pixel of the OCT (chosen)", (0.5, 2))
    pitch_factor: float = drawn(0.97, 1.03, "stated over true pitch of the pullback (chosen)", (0.5, 2))

    @property
    def stretch(self) -> float:
        """By what factor the true tube is longer than the stated one."""
        return 1 + self.z_error * self.sigma_z_mm / (self.wide_z_mm - self.narrow_z_mm)


class Bore(Parameters):
    """The drill hole and its cells."""

    bone: Bone = Field(
        description="phantom: drilled bone substitute; mastoid: air cells planted on the wall; network: a "
        "three-dimensional mastoid; volume: the user's CT; tube: a printed tube to calibrate by",
        json_schema_extra={STATED_ONLY: ["volume", "tube"]},
    )
    diameter_mm: float = drawn(2.4, 2.6, "nominal diameter, as in both sidecars (paper: 2.5)", (1.6, 4.0))
    length_mm: float = Field(ge=0.1, lt=100, description="length of the simulated wall, from the mouth")
    taper_mm: float = drawn(-0.015, 0.015, "change of radius from mouth to end (chosen)", (-0.2, 0.2))
    tilt_rad: float = drawn(0, 0.001, "angle between bore and capillary (chosen)", (0, 0.01))
    tilt_direction_rad: float = drawn(0, 6.2832, "θ towards which the bore leans")
    wander_mm: float = drawn(0.004, 0.015, "rms of the smooth departures from a cylinder (chosen)", (0, 0.05))
    roughness_mm: float = drawn(0.001, 0.004, "rms of cut bone (chosen)", (0, 0.02))
    drill_mark_depth_mm: float = drawn(0.001, 0.006, "amplitude of the drill's helical mark (chosen)", (0, 0.05))
    drill_mark_pitch_mm: float = drawn(0.08, 0.25, "feed of the drill in one turn (chosen)", (0.02, 2))
    texture: float = drawn(0.08, 0.16, "rms of the albedo of bone, relative (chosen)", (0, 0.6))
    smear: float = drawn(0.10, 0.30, "albedo lost under smears of bone dust and blood, 6 % of it (chosen)", (0, 1))
    cell_fraction: float = drawn(
        0.10, 0.27, "wall to be cut away by cells; lands within 0.08–0.30 (required)", (0, 0.4)
    )
    septum_mm: float = drawn(0.03, 0.12, "bone left between neighbours, mastoid only (chosen)", (0, 0.5))
    communicating: float = drawn(0.1, 0.3, "share of cells that run into a neighbour, mastoid only (chosen)", (0, 1))
    lining: float = drawn(0.0, 0.1, "share of cells under a lining that hides the edge (chosen)", (0, 1))
    dust: float = drawn(0.0, 0.0, "share of cells with bone dust on their floor (chosen)", (0, 1))
    fluid: float = drawn(0.0, 0.0, "share of cells with fluid on their floor (chosen)", (0, 1))
    cells: tuple[Cell, ...] = Field(
        default=(), max_length=MOST_LISTED, description="planted cells; phantom and mastoid only"
    )
    volume: Volume | None = Field(default=None, description="the CT; volume only")
    network: Network | None = Field(default=None, description="network only")
    density: Density | None = Field(default=None, description="network and volume only; null for even bone")
    tube: Tube | None = Field(default=None, description="tube only")
