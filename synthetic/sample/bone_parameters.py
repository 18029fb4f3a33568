"""Parameters of the bone: the bore and its cells; see :mod:`endoct.synthetic.sample.parameters`."""

from typing import Literal

from pydantic import Field

from endoct.synthetic.sample.parameter_fields import (
    MOST_HARMONICS,
    MOST_LISTED,
    Harmonic,
    Parameters,
    Place,
    between,
    drawn,
)
from endoct.synthetic.sample.presets import Bone

Filling = Literal["air", "dust", "fluid"]


class Cell(Parameters):
    """One cavity that the drill has opened: a hole drilled across the bore, or an air cell.

    Its axis starts on the nominal wall at (``z_mm``, ``theta_rad``) and leans off the radial direction. With
    (u, v) across the axis, u along the long direction, and w along it, counted from the widest part, the
    cavity is (s^p + |w/c|^p)^(1/p) < 1 with p = ``squareness``, s = 1 on an outline of ``diameter_mm`` and
    ``aspect`` with the ``outline`` harmonics, and c = ``depth_mm`` − ``bulge_mm``. With ``bulge_mm`` = 0 it is a
    shaft, open towards the bore: there max(w, 0) stands in for the absolute value of w.
    """

    z_mm: Place = Field(description="of its axis at the wall, mm from the mouth")
    theta_rad: float = between(0, 6.2832, "of its axis at the wall, rad")
    diameter_mm: float = between(
        0.2, 2.0, "of the circle of equal area at its widest, mm (required: openings of 0.2–1.5)"
    )
    depth_mm: float = between(0.05, 1.5, "of its floor below the nominal wall, along its axis, mm (required)")
    bulge_mm: float = between(0, 1.0, "of its widest part below the nominal wall, mm; 0 for a drilled hole")
    aspect: float = between(0.6, 1.0, "short over long diameter (chosen)")
    tilt_rad: float = between(0, 3.1416, "direction of the long diameter against z, rad")
    lean_rad: float = between(0, 0.8, "of its axis off the radial direction, rad (paper: different orientations)")
    lean_direction_rad: float = between(0, 6.2832, "of that lean in the wall's plane, against z, rad")
    squareness: float = between(2, 12, "exponent of its shape: 2 an ellipsoid, 12 a drilled shaft (chosen)")
    outline: tuple[Harmonic, ...] = Field(
        max_length=MOST_HARMONICS, description="its departure from an ellipse, relative, harmonics 2, 3, …"
    )
    edge_mm: float = between(0.005, 0.15, "length over which its rim is rounded; large under a lining, mm (chosen)")
    lining: float = between(0.55, 1.0, "albedo of its inside over that of bone; 1 hides the edge (chosen)")
    rim_gain: float = between(0, 0.8, "extra brightness of its rim; 0 for most cells (chosen)")
    filling: Filling = Field(description="what is in it below fill_mm")
    fill_mm: float = between(0, 1.5, "of the surface of the filling below the nominal wall, along the axis, mm")


class Bore(Parameters):
    """The drill hole and its cells."""

    bone: Bone = Field(description="drilled bone substitute, or a pneumatised mastoid")
    diameter_mm: float = drawn(2.4, 2.6, "nominal, stands in both sidecars, mm (paper: 2.5)", (1.6, 4.0))
    length_mm: float = Field(ge=0.1, lt=100, description="of the simulated wall, from the mouth, mm")
    taper_mm: float = drawn(-0.015, 0.015, "change of radius from mouth to end, mm (chosen)", (-0.2, 0.2))
    tilt_rad: float = drawn(0, 0.001, "of the bore against the capillary in it, rad (chosen)", (0, 0.01))
    tilt_direction_rad: float = drawn(0, 6.2832, "towards which the bore leans, θ, rad")
    wander_mm: float = drawn(0.004, 0.015, "rms of the smooth departures from a cylinder, mm (chosen)", (0, 0.05))
    roughness_mm: float = drawn(0.001, 0.004, "rms of cut bone, mm (chosen)", (0, 0.02))
    drill_mark_depth_mm: float = drawn(0.001, 0.006, "amplitude of the drill's helical mark, mm (chosen)", (0, 0.05))
    drill_mark_pitch_mm: float = drawn(0.08, 0.25, "feed of the drill a turn, mm (chosen)", (0.02, 2))
    texture: float = drawn(0.08, 0.16, "rms of the albedo of bone, relative (chosen)", (0, 0.6))
    smear: float = drawn(0.10, 0.30, "albedo lost under smears of bone dust and blood, 6 % of it (chosen)", (0, 1))
    cell_fraction: float = drawn(
        0.10, 0.27, "wall to be cut away by cells; lands within 0.08–0.30 (required)", (0, 0.4)
    )
    septum_mm: float = drawn(0.03, 0.12, "bone left between neighbours, mastoid only, mm (chosen)", (0, 0.5))
    communicating: float = drawn(0.1, 0.3, "share of cells that run into a neighbour, mastoid only (chosen)", (0, 1))
    lining: float = drawn(0.0, 0.1, "share of cells under a lining that hides the edge (chosen)", (0, 1))
    dust: float = drawn(0.0, 0.0, "share of cells with bone dust on their floor (chosen)", (0, 1))
    fluid: float = drawn(0.0, 0.0, "share of cells with fluid on their floor (chosen)", (0, 1))
    cells: tuple[Cell, ...] = Field(default=(), max_length=MOST_LISTED)
