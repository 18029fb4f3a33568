"""Where every frame lies along and around the wall, from what its strip shares with the next."""

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.contract import FrameStream, inward_positions_mm
from endoct.modalities.endoscope.annulus import Annulus
from endoct.modalities.endoscope.flatfield import FlatField
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.optics import DISAGREEMENT, ConeOptics, stretched, turned
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.errors import EndoctError
from endoct.stitching.feed import Feed, estimate_feed
from endoct.stitching.kept import Computed, Kept

FEED_COLUMNS = 512
FEWEST_FOR_DRIFT = 5
MOST_TILT = 0.2
CLIP = (-0.3, 0.3)
DOUBTED_FEED, SURE_OF_FEED = 0.1, 2.5
"""From what difference of measured and nominal feed on, relative and in standard errors, one of them must be wrong."""
SURE_STRETCH = 3.0
"""Standard errors that the feed must be uneven by before another cone is assumed."""


def nominal_mm(stream: FrameStream, acquisition: EndoscopeAcquisition) -> Coordinates | None:
    """Return the nominal z of every frame (n,), or None where the sidecar does not say."""
    if acquisition.positions_mm is None and acquisition.pitch_mm is None:
        return None
    return inward_positions_mm(
        len(stream),
        pitch_mm=acquisition.pitch_mm or 0.0,
        travel=acquisition.travel,
        positions_mm=acquisition.positions_mm,
    )


def measured_feed(
    logs: Kept[NDArray[np.float16]],
    flat: FlatField,
    exposure: Coordinates,
    outward_mm: Coordinates,
    nominal: Coordinates | None,
    acquisition: EndoscopeAcquisition,
    optics: ConeOptics,
    parameters: EndoscopeParameters,
) -> Feed:
    """Return feed in mm outward in the image (multiply by the rim's sign for z) and roll, from reduced strips."""
    n_rows = flat.log_light.shape[0]

    def texture(k: int) -> Image:
        even = np.clip(logs[k].astype(np.float32) - flat.log_light - np.float32(exposure[k]), CLIP[0], CLIP[1])
        even[~flat.usable] = np.nan
        return np.asarray(even.reshape(n_rows, FEED_COLUMNS, -1).mean(axis=2), np.float32)

    return estimate_feed(
        Computed(len(logs), texture),
        float(outward_mm[1] - outward_mm[0]),
        acquisition.bore_diameter_mm / 2,
        None if nominal is None else optics.rim_sign * nominal,
        relative_sigma=parameters.feed_sigma,
    )


def scale_by_feed(feed: Feed, nominal: Coordinates | None, visible_length_mm: float, notes: list[str]) -> float:
    """Return by how much a guessed ``visible_length_mm`` is too small, from the ``feed`` measured with it.

    Raises :class:`EndoctError` where too few frames could be matched for that.
    """
    known = feed.trusted[1:] & (np.abs(np.diff(feed.z_mm)) > 0)
    if nominal is None or known.sum() < FEWEST_FOR_DRIFT:
        raise EndoctError(
            "the scale along the bore is not known",
            found=f"no visible_length_mm in the sidecar, and {int(known.sum())} pairs of frames to measure it by",
            expected=f"either it or {FEWEST_FOR_DRIFT} pairs of neighbouring frames that overlap and could be matched",
            remedy="add visible_length_mm: put a scale into a bore of that diameter and read off what the ring shows",
        )
    larger = np.abs(np.diff(nominal))[known] / np.abs(np.diff(feed.z_mm))[known]
    ratio = float(np.median(larger))
    error = 1.25 * 1.48 * float(np.median(np.abs(larger - ratio))) / ratio / float(np.sqrt(known.sum()))
    notes.append(
        f"The sidecar does not give visible_length_mm; by the nominal feed it is {ratio * visible_length_mm:.3f} mm "
        f"(± {error:.1%}, if the nominal feed is right on average)."
    )
    return ratio


def optics_with_rim(optics: ConeOptics, acquisition: EndoscopeAcquisition, feed: Feed, notes: list[str]) -> ConeOptics:
    """Return the optics with the rim that the measured feed tells, where the sidecar does not."""
    if feed.direction > 0 or acquisition.travel == "unknown":
        return optics
    if acquisition.outer_rim is None:
        notes.append(
            "The sidecar does not say which way the outer rim looks; by the way the frames move it looks behind, "
            "and that was used."
        )
        return turned(optics)
    notes.append(
        f"The frames move against the sidecar's travel '{acquisition.travel}' with the outer rim "
        f"'{acquisition.outer_rim}'; one of the two is wrong, and the rim was believed."
    )
    return optics


