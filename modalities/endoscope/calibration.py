"""What the survey of an endoscope's recording measured.

Geometry and quality of every frame have the names of the manifest, by which panorama and report list them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.doubt import Doubt
from endoct.modalities.endoscope.flatfield import FlatField
from endoct.modalities.endoscope.frames import FramePlaces, Frames
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.optics import ConeOptics
from endoct.modalities.endoscope.motion import Centring, Motion, probe_offsets
from endoct.stitching.grid import SurfaceGrid


@dataclass(frozen=True, eq=False)
class EndoscopeCalibration:
    """What a survey measured; everything that unrolling a frame needs besides the frame.

    ``annuli``: one a frame, in pixels of the files. The centre of circles of constant z lies ``shift_px`` (x, y) off
    the outer rim, and drifts by ``drift_px`` to the inner rim. ``z_mm``: of every frame's band centre.
    θ of the wall is image angle + ``roll_rad`` (n,) + ``sway_rad`` (n, 2) · (cos, sin) of their sum. ``strip_z_mm``:
    rows of the flat field from the band's centre. ``exposure`` (n,): logarithm of what each frame is brighter than its
    light says.
    ``overlay``: pixels of the files that something was drawn over, bool (row, column); None where there are none.
    ``doubts``: what questions where everything lies; ``notes``: what concerns some frames.
    """

    grid: SurfaceGrid
    row_z_mm: Coordinates
    per_frame: Mapping[str, NDArray[Any]]
    notes: tuple[str, ...]
    handedness_known: bool
    travel_known: bool
    annuli: tuple[Annulus, ...]
    drift_px: tuple[float, float]
    shift_px: tuple[float, float]
    z_mm: Coordinates
    roll_rad: Coordinates
    sway_rad: Coordinates
    optics: ConeOptics
    flat: FlatField
    exposure: Coordinates
    strip_z_mm: Coordinates
    full_scale: float
    overlay: Mask | None
    oversample: tuple[int, int]
    taper: float
    doubts: tuple[Doubt, ...] = ()

    def image_angle(self, index: int, theta_rad: Coordinates) -> Coordinates:
        """Return the angle in frame ``index`` at which the wall's ``theta_rad`` (any shape) is seen."""
        cos, sin = self.sway_rad[index]
        sway = cos * np.cos(theta_rad) + sin * np.sin(theta_rad)
        ray = theta_rad - sway
        sway = cos * np.cos(ray) + sin * np.sin(ray)
        return np.asarray(theta_rad - sway - self.roll_rad[index])


def per_frame_values(
    frames: Frames, motion: Motion, centring: Centring, places: FramePlaces, exposure: Coordinates
) -> dict[str, NDArray[Any]]:
    """Return the numbers per frame, in recording order."""
    feed, optics, annuli = motion.feed, motion.band.optics, frames.annuli
    # an assumed cone gives z along the annulus, but not the direction of view: other mirrors show the same z(r)
    slant = np.nan if optics.assumed else float(optics.slant(optics.r_px(motion.band.outward_mm)).mean())
    return {
        "view_slant": np.full(places.z_mm.size, slant),
        "z_mm": places.z_mm,
        "roll_rad": np.mod(places.roll_rad, 2 * np.pi),
        "annulus_x_px": np.array([a.columns(np.float64(a.outer_x_px)) for a in annuli]),
        "annulus_y_px": np.array([a.outer_y_px for a in annuli]),
        "annulus_inner_px": np.array([a.inner_px for a in annuli]),
        "annulus_outer_px": np.array([a.outer_px for a in annuli]),
        "annulus_inner_x_px": np.array([a.columns(np.float64(a.inner_x_px)) for a in annuli]),
        "annulus_inner_y_px": np.array([a.inner_y_px for a in annuli]),
        "annulus_found": frames.annulus_found,
        "feed_mm": np.concatenate([[np.nan], np.diff(places.z_mm)]),
        "pair_correlation": feed.correlation,
        "pair_confidence": feed.confidence,
        "pair_trusted": feed.trusted,
        "exposure": np.exp(exposure),
        "saturated_fraction": frames.saturated_fraction,
        **probe_offsets(centring.axis, places.sway_rad, optics.bore_radius_mm),
    }
