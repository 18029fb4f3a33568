"""Geometry and quality of every frame by the names of the manifest, as the panorama and the report show them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.endoscope.frames import Frames
from endoct.modalities.endoscope.motion.centring import Centring
from endoct.modalities.endoscope.motion.motion import Motion
from endoct.modalities.endoscope.motion.offset import probe_offsets
from endoct.modalities.endoscope.motion.places import Places
from endoct.stitching.arrays import Coordinates


def per_frame_values(
    frames: Frames, motion: Motion, centring: Centring, places: Places, exposure: Coordinates
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