def self_calibrated(optics: ConeOptics, feed: Feed, notes: list[str]) -> ConeOptics:
    """Return optics that were only assumed with the cone by which the feed is even all over the annulus."""
    stretch, error = feed.stretch
    if not optics.assumed or abs(stretch) < SURE_STRETCH * error:
        return optics
    found = stretched(optics, stretch)
    notes.append(
        "The sidecar does not give the mirror's optics; a half angle of "
        f"{np.rad2deg(found.half_angle_rad):.1f}° fits how the wall moves through the annulus, and was used."
    )
    return found


def centre_drift_px(annulus: Annulus, feed: Feed) -> tuple[float, float]:
    """Return how far the centre of circles of constant z drifts from the outer rim to the inner, x and y, px.

    The rims are edges of the probe and need not lie on circles of constant z. But around a wrong centre, one side
    of the wall seems to move farther than the other, by the centre's error over the annulus' width: with enough
    pairs that is measured better than the rims say it.
    """
    dx, dy = annulus.inner_x_px - annulus.outer_x_px, annulus.inner_y_px - annulus.outer_y_px
    if np.sum(feed.trusted[1:]) < FEWEST_FOR_DRIFT or np.abs(feed.tilt).max() > MOST_TILT:
        return dx, dy
    error = feed.tilt * (annulus.outer_px - annulus.inner_px)
    return dx - float(error[0]), dy - float(error[1])


def placed(
    feed: Feed,
    optics: ConeOptics,
    nominal: Coordinates | None,
    acquisition: EndoscopeAcquisition,
    parameters: EndoscopeParameters,
    notes: list[str],
) -> tuple[Coordinates, Coordinates]:
    """Return z (0 nearest the mouth) and roll (the sidecar's θ origin there) of every frame."""
    n = feed.z_mm.size
    distrusted = int(np.sum(~feed.trusted))
    if n > 1 and nominal is None and not feed.measured:
        raise EndoctError(
            "the feed between the frames is not known",
            found="no feed_pitch_mm or positions_mm in the sidecar, and no two frames whose overlap could be matched",
            expected="either of them",
            remedy="add feed_pitch_mm to the sidecar",
        )
    if distrusted:
        fallback = "the nominal feed" if nominal is not None else "the median of the others"
        notes.append(
            f"{distrusted} of {n - 1} pairs of neighbouring frames could not be matched; "
            f"where the frames around them did not settle it, {fallback} was used."
        )
    z_mm = optics.rim_sign * feed.z_mm
    if nominal is not None and feed.measured:
        measured, expected = float(np.ptp(z_mm)), float(np.ptp(nominal))
        tolerance = max(DISAGREEMENT, 2 * parameters.feed_sigma / np.sqrt(n - 1))
        if abs(measured - expected) > tolerance * expected:
            notes.append(f"The frames span {measured:.2f} mm as measured and {expected:.2f} mm by the nominal feed.")
    if not parameters.correct_feed:
        if nominal is None:
            raise EndoctError(
                "frames cannot be placed by the nominal feed",
                found="no feed_pitch_mm or positions_mm in the sidecar, and correct_feed = false",
                remedy="add feed_pitch_mm to the sidecar, or leave correct_feed on",
            )
        z_mm = nominal
    z_mm = z_mm - z_mm.min()
    if not parameters.correct_roll:
        return z_mm, np.full(n, acquisition.theta_origin_rad)
    roll_rad = feed.roll_rad - feed.roll_rad[int(np.argmin(z_mm))] + acquisition.theta_origin_rad
    return z_mm, roll_rad


def doubt_of_feed(feed: Feed, nominal: Coordinates | None) -> str | None:
    """Return a sentence where neighbouring frames lie much farther apart, or nearer, than the nominal feed has them."""
    if nominal is None:
        return None
    measured_mm, stated_mm = (np.abs(np.diff(z_mm)) for z_mm in (feed.z_mm, nominal))
    known = feed.trusted[1:] & (measured_mm > 0) & (stated_mm > 0)
    if known.sum() < FEWEST_FOR_DRIFT:
        return None
    measured_mm, stated_mm = measured_mm[known], stated_mm[known]
    ratio = float(np.median(measured_mm / stated_mm))
    error = 1.25 * 1.48 * float(np.median(np.abs(measured_mm / stated_mm - ratio)) / np.sqrt(known.sum()))
    if abs(ratio - 1) <= max(DOUBTED_FEED, SURE_OF_FEED * error):
        return None
    return (
        f"Neighbouring frames lie {np.median(measured_mm):.3f} mm apart as measured and {np.median(stated_mm):.3f} mm "
        "by the nominal feed, in the median: the annulus, its visible length or that feed is wrong, and z with it."
    )
