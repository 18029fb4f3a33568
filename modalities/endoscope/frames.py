"""Frames: the annulus in each and its strip, in logarithms; then where each lies along and around the wall."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.base.compute.memory import Kept, Room
from endoct.base.compute.parallel import thread_map
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError
from endoct.base.numeric.circle import turned_harmonic
from endoct.base.numeric.ranks import error_of_median
from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.endoscope.light import log_light, reduced_light
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.annulus import LEAST_SUPPORT, Annulus, Followed, follow
from endoct.modalities.endoscope.mirror.band import Band, Circles
from endoct.modalities.endoscope.mirror.optics import DISAGREEMENT
from endoct.modalities.endoscope.mirror.ring_search import Reference, settle_annuli, squared
from endoct.modalities.endoscope.mirror.rings import sample
from endoct.modalities.endoscope.motion import FEWEST_PAIRS, Centring, Motion
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.stitching.motion.feed import Feed

DOUBTED_FEED, SURE_OF_FEED = 0.1, 2.5
"""Measured and nominal feed contradict each other if they differ by more: relative, and in standard errors."""
STRIP_COLUMNS = 1024
_ROOM = Room()

BY_MOVEMENT = (
    "The mirror's rims are no clear edges of light; they were found where what is seen begins to change from frame to "
    "frame."
)

LogStrip = NDArray[np.float16]
"""Logarithm of a frame's brightness, float16 (n_rows, ``STRIP_COLUMNS``), image angles; NaN outside the image and
under an overlay."""


@dataclass(frozen=True, eq=False)
class Frames:
    """What was measured in every frame.

    Attributes: ``annuli`` in pixels of the files; ``annulus_found``, bool (n,), whether it was measured there or taken
    from the frames around; ``own_radii_px``, float64 (n, 2), of its inner and outer rim by that frame alone, NaN where
    they are not clear; ``saturated_fraction``, float64 (n,), of its strip.
    """

    annuli: tuple[Annulus, ...]
    annulus_found: Mask
    own_radii_px: Coordinates
    saturated_fraction: Coordinates


def examine_frames(
    stream: FrameStream, reference: Reference, band: Band, strips: Kept[LogStrip]
) -> tuple[Frames, tuple[str, ...]]:
    """Append the strip of every frame to ``strips``; return what was measured, and notes on it."""
    examine = partial(_examine, reference=reference, r_px=np.divide(band.r_px, reference.factor))
    followed, alone, saturated_fraction = [], [], []
    for of_frame, by_itself, fraction, strip in thread_map(examine, stream):
        followed.append(of_frame)
        alone.append(by_itself)
        saturated_fraction.append(fraction)
        strips.append(strip)
    annuli, found = settle_annuli(followed, reference.annulus, given=True)
    clear = np.array([of.support >= 2 * LEAST_SUPPORT for of in alone])
    radii = [(of.annulus.inner_px, of.annulus.outer_px) for of in alone]
    frames = Frames(
        tuple(replace(a.scaled(reference.factor), pixels=reference.annulus.pixels) for a in annuli),
        found,
        np.where(clear[:, None], np.multiply(radii, reference.factor), np.nan),
        np.array(saturated_fraction),
    )
    by_movement = (BY_MOVEMENT,) if reference.handle else ()
    if found.all():
        return frames, by_movement
    return frames, (
        *by_movement,
        f"The annulus could not be measured in {np.sum(~found)} of {len(found)} frames; "
        "its place there is that of the frames around.",
    )


def brightness_of_rows(logs: LogStrip) -> Coordinates:
    """Return how bright most of every row of a strip is, natural logarithm, float64 (n_rows,), NaN where none is seen.

    That is its upper quartile: cells seldom fill three quarters of the way around.
    """
    ordered = np.sort(logs.astype(np.float32), axis=1)  # NaN last
    count = np.isfinite(ordered).sum(axis=1)
    at = np.floor(0.75 * np.maximum(count - 1, 0)).astype(np.intp)
    return np.where(count > 0, ordered[np.arange(len(ordered)), at], np.nan)


def _examine(frame: Frame, *, reference: Reference, r_px: Coordinates) -> tuple[Followed, Followed, float, LogStrip]:
    """Return a frame's annulus, that by its own rims, its saturated share, and its strip at radii ``r_px``."""
    pixels = reference.annulus.pixels
    light, clipped = reduced_light(frame.samples, reference.full_scale, reference.factor, _ROOM)
    image = squared(light, pixels)
    followed = follow(image, reference.annulus, reference.handle)
    alone = follow(image, reference.annulus) if reference.handle else followed
    place = replace(settle_annuli([followed], reference.annulus, given=True)[0][0], pixels=1.0)
    angle = np.linspace(0, 2 * np.pi, STRIP_COLUMNS, endpoint=False)
    columns, rows = Circles(place, r_px).pixel_map(angle, _ROOM)
    strip, inside = sample(image, columns, rows)
    seen = inside
    if reference.overlay is not None:
        covered, _ = sample(reference.overlay.astype(np.float32), columns, rows)
        seen = inside & (covered == 0)
    logs = np.where(seen, log_light(strip), np.nan).astype(np.float16)
    fraction = 0.0
    if clipped is not None and seen.any():
        share, _ = sample(squared(clipped, pixels), columns, rows)
        fraction = float(share[seen].mean())
    return followed, alone, fraction, logs


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
