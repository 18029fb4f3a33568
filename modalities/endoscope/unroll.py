"""One frame as a strip of the wall: sampled on the panorama's rows and divided by the light of the probe."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Image, Mask, read_view
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Room
from endoct.modalities.contract import Frame
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.light import DARKEST, UNSEEN, green, least_saturated
from endoct.modalities.endoscope.mirror.band import Circles
from endoct.stitching.strip import Strip

LEAST_WEIGHT = 1e-3
_ROOM = Room()


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
    columns, rows = Circles(annulus, c.optics.r_px(fine_z)).pixel_map(fine_angle, _ROOM)

    image = _brightness(frame, c.full_scale)
    if c.overlay is not None:
        image[c.overlay] = UNSEEN
    flat_rows = (fine_z - c.strip_z_mm[0]) / (c.strip_z_mm[1] - c.strip_z_mm[0])
    flat_columns = fine_angle / (2 * np.pi) * c.flat.log_light.shape[1]
    shape = z_mm.size, theta_rad.size
    light = _sampled(image, columns, rows)
    on_bone = c.flat.transmission(flat_rows, flat_columns, _ROOM)
    intensity, good = np.empty(shape, np.float32), np.empty(shape, np.bool_)
    _average(light, on_bone, np.exp(c.exposure[frame.index]), intensity, good)

    return Strip(
        z_mm=z_mm,
        theta_rad=theta_rad,
        intensity=intensity,
        depth_mm=None,
        valid=good,
        weight=np.broadcast_to(_row_weight(c, z_mm - centre_mm, half_mm)[:, None], shape),
        diagnostics={"valid_fraction": float(good.mean())},
    )


def _brightness(frame: Frame, full_scale: float) -> Image:
    """Return a frame's brightness, far above 1 where it is saturated."""
    samples = read_view(np.ascontiguousarray(green(frame.samples)))
    image = _ROOM.array("image", samples.shape)
    _write_seen(samples, np.float32(full_scale), least_saturated(samples.dtype, full_scale), image)
    return image


def _sampled(image: Image, columns: Image, rows: Image) -> Image:
    """Return a frame's brightness at fractional places; far above 1 where a pixel of it is saturated or outside."""
    sampled = _ROOM.array("sampled", columns.shape)
    cv2.remap(image, columns, rows, cv2.INTER_LINEAR, sampled, borderMode=cv2.BORDER_CONSTANT, borderValue=UNSEEN)
    return sampled


@compiled
def _write_seen(samples: NDArray[Any], full_scale: np.float32, least: float, image: Image) -> None:
    """Write the brightness of pixels, and :data:`UNSEEN` from ``least`` on."""
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            brightness = np.float32(samples[i, j]) / full_scale
            image[i, j] = brightness if samples[i, j] < least else np.float32(UNSEEN)


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


@compiled
def _average(light: Image, on_bone: Image, exposure: float, intensity: Image, observed: Mask) -> None:
    """Write the means of ``light`` over its share ``on_bone``, of equal blocks, and where all of a block is seen."""
    by_row, by_column = light.shape[0] // intensity.shape[0], light.shape[1] // intensity.shape[1]
    per_sample = 1 / (exposure * by_row * by_column)
    total = np.empty(light.shape[1], np.float32)
    for i in range(intensity.shape[0]):
        total[:] = 0
        for k in range(i * by_row, (i + 1) * by_row):
            bright, share = light[k], on_bone[k]
            for j in range(total.size):
                ratio = max(bright[j], np.float32(DARKEST)) / share[j]
                total[j] += ratio if bright[j] <= 1 else np.float32(np.nan)
        for j in range(intensity.shape[1]):
            of_block = total[j * by_column : (j + 1) * by_column].sum()
            observed[i, j] = of_block == of_block  # not NaN
            intensity[i, j] = of_block * per_sample if observed[i, j] else 0.0
