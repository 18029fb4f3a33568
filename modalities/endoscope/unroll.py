"""One frame as a strip of the wall: sampled on the panorama's rows and divided by the light of the probe."""

import numpy as np

from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.light import brightness, log_light, saturated
from endoct.modalities.endoscope.mirror.resampling import Circles, means, sample, sample_cyclic, sample_mask
from endoct.stitching.arrays import Coordinates
from endoct.stitching.strip import Strip

LEAST_WEIGHT = 1e-3


def unroll_frame(frame: Frame, calibration: EndoscopeCalibration) -> Strip:
    """Return ``frame`` on those of the panorama's rows that it shows."""
    c = calibration
    half_mm = float(c.strip_z_mm[-1])
    centre_mm = float(c.z_mm[frame.index])
    first, last = np.searchsorted(c.row_z_mm, [centre_mm - half_mm, centre_mm + half_mm])
    z_mm = c.row_z_mm[first : max(last, first + 1)]
    theta_rad = c.grid.theta_rad
    by_row, by_column = c.oversample
    fine_z = _subdivided(z_mm - centre_mm, c.grid.dz_mm, by_row)
    fine_angle = c.image_angle(frame.index, _subdivided(theta_rad, c.grid.dtheta_rad, by_column))
    annulus = c.annuli[frame.index].with_drift(*c.drift_px).moved(*c.shift_px)
    columns, rows = Circles(annulus, c.optics.r_px(fine_z)).pixel_map(fine_angle)

    light, inside = sample(brightness(frame.samples, c.full_scale), columns, rows)
    clipped = sample_mask(saturated(frame.samples, c.full_scale), columns, rows)
    flat_rows = (fine_z - c.strip_z_mm[0]) / (c.strip_z_mm[1] - c.strip_z_mm[0])
    flat_columns = fine_angle / (2 * np.pi) * c.flat.log_light.shape[1]
    flat = sample_cyclic(c.flat.log_light, flat_rows, flat_columns)
    clean = sample_cyclic(c.flat.usable.astype(np.float32), flat_rows, flat_columns) > 0.5
    shape = z_mm.size, theta_rad.size
    good = means((inside & ~clipped & clean).astype(np.float32), *shape) > 0.99
    intensity = means(np.exp(log_light(light) - flat - np.float32(c.exposure[frame.index])), *shape)

    return Strip(
        z_mm=z_mm,
        theta_rad=theta_rad,
        intensity=np.where(good, intensity, 0.0),
        depth_mm=None,
        valid=good,
        weight=np.broadcast_to(_row_weight(c, z_mm - centre_mm, half_mm)[:, None], shape),
        diagnostics={"valid_fraction": float(good.mean())},
    )


def _subdivided(centres: Coordinates, step: float, parts: int) -> Coordinates:
    """Return the centres of ``parts`` equal parts of every cell."""
    within = (np.arange(parts) + 0.5) / parts - 0.5
    return np.asarray((centres[:, None] + step * within).ravel())


def _row_weight(calibration: EndoscopeCalibration, from_centre_mm: Coordinates, half_mm: float) -> Coordinates:
    """Return each row's weight: more pixels lie on a larger circle, and strips fade into each other."""
    r_px = calibration.optics.r_px(from_centre_mm)
    to_edge = np.clip((half_mm - np.abs(from_centre_mm)) / (2 * half_mm * calibration.taper), 0, 1)
    fade = np.sin(np.pi / 2 * to_edge) ** 2
    return np.asarray(r_px / calibration.optics.r_px(np.zeros(1)) * np.maximum(fade, LEAST_WEIGHT))
