"""How the probe moved and rolled from frame to frame, and what of its optics that motion reveals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from endoct.modalities.contract import FrameStream, inward_positions_mm
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.band import Band
from endoct.modalities.endoscope.mirror.optics import ConeOptics, scale_is_stated, stretched, turned
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.stitching.arrays import Coordinates, Image
from endoct.stitching.errors import EndoctError
from endoct.stitching.feed import Feed, estimate_feed
from endoct.stitching.robust import error_of_median

FEWEST_PAIRS = 5
"""Of neighbouring frames that could be matched: fewer say nothing about the recording as a whole."""
SURE_STRETCH = 3.0
"""Standard errors that the feed must be uneven by before another cone is assumed."""


@dataclass(frozen=True, eq=False)
class Motion:
    """``feed`` in mm outward in the image (multiply by the rim's sign for z) and roll; the ``band`` it fits."""

    feed: Feed
    band: Band


def nominal_mm(stream: FrameStream, acquisition: EndoscopeAcquisition) -> Coordinates | None:
    """Return the nominal z of every frame (n,), or None where the sidecar does not give it."""
    if acquisition.positions_mm is None and acquisition.pitch_mm is None:
        return None
    return inward_positions_mm(
        len(stream),
        pitch_mm=acquisition.pitch_mm or 0.0,
        travel=acquisition.travel,
        positions_mm=acquisition.positions_mm,
    )


def measure_motion(
    textures: Sequence[Image],
    band: Band,
    nominal: Coordinates | None,
    acquisition: EndoscopeAcquisition,
    parameters: EndoscopeParameters,
) -> tuple[Motion, tuple[str, ...]]:
    """Return the motion between strips of even light, on the rows of ``band``, and notes on it.

    Raises :class:`EndoctError` where nothing says how long the band is.
    """
    notes: tuple[str, ...] = ()
    if not scale_is_stated(acquisition):
        ratio, on_scale = scale_by_feed(_feed(textures, band, None, parameters), nominal, band.optics.visible_length_mm)
        band, notes = band.rescaled(ratio), (on_scale,)
    feed = _feed(textures, band, nominal, parameters)
    optics = band.optics
    if parameters.self_calibration:
        optics, on_cone = self_calibrated(optics, feed)
        notes += on_cone
    optics, on_rim = optics_with_rim(optics, acquisition, feed)
    return Motion(feed, replace(band, optics=optics)), notes + on_rim


def _feed(textures: Sequence[Image], band: Band, nominal: Coordinates | None, parameters: EndoscopeParameters) -> Feed:
    return estimate_feed(
        textures,
        band.row_mm,
        band.optics.bore_radius_mm,
        None if nominal is None else band.optics.rim_sign * nominal,
        relative_sigma=parameters.feed_sigma,
    )


def scale_by_feed(feed: Feed, nominal: Coordinates | None, visible_length_mm: float) -> tuple[float, str]:
    """Return by how much a guessed ``visible_length_mm`` is too small, from the ``feed`` measured with it, and a note.

    Raises :class:`EndoctError` where too few frames could be matched for that.
    """
    known = feed.trusted[1:] & (np.abs(np.diff(feed.z_mm)) > 0)
    if nominal is None or known.sum() < FEWEST_PAIRS:
        raise EndoctError(
            "the scale along the bore is not known",
            found=f"no visible_length_mm in the sidecar, and {int(known.sum())} pairs of frames to measure it by",
            expected=f"either it or {FEWEST_PAIRS} pairs of neighbouring frames that overlap and could be matched",
            remedy="add visible_length_mm: put a scale into a bore of that diameter and read off what the ring shows",
        )
    larger = np.abs(np.diff(nominal))[known] / np.abs(np.diff(feed.z_mm))[known]
    ratio = float(np.median(larger))
    error = error_of_median(larger - ratio) / ratio
    return ratio, (
        f"The sidecar does not give visible_length_mm; by the nominal feed it is {ratio * visible_length_mm:.3f} mm "
        f"(± {error:.1%}, if the nominal feed is right on average)."
    )


def self_calibrated(optics: ConeOptics, feed: Feed) -> tuple[ConeOptics, tuple[str, ...]]:
    """Return optics that were only assumed with the cone by which the feed is even all over the annulus."""
    stretch, error = feed.stretch
    if not optics.assumed or abs(stretch) < SURE_STRETCH * error:
        return optics, ()
    fitted = stretched(optics, stretch)
    return fitted, (
        "The sidecar does not give the mirror's optics; a half angle of "
        f"{np.rad2deg(fitted.half_angle_rad):.1f}° fits how the wall moves through the annulus, and was used.",
    )


def optics_with_rim(
    optics: ConeOptics, acquisition: EndoscopeAcquisition, feed: Feed
) -> tuple[ConeOptics, tuple[str, ...]]:
    """Return the optics with the rim's direction by the measured feed, where the sidecar does not give it."""
    if feed.direction > 0 or acquisition.travel == "unknown":
        return optics, ()
    if acquisition.outer_rim is None:
        return turned(optics), (
            "The sidecar does not say which way the outer rim looks; by the way the frames move it looks behind, "
            "and that was used.",
        )
    return optics, (
        f"The frames move against the sidecar's travel '{acquisition.travel}' with the outer rim "
        f"'{acquisition.outer_rim}'; one of the two is wrong, and the rim was believed.",
    )
