"""Around which centres the circles of constant z run: those of the rims, corrected by how the wall moves.

The rims are edges of the probe and need not lie on circles of constant z. But around a wrong centre, one side of the
wall seems to move farther than the other, by the centre's error over the annulus' width: with enough pairs of frames
that gives the centre better than the rims do. How the centres drift with their radius then shows how far the probe is
off the bore's axis (:mod:`endoct.modalities.endoscope.motion.offset`).
"""

from dataclasses import dataclass

import numpy as np

from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.band import Band
from endoct.modalities.endoscope.motion.motion import FEWEST_PAIRS
from endoct.modalities.endoscope.motion.offset import ON_AXIS, BoreAxis, bore_axis
from endoct.stitching.feed import Feed

MOST_TILT = 0.2


@dataclass(frozen=True)
class Centring:
    """``drift_px`` (x, y): by how much the centre of the circles of constant z drifts from the outer rim to the inner.

    ``axis``: the bore's axis by that drift, None where it is not known.
    """

    drift_px: tuple[float, float]
    axis: BoreAxis | None

    @property
    def shift_px(self) -> tuple[float, float]:
        """By how much the circle of constant z at the outer rim lies off that rim (x, y)."""
        return (self.axis or ON_AXIS).shift_px

    def applied(self, annulus: Annulus) -> Annulus:
        """Return ``annulus`` with the centres of circles of constant z."""
        return annulus.with_drift(*self.drift_px).moved(*self.shift_px)


def measure_centring(annulus: Annulus, feed: Feed, band: Band, *, probe_offset: bool) -> Centring:
    """Return the centres by the rims and by the ``feed``; on the bore's axis unless ``probe_offset``."""
    drift_px = centre_drift_px(annulus, feed)
    axis = bore_axis(drift_px, annulus, band.optics, band.optics.bore_radius_mm) if probe_offset else None
    return Centring(drift_px, axis)


def centre_drift_px(annulus: Annulus, feed: Feed) -> tuple[float, float]:
    """Return how far the centre of circles of constant z drifts from the outer rim to the inner, x and y, px."""
    dx, dy = annulus.inner_x_px - annulus.outer_x_px, annulus.inner_y_px - annulus.outer_y_px
    if np.sum(feed.trusted[1:]) < FEWEST_PAIRS or np.abs(feed.tilt).max() > MOST_TILT:
        return dx, dy
    error = feed.tilt * (annulus.outer_px - annulus.inner_px)
    return dx - float(error[0]), dy - float(error[1])
