"""One pass over a recording: annulus, light, feed and roll, and from them where every frame lies on the wall."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.endoscope.annulus import Annulus, Followed, find_annulus, follow, settle_annuli
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.flatfield import FlatField, enough_frames, estimate_flat_field, frame_exposure
from endoct.modalities.endoscope.light import brightness, full_scale, log_light, reduced, saturated
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.offset import ON_AXIS, bore_axis, probe_offsets
from endoct.modalities.endoscope.optics import ConeOptics, assumed_cone, scale_is_stated, stated_optics
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.places import (
    centre_drift_px,
    doubt_of_feed,
    measured_feed,
    nominal_mm,
    optics_with_rim,
    placed,
    scale_by_feed,
    self_calibrated,
)
from endoct.modalities.endoscope.unroll import pixel_map, recentred, sample
from endoct.modalities.numbering import notes_on_gaps
from endoct.stitching.arrays import Coordinates, Mask
from endoct.stitching.circle import turned_harmonic
from endoct.stitching.errors import EndoctError
from endoct.stitching.feed import Feed
from endoct.stitching.grid import SurfaceGrid
from endoct.stitching.kept import Kept
from endoct.stitching.parallel import thread_map

SURVEY_SIDE_PX = 480
REFERENCE_FRAMES = 12
STRIP_COLUMNS = 1024
MOST_ROWS = 96
RIM_PX = 2.0


@dataclass(frozen=True, eq=False)
class _Glimpse:
    """What the survey keeps of one frame, beside its strip."""

    followed: Followed
    saturated_fraction: float


@dataclass(frozen=True, eq=False)
class _Look:
    """How the survey looks at a frame: frozen before the pass, so that the order of the frames is no matter."""

    scale: float
    factor: int
    annulus: Annulus
    r_px: Coordinates

    def __call__(self, frame: Frame) -> tuple[_Glimpse, NDArray[np.float16]]:
        image = reduced(brightness(frame.samples, self.scale), self.factor)
        followed = follow(image, self.annulus)
        place = settle_annuli([followed], self.annulus, given=True)[0][0]
        angle = np.linspace(0, 2 * np.pi, STRIP_COLUMNS, endpoint=False)
        columns, rows = pixel_map(place, self.r_px, angle)
        strip, inside = sample(image, columns, rows)
        logs = np.where(inside, log_light(strip), np.nan).astype(np.float16)
        clipped = reduced(saturated(frame.samples, self.scale).astype(np.float32), self.factor)
        fraction = float(sample(clipped, columns, rows)[0][inside].mean()) if inside.any() else 0.0
        return _Glimpse(followed, fraction), logs


def survey(stream: FrameStream, parameters: EndoscopeParameters) -> EndoscopeCalibration:
    """Return the calibration of a recording. Raises :class:`EndoctError` where no annulus or no scale is known."""
    with Kept[NDArray[np.float16]]() as logs:
        return _surveyed(stream, parameters, logs)


def _surveyed(
    stream: FrameStream, parameters: EndoscopeParameters, logs: Kept[NDArray[np.float16]]
) -> EndoscopeCalibration:
    """Return the calibration of a recording, whose frames' strips in logarithms are put into ``logs``."""
    acquisition = stream.acquisition
    if not isinstance(acquisition, EndoscopeAcquisition):
        raise EndoctError("the sidecar is not an endoscope's", found=type(acquisition).__name__)
    notes: list[str] = []
    scale, factor, reference = _reference(stream, acquisition)
    annulus = reference.scaled(factor)
    optics = stated_optics(acquisition, annulus.inner_px, annulus.outer_px, notes)
    margin_mm = RIM_PX * max(1, factor) * optics.mm_per_px
    half_mm = optics.visible_length_mm / 2 - margin_mm
    if half_mm <= 0:
        raise EndoctError(
            "the annulus is too narrow to be unrolled",
            found=f"{factor * (annulus.outer_px - annulus.inner_px):.0f} px from its inner to its outer rim",
            expected=f"more than {2 * RIM_PX * max(1, factor):.0f} px",
            remedy="check 'annulus' in the sidecar",
        )
    n_rows = int(np.clip(round((annulus.outer_px - annulus.inner_px) / factor), 8, MOST_ROWS))
    outward_mm = np.linspace(-half_mm, half_mm, n_rows)
    look = _Look(scale, factor, reference, np.divide(optics.r_px(optics.rim_sign * outward_mm), factor))
    glimpses = []
    for glimpse, strip in thread_map(look, stream):
        glimpses.append(glimpse)
        logs.append(strip)

    annuli, found = settle_annuli([g.followed for g in glimpses], reference, given=True)
    if not found.all():
        notes.append(
            f"The annulus could not be measured in {np.sum(~found)} of {len(found)} frames; "
            "its place there is that of the frames around."
        )
    some = np.stack([logs[k] for k in enough_frames(len(logs))])
    nominal = nominal_mm(stream, acquisition)
    views = _views(nominal, optics.visible_length_mm, len(logs))
    flat = estimate_flat_field(some, views, parameters.least_transmission)
    exposure = frame_exposure(logs, flat)
    if not scale_is_stated(acquisition):
        guessed = measured_feed(logs, flat, exposure, outward_mm, None, acquisition, optics, parameters)
        ratio = scale_by_feed(guessed, nominal, optics.visible_length_mm, notes)
        half_mm, outward_mm = half_mm * ratio, outward_mm * ratio
        optics = assumed_cone(
            optics.inner_px, optics.outer_px, ratio * optics.visible_length_mm, optics.bore_radius_mm, optics.rim_sign
        )
    feed = measured_feed(logs, flat, exposure, outward_mm, nominal, acquisition, optics, parameters)
    if parameters.self_calibration:
        optics = self_calibrated(optics, feed, notes)
    settled = tuple(a.scaled(factor) for a in annuli)
    drift_px = centre_drift_px(settled[0], feed)
    radius_mm = acquisition.bore_diameter_mm / 2
    axis = bore_axis(drift_px, settled[0], optics, radius_mm) if parameters.probe_offset else None
    shift_px = (axis or ON_AXIS).shift_px
    centred = settled[0].with_drift(*drift_px).moved(*shift_px)
    some = recentred(some, (settled[0], look.r_px * factor), (centred, optics.r_px(optics.rim_sign * outward_mm)))
    flat = estimate_flat_field(some, views, parameters.least_transmission)
    optics = optics_with_rim(optics, acquisition, feed, notes)
    doubts = () if (doubt := doubt_of_feed(feed, nominal)) is None else (doubt,)
    z_mm, roll_rad = placed(feed, optics, nominal, acquisition, parameters, notes)
    sway_rad = turned_harmonic(feed.sway_rad, float(roll_rad[0] - feed.roll_rad[0]))
    if axis is not None:
        sway_rad = sway_rad + axis.sway_rad(float(np.median(roll_rad)), radius_mm)

    if optics.rim_sign < 0:
        flat = FlatField(flat.log_light[::-1], flat.pattern[::-1], flat.usable[::-1])
    grid, oversample = _grid(z_mm, half_mm, optics, annulus, acquisition, parameters)
    return EndoscopeCalibration(
        grid=grid,
        row_z_mm=grid.z_mm,
        per_frame={
            "view_slant": np.full(z_mm.size, float(optics.slant(optics.r_px(outward_mm)).mean())),
            **_per_frame(z_mm, roll_rad, settled, found, feed, exposure, glimpses),
            **probe_offsets(axis, sway_rad, radius_mm),
        },
        notes=(*notes, *doubts, *notes_on_gaps(acquisition.positions_mm)),
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
        doubts=doubts,
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


def _views(nominal: Coordinates | None, visible_mm: float, n: int) -> float:
    """Return how many different pieces of wall, the size of a large cell, a pixel of the probe has seen."""
    if nominal is None:
        return n / 5
    return float(np.ptp(nominal)) / (0.5 * visible_mm) if n > 2 else 0.0


def _grid(
    z_mm: Coordinates,
    half_mm: float,
    optics: ConeOptics,
    annulus: Annulus,
    acquisition: EndoscopeAcquisition,
    parameters: EndoscopeParameters,
) -> tuple[SurfaceGrid, tuple[int, int]]:
    """Return the panorama's grid, and how many samples a row and a column average so that no pixel is skipped."""
    dz_mm = parameters.dz_mm or float(np.clip(round(optics.mm_per_px, 3), 0.02, 0.05))
    if dz_mm > 2 * half_mm:
        raise EndoctError(
            "rows of the panorama would lie farther apart than a frame reaches",
            found=f"dz_mm = {dz_mm:g}",
            expected=f"at most {2 * half_mm:.2f} mm",
        )
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
        "feed_mm": np.concatenate([[np.nan], np.diff(z_mm)]),
        "pair_correlation": feed.correlation,
        "pair_confidence": feed.confidence,
        "pair_trusted": feed.trusted,
        "exposure": np.exp(exposure),
        "saturated_fraction": np.array([g.saturated_fraction for g in glimpses]),
    }
