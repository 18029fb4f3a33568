"""Where every frame lies along and around the wall, from the measured and the nominal feed."""

from dataclasses import dataclass

import numpy as np

from endoct.base.arrays import Coordinates
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import turned_harmonic
from endoct.base.numeric.ranks import error_of_median
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.optics import DISAGREEMENT
from endoct.modalities.endoscope.motion import FEWEST_PAIRS, Centring, Motion
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.stitching.motion.feed import Feed

DOUBTED_FEED, SURE_OF_FEED = 0.1, 2.5
"""Measured and nominal feed contradict each other if they differ by more: relative, and in standard errors."""


@dataclass(frozen=True, eq=False)
class FramePlaces:
    """``z_mm`` (0 nearest the mouth) and ``roll_rad`` of every frame, float64 (n,), and ``sway_rad``, (n, 2).

    θ of the wall is image angle + roll + sway · (cos, sin) of their sum. ``doubts``: what questions where all lies.
    """

    z_mm: Coordinates
    roll_rad: Coordinates
    sway_rad: Coordinates
    doubts: tuple[Doubt, ...]


def place_frames(
    motion: Motion,
    centring: Centring,
    nominal: Coordinates | None,
    acquisition: EndoscopeAcquisition,
    parameters: EndoscopeParameters,
) -> tuple[FramePlaces, tuple[str, ...]]:
    """Return the places of all frames, and notes on them.

    Raises :class:`EndoctError` where neither the frames nor the sidecar give the feed.
    """
    feed = motion.feed
    notes = _notes_on_pairs(feed, nominal)
    z_mm = motion.band.optics.rim_sign * feed.z_mm
    if nominal is not None and feed.measured:
        notes += _notes_on_span(z_mm, nominal, parameters.feed_sigma)
    if not parameters.correct_feed:
        if nominal is None:
            raise EndoctError(
                "frames cannot be placed by the nominal feed",
                found="no feed_pitch_mm or positions_mm in the sidecar, and correct_feed = false",
                remedy="add feed_pitch_mm to the sidecar, or leave correct_feed on",
            )
        z_mm = nominal
    z_mm = z_mm - z_mm.min()
    if parameters.correct_roll:  # θ = 0 is the sidecar's origin at the frame nearest the mouth
        roll_rad = feed.roll_rad - feed.roll_rad[int(np.argmin(z_mm))] + acquisition.theta_origin_rad
    else:
        roll_rad = np.full(z_mm.size, acquisition.theta_origin_rad)
    sway_rad = turned_harmonic(feed.sway_rad, float(roll_rad[0] - feed.roll_rad[0]))
    if centring.axis is not None:
        radius_mm = motion.band.optics.bore_radius_mm
        sway_rad = sway_rad + centring.axis.sway_rad(float(np.median(roll_rad)), radius_mm)
    return FramePlaces(z_mm, roll_rad, sway_rad, _doubts_of_feed(feed, nominal)), notes


def _notes_on_pairs(feed: Feed, nominal: Coordinates | None) -> tuple[str, ...]:
    n, distrusted = feed.z_mm.size, int(np.sum(~feed.trusted))
    if n > 1 and nominal is None and not feed.measured:
        raise EndoctError(
            "the feed between the frames is not known",
            found="no feed_pitch_mm or positions_mm in the sidecar, and no two frames whose overlap could be matched",
            expected="either of them",
            remedy="add feed_pitch_mm to the sidecar",
        )
    if not distrusted:
        return ()
    fallback = "the nominal feed" if nominal is not None else "the median of the others"
    return (
        f"{distrusted} of {n - 1} pairs of neighbouring frames could not be matched; "
        f"where the frames around them did not settle it, {fallback} was used.",
    )


def _notes_on_span(z_mm: Coordinates, nominal: Coordinates, feed_sigma: float) -> tuple[str, ...]:
    measured, expected = float(np.ptp(z_mm)), float(np.ptp(nominal))
    tolerance = max(DISAGREEMENT, 2 * feed_sigma / np.sqrt(z_mm.size - 1))
    if abs(measured - expected) <= tolerance * expected:
        return ()
    return (f"The frames span {measured:.2f} mm as measured and {expected:.2f} mm by the nominal feed.",)


def _doubts_of_feed(feed: Feed, nominal: Coordinates | None) -> tuple[Doubt, ...]:
    """Return a doubt where neighbouring frames lie much farther apart, or nearer, than the nominal feed has them."""
    if nominal is None:
        return ()
    measured_mm, stated_mm = (np.abs(np.diff(z_mm)) for z_mm in (feed.z_mm, nominal))
    known = feed.trusted[1:] & (measured_mm > 0) & (stated_mm > 0)
    if known.sum() < FEWEST_PAIRS:
        return ()
    measured_mm, stated_mm = measured_mm[known], stated_mm[known]
    ratio = float(np.median(measured_mm / stated_mm))
    error = error_of_median(measured_mm / stated_mm - ratio)
    if abs(ratio - 1) <= max(DOUBTED_FEED, SURE_OF_FEED * error):
        return ()
    step_mm, nominal_mm = float(np.median(measured_mm)), float(np.median(stated_mm))
    what = (
        f"Neighbouring frames lie {step_mm:.3f} mm apart as measured and {nominal_mm:.3f} mm by the nominal feed, in "
        "the median: the annulus, its visible length or that feed is wrong, and z with it."
    )
    return (Doubt("feed-against-nominal", what, None, step_mm, "mm", nominal_mm, key="feed_pitch_mm"),)
