"""One pass over a recording: annulus, light, feed and roll, and from them where every frame lies on the wall."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.modalities.contract import Frame, FrameStream, inward_positions_mm
from endoct.modalities.endoscope.annulus import Annulus, Followed, find_annulus, follow, settle_annuli
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.flatfield import FlatField, estimate_flat_field, frame_exposure
from endoct.modalities.endoscope.light import brightness, full_scale, log_light, reduced, saturated
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.offset import ON_AXIS, bore_axis, probe_offsets
from endoct.modalities.endoscope.optics import DISAGREEMENT, Optics, stated_optics, turned
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.unroll import pixel_map, sample
from endoct.modalities.numbering import notes_on_gaps
from endoct.modalities.recording import map_frames
from endoct.stitching.arrays import Coordinates, Mask
from endoct.stitching.errors import EndoctError
from endoct.stitching.feed import Feed, estimate_feed
from endoct.stitching.grid import SurfaceGrid

SURVEY_SIDE_PX = 480
REFERENCE_FRAMES = 12
STRIP_COLUMNS = 1024
FEED_COLUMNS = 512
MOST_ROWS = 96
FEWEST_FOR_DRIFT = 5
MOST_TILT = 0.2
RIM_PX = 2.0
CLIP = (-0.3, 0.3)


@dataclass(frozen=True, eq=False)
class _Glimpse:
    """What the survey keeps of one frame."""

    followed: Followed
    strip: NDArray[np.float16]
    saturated_fraction: float


@dataclass(frozen=True, eq=False)
class _Look:
    """How the survey looks at a frame: frozen before the pass, so that the order of the frames is no matter."""

    scale: float
    factor: int
    annulus: Annulus
    r_px: Coordinates

    def __call__(self, frame: Frame) -> _Glimpse:
        image = reduced(brightness(frame.samples, self.scale), self.factor)
        followed = follow(image, self.annulus)
        place = settle_annuli([followed], self.annulus, given=True)[0][0]
        angle = np.linspace(0, 2 * np.pi, STRIP_COLUMNS, endpoint=False)
        columns, rows = pixel_map(place, self.r_px, angle)
        strip, inside = sample(image, columns, rows)
        logs = np.where(inside, log_light(strip), np.nan).astype(np.float16)
        clipped = reduced(saturated(frame.samples, self.scale).astype(np.float32), self.factor)
        return _Glimpse(
            followed, logs, float(sample(clipped, columns, rows)[0][inside].mean()) if inside.any() else 0.0
        )


def survey(stream: FrameStream, parameters: EndoscopeParameters) -> EndoscopeCalibration:
    """Return the calibration of a recording. Raises :class:`EndoctError` where no annulus or no scale is known."""
    acquisition = stream.acquisition
    if not isinstance(acquisition, EndoscopeAcquisition):
        raise EndoctError("the sidecar is not an endoscope's", found=type(acquisition).__name__)
    notes: list[str] = []
    scale, factor, reference = _reference(stream, acquisition)
    annulus = reference.scaled(factor)
    optics = stated_optics(acquisition, annulus.inner_px, annulus.outer_px, notes)
    margin_mm = RIM_PX * max(1, factor) * optics.mm_per_px
    half_mm = optics.visible_length_mm / 2 - margin_mm
    n_rows = int(np.clip(round((annulus.outer_px - annulus.inner_px) / factor), 8, MOST_ROWS))
    outward_mm = np.linspace(-half_mm, half_mm, n_rows)
    look = _Look(scale, factor, reference, np.divide(optics.r_px(optics.rim_sign * outward_mm), factor))
    glimpses = list(map_frames(look, stream))

    annuli, found = settle_annuli([g.followed for g in glimpses], reference, given=True)
    if not found.all():
        notes.append(
            f"The annulus could not be measured in {np.sum(~found)} of {len(found)} frames; "
            "its place there is that of the frames around."
        )
    logs = np.stack([g.strip for g in glimpses])
    nominal = _nominal_mm(stream, acquisition)
    views = _views(nominal, optics.visible_length_mm, len(logs))
    flat = estimate_flat_field(logs, views, parameters.least_transmission)
    exposure = frame_exposure(logs, flat)
    feed = _feed(logs, flat, exposure, outward_mm, nominal, acquisition, optics, parameters)
    settled = tuple(a.scaled(factor) for a in annuli)
    drift_px = _drift(settled[0], feed)
    radius_mm = acquisition.bore_diameter_mm / 2
    axis = bore_axis(drift_px, settled[0], optics, radius_mm) if parameters.probe_offset else None
    shift_px = (axis or ON_AXIS).shift_px
    centred = settled[0].with_drift(*drift_px).moved(*shift_px)
    logs = _recentred(logs, settled[0], centred, look.r_px * factor)
    flat = estimate_flat_field(logs, views, parameters.least_transmission)
    optics = _rim(optics, acquisition, feed, notes)
    z_mm, roll_rad = _places(feed, optics, nominal, acquisition, parameters, notes)
    sway_rad = _turned(feed.sway_rad, float(roll_rad[0] - feed.roll_rad[0]))
    if axis is not None:
        sway_rad = sway_rad + axis.sway_rad(float(np.median(roll_rad)), radius_mm)

    if optics.rim_sign < 0:
        flat = FlatField(flat.log_light[::-1], flat.pattern[::-1], flat.usable[::-1])
    grid, oversample = _grid(z_mm, half_mm, optics, annulus, acquisition, parameters)
    return EndoscopeCalibration(
        grid=grid,
        row_z_mm=grid.z_mm,
        per_frame={
            **_per_frame(z_mm, roll_rad, settled, found, feed, exposure, glimpses),
            **probe_offsets(axis, sway_rad, radius_mm),
        },
        notes=(*notes, *notes_on_gaps(acquisition.positions_mm)),
        handedness_known=True,
        travel_known=acquisition.travel != "unknown",
        annuli=settled,
        drift_px=drift_px,
        shift_px=shift_px,
        z_mm=z_mm,
        roll_rad=roll_rad,
        sway_rad=sway_rad,
        optics=optics,
        flat=flat,
        exposure=exposure,
        strip_z_mm=outward_mm,
        full_scale=scale,
        oversample=oversample,
        taper=parameters.taper,
    )


def _reference(stream: FrameStream, acquisition: EndoscopeAcquisition) -> tuple[float, int, Annulus]:
    """Return full scale, the survey's reduction and the annulus in reduced pixels, from frames spread over all."""
    chosen = np.unique(np.linspace(0, len(stream) - 1, min(len(stream), REFERENCE_FRAMES)).round().astype(int))
    frames = [stream[int(k)].samples for k in chosen]
    scale = max(full_scale(samples) for samples in frames)
    factor = max(1, min(frames[0].shape[:2]) // SURVEY_SIDE_PX)
    images = [reduced(brightness(samples, scale), factor) for samples in frames]
    given = acquisition.annulus
    if given is not None:
        near = Annulus(given.x, given.y, given.inner_px, given.x, given.y, given.outer_px).scaled(1 / factor)
    else:
        near = find_annulus(np.mean(images, axis=0, dtype=np.float32))
    annuli, _ = settle_annuli([follow(image, near) for image in images], near, given is not None)
    x, y = np.median([(a.outer_x_px, a.outer_y_px) for a in annuli], axis=0)
    return scale, factor, annuli[0].moved(float(x) - annuli[0].outer_x_px, float(y) - annuli[0].outer_y_px)


def _nominal_mm(stream: FrameStream, acquisition: EndoscopeAcquisition) -> Coordinates | None:
    """Return the nominal z of every frame (n,), or None where the sidecar does not say."""
    if acquisition.positions_mm is None and acquisition.pitch_mm is None:
        return None
    return inward_positions_mm(
        len(stream),
        pitch_mm=acquisition.pitch_mm or 0.0,
        travel=acquisition.travel,
        positions_mm=acquisition.positions_mm,
    )


def _views(nominal: Coordinates | None, visible_mm: float, n: int) -> float:
    """Return how many different pieces of wall, the size of a large cell, a pixel of the probe has seen."""
    if nominal is None:
        return n / 5
    return float(np.ptp(nominal)) / (0.5 * visible_mm) if n > 2 else 0.0


def _feed(
    logs: NDArray[np.float16],
    flat: FlatField,
    exposure: Coordinates,
    outward_mm: Coordinates,
    nominal: Coordinates | None,
    acquisition: EndoscopeAcquisition,
    optics: Optics,
    parameters: EndoscopeParameters,
) -> Feed:
    """Return feed in mm outward in the image (multiply by the rim's sign for z) and roll, from reduced strips."""
    n, n_rows, _ = logs.shape
    textures = np.empty((n, n_rows, FEED_COLUMNS), np.float32)
    for k in range(n):
        texture = np.clip(logs[k].astype(np.float32) - flat.log_light - np.float32(exposure[k]), CLIP[0], CLIP[1])
        texture[~flat.usable] = np.nan
        textures[k] = texture.reshape(n_rows, FEED_COLUMNS, -1).mean(axis=2)
    return estimate_feed(
        textures,
        float(outward_mm[1] - outward_mm[0]),
        acquisition.bore_diameter_mm / 2,
        None if nominal is None else optics.rim_sign * nominal,
        relative_sigma=parameters.feed_sigma,
    )


def _rim(optics: Optics, acquisition: EndoscopeAcquisition, feed: Feed, notes: list[str]) -> Optics:
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


def _drift(annulus: Annulus, feed: Feed) -> tuple[float, float]:
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


def _recentred(logs: NDArray[np.float16], old: Annulus, new: Annulus, r_px: Coordinates) -> NDArray[np.float16]:
    """Return strips of circles around the centres of ``old`` as strips of circles around those of ``new``.

    ``r_px`` (n_rows,) are the circles' radii, evenly spaced or nearly so; NaN where a circle leaves the strip.
    """
    angle = np.linspace(0, 2 * np.pi, STRIP_COLUMNS, endpoint=False)
    (x, y), (old_x, old_y) = new.centre_at(r_px), old.centre_at(r_px)
    dx, dy = (x - old_x)[:, None], (y - old_y)[:, None]
    outward = dx * np.cos(angle) + dy * np.sin(angle)
    around = (dy * np.cos(angle) - dx * np.sin(angle)) / r_px[:, None]
    step = np.gradient(r_px)[:, None]
    rows = (np.arange(r_px.size)[:, None] + outward / step).astype(np.float32)
    columns = np.mod(np.arange(STRIP_COLUMNS) + around / angle[1], STRIP_COLUMNS).astype(np.float32)
    outside = (rows < 0) | (rows > r_px.size - 1)
    moved = np.empty_like(logs)
    for k, strip in enumerate(logs):
        whole = np.concatenate([strip, strip[:, :1]], axis=1).astype(np.float32)
        samples = cv2.remap(whole, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        moved[k] = np.where(outside, np.nan, samples)
    return moved


def _turned(harmonic: Coordinates, by_rad: float) -> Coordinates:
    """Return parts of (cos θ, sin θ), (n, 2), as parts of those of θ + ``by_rad``."""
    cos, sin = np.cos(by_rad), np.sin(by_rad)
    return np.stack([harmonic[:, 0] * cos - harmonic[:, 1] * sin, harmonic[:, 0] * sin + harmonic[:, 1] * cos], axis=1)


def _places(
    feed: Feed,
    optics: Optics,
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
    z_mm = z_mm - z_mm.min()
    roll_rad = feed.roll_rad - feed.roll_rad[int(np.argmin(z_mm))] + acquisition.theta_origin_rad
    return z_mm, roll_rad


def _grid(
    z_mm: Coordinates,
    half_mm: float,
    optics: Optics,
    annulus: Annulus,
    acquisition: EndoscopeAcquisition,
    parameters: EndoscopeParameters,
) -> tuple[SurfaceGrid, tuple[int, int]]:
    """Return the panorama's grid, and how many samples a row and a column average so that no pixel is skipped."""
    dz_mm = parameters.dz_mm or float(np.clip(round(optics.mm_per_px, 3), 0.02, 0.05))
    around_px = np.pi * (annulus.inner_px + annulus.outer_px)
    n_theta = parameters.n_theta or (2048 if around_px > 700 else 1024)
    first = int(np.ceil((-half_mm) / dz_mm))
    last = int(np.floor((float(z_mm.max()) + half_mm) / dz_mm))
    grid = SurfaceGrid.full_circle(
        max(1, last - first + 1),
        n_theta,
        z0_mm=first * dz_mm,
        dz_mm=dz_mm,
        radius_mm=acquisition.bore_diameter_mm / 2,
    )
    rows = int(np.clip(round(dz_mm / optics.mm_per_px), 1, 8))
    columns = int(np.clip(round(around_px / n_theta), 1, 8))
    return grid, (rows, columns)


def _per_frame(
    z_mm: Coordinates,
    roll_rad: Coordinates,
    annuli: tuple[Annulus, ...],
    found: Mask,
    feed: Feed,
    exposure: Coordinates,
    glimpses: list[_Glimpse],
) -> dict[str, NDArray[Any]]:
    return {
        "z_mm": z_mm,
        "roll_rad": np.mod(roll_rad, 2 * np.pi),
        "annulus_x_px": np.array([a.outer_x_px for a in annuli]),
        "annulus_y_px": np.array([a.outer_y_px for a in annuli]),
        "annulus_inner_px": np.array([a.inner_px for a in annuli]),
        "annulus_outer_px": np.array([a.outer_px for a in annuli]),
        "annulus_inner_x_px": np.array([a.inner_x_px for a in annuli]),
        "annulus_inner_y_px": np.array([a.inner_y_px for a in annuli]),
        "annulus_found": found,
        "feed_mm": np.concatenate([[0.0], np.diff(z_mm)]),
        "pair_correlation": feed.correlation,
        "pair_confidence": feed.confidence,
        "pair_trusted": feed.trusted,
        "exposure": np.exp(exposure),
        "saturated_fraction": np.array([g.saturated_fraction for g in glimpses]),
    }
