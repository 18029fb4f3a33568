"""The endoscope plug-in with the methods that the contract requires, and its pictures of a frame.

Pictures show where places of the wall are seen: the pixel that looks at a place says where it is.
Every other step has a module of its own.
"""

from contextlib import AbstractContextManager
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, Mask
from endoct.modalities.contract import Frame, FrameStream, LocatingModality, Picture, Places
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.frame_stream import open_frames, sniff_frames
from endoct.modalities.endoscope.light import green_frames
from endoct.modalities.endoscope.mirror.annulus import Annulus
from endoct.modalities.endoscope.parallax.depth import add_parallax
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.survey import survey_frames
from endoct.modalities.endoscope.tube_calibration import calibrate_endoscope
from endoct.modalities.endoscope.unroll import unroll_frame
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip

PICTURE_SIDE_PX = 900
PICTURE_COLUMNS = 1000


def picture_frame(frame: Frame, calibration: EndoscopeCalibration) -> tuple[Picture, ...]:
    """Return the frame as recorded, with its annulus, and the strip it unrolls to."""
    height, width = frame.samples.shape[:2]
    strip = unroll_frame(frame, calibration)
    step = max(1, strip.theta_rad.size // PICTURE_COLUMNS)
    return (
        Picture(
            name="frame",
            title="as recorded, with the annulus found",
            image=_reduced(frame, calibration.full_scale),
            x_label="column (px)",
            y_label="row (px)",
            x_extent=(0.0, width - 1.0),
            y_extent=(0.0, height - 1.0),
            curves=_rims(calibration.annuli[frame.index], width, height) | _outlines(calibration.overlay),
            about="The wall is seen between the two rims of the mirror; in the middle the camera sees itself.",
        ),
        Picture(
            name="strip",
            title="unrolled, its light evened out",
            image=np.where(strip.valid, strip.intensity, np.nan)[:, ::step],
            x_label="θ (rad)",
            y_label="z (mm)",
            x_extent=(float(strip.theta_rad[0]), float(strip.theta_rad[::step][-1])),
            y_extent=(float(strip.z_mm[0]), float(strip.z_mm[-1])),
        ),
    )


def _reduced(frame: Frame, full_scale: float) -> NDArray[np.uint8]:
    """Return the frame in grey or RGB, uint8, reduced to at most ``PICTURE_SIDE_PX`` a side."""
    samples = frame.samples[..., :3] if frame.samples.ndim == 3 else frame.samples
    image: NDArray[np.uint8] = np.clip(samples.astype(np.float32) / full_scale * 255, 0, 255).astype(np.uint8)
    shrink = PICTURE_SIDE_PX / max(image.shape[:2])
    if shrink < 1:
        image = np.asarray(cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), np.uint8)
    return image


def _rims(annulus: Annulus, width: int, height: int) -> dict[str, Coordinates]:
    """Return both rims as curves of columns and rows, NaN outside the image."""
    angle = np.linspace(0, 2 * np.pi, 361)
    curves = {}
    for label, ring in zip(("inner rim", "outer rim"), annulus.rings, strict=True):
        x = annulus.columns(ring.x_px + ring.radius_px * np.cos(angle))
        y = ring.y_px + ring.radius_px * np.sin(angle)
        inside = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
        curves[label] = np.where(inside[:, None], np.stack([x, y], axis=1), np.nan)
    return curves


def _outlines(overlay: Mask | None) -> dict[str, Coordinates]:
    """Return the outlines of what was drawn over the picture, one after the other with NaN between them."""
    if overlay is None:
        return {}
    outlines, _ = cv2.findContours(overlay.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    closed = [np.concatenate([xy[:, 0], xy[:1, 0]]).astype(np.float64) for xy in outlines]
    return {"overlay, masked": np.concatenate([line for xy in closed for line in (xy, np.full((1, 2), np.nan))])}


def locate_in_frame(index: int, places: Places, calibration: EndoscopeCalibration) -> dict[str, Coordinates]:
    """Return (column, row) in px of the pixel that looks at each place on the nominal bore, and (θ, z) in the strip.

    An endoscope does not know depth. What lies behind the bore's wall is seen where the ray through it crosses the
    wall, and the panorama has it there. Places beyond the rims are not seen.
    """
    from_centre_mm = places.z_mm - calibration.z_mm[index]
    seen = np.abs(from_centre_mm) <= calibration.strip_z_mm[-1]
    r_px = calibration.optics.r_px(np.where(seen, from_centre_mm, 0.0))
    angle = calibration.image_angle(index, places.theta_rad)
    annulus = calibration.annuli[index].with_drift(*calibration.drift_px).moved(*calibration.shift_px)
    x, y = annulus.centre_at(r_px)
    pixel = np.stack([annulus.columns(x + r_px * np.cos(angle)), y + r_px * np.sin(angle)], axis=1)
    strip = np.stack([np.mod(places.theta_rad, 2 * np.pi), places.z_mm], axis=1)
    return {name: np.where(seen[:, np.newaxis], xy, np.nan) for name, xy in (("frame", pixel), ("strip", strip))}


class EndoscopeModality:
    """The cone-mirror endoscope; it has no state."""

    parameters = EndoscopeParameters
    sniff = staticmethod(sniff_frames)
    open = staticmethod(open_frames)
    survey = staticmethod(survey_frames)
    illustrate = staticmethod(picture_frame)
    locate = staticmethod(locate_in_frame)
    calibrate = staticmethod(calibrate_endoscope)

    def reading_once(
        self,
        stream: FrameStream,
        parameters: EndoscopeParameters,  # noqa: ARG002 – the contract's
    ) -> AbstractContextManager[FrameStream]:
        """Return the recording's frames, reduced to what is needed and each read once from ``stream``."""
        return green_frames(stream)

    def unroll(self, frame: Frame, calibration: EndoscopeCalibration) -> Strip:
        """Turn one frame into a strip. Pure."""
        return unroll_frame(frame, calibration)

    def add_depth(
        self,
        panorama: Panorama,
        stream: FrameStream,
        calibration: EndoscopeCalibration,
        parameters: EndoscopeParameters,
    ) -> Panorama:
        """Add depth by parallax, where that is wanted and the frames have enough in common."""
        return add_parallax(panorama, stream, calibration) if parameters.parallax else panorama

    def settle(self, panorama: Panorama, calibration: EndoscopeCalibration) -> Panorama:
        """Add what is to be doubted; there is no depth of slices to reconcile."""
        return replace(panorama, doubts=(*panorama.doubts, *calibration.doubts))


ENDOSCOPE: LocatingModality[EndoscopeParameters, EndoscopeCalibration] = EndoscopeModality()
