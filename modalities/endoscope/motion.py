"""How the probe moved and rolled from frame to frame, and what of its optics that motion reveals.

The rims are edges of the probe and need not lie on circles of constant z. But around a wrong centre, one side of
the wall seems to move farther than the other, by the centre's error over the annulus' width. With enough pairs of
frames that gives the centre better than the rims do.

How the centres drift with their radius then shows how far the probe is off the bore's axis. Let that axis be off
the probe's by e, and m = cot(2a − ψ) of the ray. The wall at image angle θ is then seen at z + m·e·cos(θ − φ) and
lies at θ + e/R·sin(θ − φ). So the circle of constant z at radius r is centred m·e/(dz/dr) away from the mirror's
axis, opposite to the bore's. A tilt of the probe moves all centres alike, as a mirror's edge that is not quite
round does. It is not distinguished from that, and not corrected.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.doubt import Doubt
from endoct.base.entry_points import answer_by
from endoct.base.errors import EndoctError
from endoct.base.numeric.ranks import error_of_median
from endoct.modalities.contract import FrameStream, inward_positions_mm
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.mirror.band import Band
from endoct.modalities.endoscope.mirror.optics import ConeOptics, scale_is_stated, stretched, turned
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.stitching.motion.feed import Feed, estimate_feed
from endoct.stitching.strip import Strip

FEWEST_PAIRS = 5
"""At least this many pairs of neighbouring frames must match. Fewer say nothing about the recording as a whole."""
SURE_STRETCH = 3.0
"""Another cone is assumed only where the feed is uneven by this many standard errors."""
LARGEST = 0.1
"""A larger offset, as a part of the bore's radius, is no probe off its axis but a drift that was measured wrongly."""
MOST_TILT = 0.2


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


def by_method(
    motion: Motion, name: str, textures: Sequence[Image], band: Band, nominal: Coordinates | None
) -> tuple[Motion, Doubt]:
    """Return ``motion`` with the feed and roll of the method ``name``, and the doubt which says that they are its own.

    The method gets what methods of `endoct bench stitching` get: the strips of even light, and the nominal pitch. What
    our own motion says of the optics stays, since a method does not measure it. ``textures`` are the logarithms of
    strips on the rows of ``band``. Raises :class:`EndoctError` without a nominal feed or such a method. It also
    does where the method fails, or does not answer a place and a roll of every strip.
    """
    if nominal is None:
        raise EndoctError(
            f"the stitching method '{name}' needs the nominal feed",
            found="neither feed_pitch_mm nor positions_mm in the sidecar",
            remedy="add feed_pitch_mm to the sidecar, or leave feed_method out",
        )
    pitch_mm = band.optics.rim_sign * float(np.median(np.diff(nominal))) if nominal.size > 1 else 0.0
    strips = [_strip(texture, band) for texture in textures]
    feed = _checked(answer_by("stitching", name, strips, pitch_mm, setting="feed_method"), motion.feed, name)
    apart_mm = float(np.abs((feed.z_mm - feed.z_mm.mean()) - (motion.feed.z_mm - motion.feed.z_mm.mean())).max())
    what = (
        f"Feed and roll are those of the method '{name}'; endoct does not judge how far they can be trusted. Its own "
        f"feed has frames up to {apart_mm:.2f} mm elsewhere."
    )
    return replace(motion, feed=feed), Doubt("feed-by-method", what, value=apart_mm, unit="mm", expected=0.0)


def _strip(texture: Image, band: Band) -> Strip:
    """Return a logarithm of even light as the strip that a method of the bench gets: z from the middle of its band."""
    valid, n_theta = np.isfinite(texture), texture.shape[1]
    return Strip(
        z_mm=band.outward_mm,
        theta_rad=2 * np.pi / n_theta * np.arange(n_theta),
        intensity=np.exp(np.where(valid, texture, np.float32(0))),
        depth_mm=None,
        valid=valid,
        weight=valid.astype(np.float32),
    )


def _checked(answer: object, ours: Feed, name: str) -> Feed:
    """Return ``ours`` with the places that a method answers. What it says nothing of is not known."""
    parts = [np.asarray(getattr(answer, part, None)) for part in ("z_mm", "roll_rad", "trusted")]
    z_mm, roll_rad, trusted = parts
    n = ours.z_mm.size
    numbers = z_mm.dtype.kind == roll_rad.dtype.kind == "f" and trusted.dtype == np.bool_
    if not numbers or any(part.shape != (n,) for part in parts) or not np.isfinite([z_mm, roll_rad]).all():
        raise EndoctError(
            f"the stitching method '{name}' answers no places",
            found=", ".join(f"{part.dtype} {part.shape}" for part in parts)[:200],
            expected=f"z_mm and roll_rad, finite, and trusted, bool, each ({n},)",
        )
    unknown = np.full(n, np.nan)
    return replace(
        ours,
        z_mm=z_mm.astype(np.float64),
        roll_rad=roll_rad.astype(np.float64),
        sway_rad=np.zeros((n, 2)),
        confidence=unknown,
        correlation=unknown,
        trusted=trusted | (np.arange(n) == 0),
        measured=bool(trusted[1:].any()),
    )


@dataclass(frozen=True)
class BoreAxis:
    """The bore's axis in the probe's frame, ``x_mm`` and ``y_mm`` along the image's columns and rows.

    ``shift_px`` (x, y): by how much the circle of constant z at the outer rim lies off that rim.
    """

    x_mm: float
    y_mm: float
    shift_px: tuple[float, float]

    def sway_rad(self, roll_rad: float, radius_mm: float) -> Coordinates:
        """Return by what θ of the wall differs from image angle + roll, as parts of cos and sin of their sum, (2,)."""
        cos, sin = np.cos(roll_rad), np.sin(roll_rad)
        x, y = self.x_mm * cos - self.y_mm * sin, self.x_mm * sin + self.y_mm * cos
        return np.array([-y, x]) / radius_mm


ON_AXIS = BoreAxis(0.0, 0.0, (0.0, 0.0))


def bore_axis(drift_px: tuple[float, float], annulus: Annulus, optics: ConeOptics, radius_mm: float) -> BoreAxis | None:
    """Return where the bore's axis lies by the drift of the centres from outer to inner rim, or None if unknown.

    It is not known where the drift would put it off by more than a tenth of the radius.
    """
    inner, outer = optics.centre_shift_px_per_mm(np.array([annulus.inner_px, annulus.outer_px]))
    x_mm, y_mm = (float(drift / (outer - inner)) for drift in drift_px)
    if np.hypot(x_mm, y_mm) > LARGEST * radius_mm:
        return None
    return BoreAxis(x_mm, y_mm, (float(-outer * x_mm), float(-outer * y_mm)))


def probe_offsets(axis: BoreAxis | None, sway_rad: Coordinates, radius_mm: float) -> dict[str, Coordinates]:
    """Return how far the probe was off the bore's axis, towards θ = 0 and θ = π/2; NaN where that is not known."""
    known = 1.0 if axis is not None else np.nan
    return {
        "probe_offset_x_mm": -known * radius_mm * sway_rad[:, 1],
        "probe_offset_y_mm": known * radius_mm * sway_rad[:, 0],
    }


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
