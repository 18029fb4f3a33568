"""One pass over a recording: annulus, light, feed and roll, and from them where every frame lies on the wall."""

from typing import cast

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates
from endoct.base.compute.memory import Computed, Kept
from endoct.base.doubt import Doubt
from endoct.base.entry_points import OURS
from endoct.base.errors import EndoctError
from endoct.modalities.contract import FrameStream
from endoct.modalities.endoscope.calibration import EndoscopeCalibration, per_frame_values
from endoct.modalities.endoscope.doubts import doubts_of_overlay, doubts_of_ring, evidence_of_ring
from endoct.modalities.endoscope.flatfield import enough_frames, estimate_flat_field, even_strip, frame_exposure
from endoct.modalities.endoscope.frames import LogStrip, brightness_of_rows, examine_frames, place_frames
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.band import Band, Circles, recentred, stated_band
from endoct.modalities.endoscope.mirror.overlay import in_pixels_of_files
from endoct.modalities.endoscope.mirror.ring_search import find_reference
from endoct.modalities.endoscope.motion import by_method, measure_centring, measure_motion, nominal_mm
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.reading.numbering import notes_on_gaps
from endoct.stitching.grid import SurfaceGrid


def survey_frames(stream: FrameStream, parameters: EndoscopeParameters) -> EndoscopeCalibration:
    """Return the calibration of a recording, in one pass over its frames.

    Raises :class:`NotSeen` where no annulus is found, :class:`EndoctError` where no scale or no feed is known.
    """
    acquisition = cast(EndoscopeAcquisition, stream.acquisition)
    nominal = nominal_mm(stream, acquisition)
    reference = find_reference(stream, acquisition)
    stated, on_optics = stated_band(acquisition, reference)
    with Kept[LogStrip]() as strips:
        frames, on_annuli = examine_frames(stream, reference, stated, strips)
        some, views = _some(strips), _views(nominal, stated, len(strips))
        flat = estimate_flat_field(some, views, parameters.least_transmission)
        exposure = frame_exposure(strips, flat)
        rows = np.array([brightness_of_rows(strips[k]) for k in range(len(strips))]) - exposure[:, None]
        even = Computed(len(strips), lambda k: even_strip(strips[k], flat, exposure[k]))
        motion, on_motion = measure_motion(even, stated, nominal, acquisition, parameters)
        of_method: tuple[Doubt, ...] = ()
        if parameters.feed_method != OURS:
            motion, doubt = by_method(motion, parameters.feed_method, even, motion.band, nominal)
            of_method = (doubt,)
    band, annulus = motion.band, frames.annuli[0]
    centring = measure_centring(annulus, motion.feed, band, probe_offset=parameters.probe_offset)
    as_surveyed = Circles(annulus, np.divide(stated.r_px, reference.factor) * reference.factor)
    centred = recentred(some, as_surveyed, Circles(centring.applied(annulus), band.r_px))
    flat = estimate_flat_field(centred, views, parameters.least_transmission)
    places, on_places = place_frames(motion, centring, nominal, acquisition, parameters)
    overlay = None
    if reference.overlay is not None:
        height, width = stream[0].samples.shape[:2]
        overlay = in_pixels_of_files(reference.overlay, (height, width), reference.factor, annulus.pixels)
    grid, oversample = _grid(places.z_mm, band, parameters)
    return EndoscopeCalibration(
        grid=grid,
        row_z_mm=grid.z_mm,
        per_frame=per_frame_values(frames, motion, centring, places, exposure),
        notes=(*on_optics, *on_annuli, *on_motion, *on_places, *notes_on_gaps(acquisition.positions_mm)),
        handedness_known=True,
        travel_known=acquisition.travel != "unknown",
        annuli=frames.annuli,
        drift_px=centring.drift_px,
        shift_px=centring.shift_px,
        z_mm=places.z_mm,
        roll_rad=places.roll_rad,
        sway_rad=places.sway_rad,
        optics=band.optics,
        flat=flat.by_z(band.optics.rim_sign),
        exposure=exposure,
        strip_z_mm=band.outward_mm,
        full_scale=reference.full_scale,
        overlay=overlay,
        oversample=oversample,
        taper=parameters.taper,
        doubts=(
            *doubts_of_ring(evidence_of_ring(frames, reference, rows, motion.feed)),
            *doubts_of_overlay(overlay, reference),
            *of_method,
            *places.doubts,
        ),
    )


def _some(strips: Kept[LogStrip]) -> NDArray[np.float16]:
    """Return the strips that a flat field is estimated from, (n, n_rows, n_theta)."""
    return np.stack([strips[k] for k in enough_frames(len(strips))])


def _views(nominal: Coordinates | None, band: Band, n_frames: int) -> float:
    """Return the number of different pieces of wall, as large as a large cell, that passed a pixel of the probe."""
    if nominal is None:
        return n_frames / 5
    return float(np.ptp(nominal)) / (0.5 * band.optics.visible_length_mm) if n_frames > 2 else 0.0


def _grid(z_mm: Coordinates, band: Band, parameters: EndoscopeParameters) -> tuple[SurfaceGrid, tuple[int, int]]:
    """Return the panorama's grid, and how many samples a row and a column average so that no pixel is skipped."""
    optics, half_mm = band.optics, band.half_mm
    dz_mm = parameters.dz_mm or float(np.clip(round(optics.mm_per_px, 3), 0.02, 0.05))
    if dz_mm > 2 * half_mm:
        raise EndoctError(
            "rows of the panorama would lie farther apart than a frame reaches",
            found=f"dz_mm = {dz_mm:g}",
            expected=f"at most {2 * half_mm:.2f} mm",
        )
    around_px = np.pi * (optics.inner_px + optics.outer_px)
    n_theta = parameters.n_theta or (2048 if around_px > 700 else 1024)
    first = int(np.ceil((-half_mm) / dz_mm))
    last = int(np.floor((float(z_mm.max()) + half_mm) / dz_mm))
    grid = SurfaceGrid.full_circle(
        max(1, last - first + 1), n_theta, z0_mm=first * dz_mm, dz_mm=dz_mm, radius_mm=optics.bore_radius_mm
    )
    rows = int(np.clip(round(dz_mm / optics.mm_per_px), 1, 8))
    columns = int(np.clip(round(around_px / n_theta), 1, 8))
    return grid, (rows, columns)
