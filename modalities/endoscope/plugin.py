"""The cone-mirror endoscope as a modality: sniff, open, survey, unroll, settle, illustrate."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Frame, FrameStream, Picture, Sniff, inward_positions_mm
from endoct.modalities.endoscope.calibration import EndoscopeCalibration
from endoct.modalities.endoscope.light import brightness, log_light, saturated
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.parameters import EndoscopeParameters
from endoct.modalities.endoscope.survey import survey
from endoct.modalities.endoscope.unroll import means, pixel_map, sample, sample_cyclic, sample_mask
from endoct.modalities.folders import exists, is_folder
from endoct.modalities.numbering import positions_by_number
from endoct.modalities.recording import (
    IMAGE_SUFFIXES,
    ImageStack,
    image_files,
    open_stack,
    whole_recordings,
)
from endoct.modalities.tiff import is_tiff
from endoct.modalities.video import is_video
from endoct.stitching.arrays import Coordinates, readonly
from endoct.stitching.errors import EndoctError
from endoct.stitching.panorama import Panorama
from endoct.stitching.strip import Strip

PICTURE_SIDE_PX = 900


@dataclass(frozen=True, eq=False)
class EndoscopeStream:
    """An opened recording; indexing reads one frame."""

    stack: ImageStack
    acquisition: EndoscopeAcquisition
    nominal_mm: Coordinates

    def __len__(self) -> int:
        return len(self.stack)

    def __getitem__(self, index: int) -> Frame:
        return Frame(index, self.stack[index], float(self.nominal_mm[index]))


class Endoscope:
    """The modality; has no state."""

    parameters: type[Any] = EndoscopeParameters

    def sniff(self, path: Path) -> Sniff:
        """Claim a folder or file whose first image is a photograph: in colour, or bright on a dark border."""
        if not exists(path):
            return Sniff(False, "it does not exist")
        try:
            if is_folder(path) and not image_files(path) and not any(map(is_video, whole_recordings(path))):
                return Sniff(False, f"it holds no images ({', '.join(IMAGE_SUFFIXES)}) and no video")
        except EndoctError as error:
            return Sniff(False, str(error))
        if path.is_file() and path.suffix.lower() not in IMAGE_SUFFIXES and not is_tiff(path) and not is_video(path):
            return Sniff(False, f"it is no image ({', '.join(IMAGE_SUFFIXES)}) and no video")
        try:
            first = open_stack(path)[0]
        except EndoctError as error:
            return Sniff(False, str(error))
        if first.ndim == 3:
            return Sniff(True, "its images are in colour")
        height, width = first.shape
        rim = max(1, min(height, width) // 20)
        corners = [first[y, x] for y in (slice(rim), slice(-rim, None)) for x in (slice(rim), slice(-rim, None))]
        ground = max(float(np.median(corner)) for corner in corners)
        bright = float(np.percentile(first, 90))
        if bright > 0 and ground < 0.3 * bright and max(height, width) <= 2 * min(height, width):
            return Sniff(True, "its images are a bright disc or ring on dark ground")
        return Sniff(False, "its images are grey and fill the frame, unlike an endoscope's")

    def open(self, path: Path, acquisition: Acquisition) -> FrameStream:
        """Open a folder of images, a multi-page TIFF or a video, grey or colour."""
        if not isinstance(acquisition, EndoscopeAcquisition):
            raise EndoctError("the sidecar is not an endoscope's", found=type(acquisition).__name__)
        stack = open_stack(path)
        shape = stack.frame_shape
        if len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] not in (3, 4)) or min(shape[:2]) < 32:
            raise EndoctError(
                f"{path} holds no endoscope frames",
                found=f"frames of {shape}",
                expected="grey or RGB images of at least 32 × 32 pixels",
            )
        given, farthest = acquisition.annulus, float(max(shape[:2]))
        if given is not None and max(abs(given.x), abs(given.y), given.outer_px) > 2 * farthest:
            raise EndoctError(
                "the annulus of the sidecar lies outside the image",
                found=f"x = {given.x:g}, y = {given.y:g}, outer_px = {given.outer_px:g}",
                expected=f"pixels of frames of {shape[1]} × {shape[0]}",
            )
        if acquisition.positions_mm is None and acquisition.pitch_mm is not None:
            by_number = positions_by_number(stack.files, acquisition.pitch_mm)
            acquisition = acquisition.model_copy(update={"positions_mm": by_number})
        nominal = inward_positions_mm(
            len(stack),
            pitch_mm=acquisition.pitch_mm or 0.0,
            travel=acquisition.travel,
            positions_mm=acquisition.positions_mm,
        )
        return EndoscopeStream(stack, acquisition, readonly(nominal, np.float64))

    def survey(self, stream: FrameStream, parameters: EndoscopeParameters) -> EndoscopeCalibration:
        """Find annulus, light, feed and roll."""
        return survey(stream, parameters)

    def unroll(self, frame: Frame, calibration: EndoscopeCalibration) -> Strip:
        """Sample a frame on the panorama's rows that it shows, divided by the light of the probe."""
        c = calibration
        half_mm = float(c.strip_z_mm[-1])
        centre_mm = float(c.z_mm[frame.index])
        first, last = np.searchsorted(c.row_z_mm, [centre_mm - half_mm, centre_mm + half_mm])
        z_mm = c.row_z_mm[first : max(last, first + 1)]
        theta_rad = c.grid.theta_rad
        by_row, by_column = c.oversample
        fine_z = _finer(z_mm - centre_mm, c.grid.dz_mm, by_row)
        fine_angle = c.image_angle(frame.index, _finer(theta_rad, c.grid.dtheta_rad, by_column))
        annulus = c.annuli[frame.index].with_drift(*c.drift_px).moved(*c.shift_px)
        columns, rows = pixel_map(annulus, c.optics.r_px(fine_z), fine_angle)

        light, inside = sample(brightness(frame.samples, c.full_scale), columns, rows)
        clipped = sample_mask(saturated(frame.samples, c.full_scale), columns, rows)
        flat_rows = (fine_z - c.strip_z_mm[0]) / (c.strip_z_mm[1] - c.strip_z_mm[0])
        flat_columns = fine_angle / (2 * np.pi) * c.flat.log_light.shape[1]
        flat = sample_cyclic(c.flat.log_light, flat_rows, flat_columns)
        clean = sample_cyclic(c.flat.usable.astype(np.float32), flat_rows, flat_columns) > 0.5
        shape = z_mm.size, theta_rad.size
        good = means((inside & ~clipped & clean).astype(np.float32), *shape) > 0.99
        intensity = means(np.exp(log_light(light) - flat - np.float32(c.exposure[frame.index])), *shape)

        weight = _row_weight(c, z_mm - centre_mm, half_mm)
        return Strip(
            z_mm=z_mm,
            theta_rad=theta_rad,
            intensity=np.where(good, intensity, 0.0),
            depth_mm=None,
            valid=good,
            weight=np.broadcast_to(weight[:, None], shape),
            diagnostics={"valid_fraction": float(good.mean())},
        )

    def settle(self, panorama: Panorama, calibration: EndoscopeCalibration) -> Panorama:
        """Add what is to be doubted; there is no depth to reconcile."""
        return replace(panorama, doubts=calibration.doubts)

    def illustrate(self, frame: Frame, calibration: EndoscopeCalibration) -> tuple[Picture, ...]:
        """Return the frame with its annulus drawn in, and the strip it unrolls to."""
        samples = frame.samples[..., :3] if frame.samples.ndim == 3 else frame.samples
        height, width = samples.shape[:2]
        shrink = min(1.0, PICTURE_SIDE_PX / max(height, width))
        image = np.clip(samples.astype(np.float32) / calibration.full_scale * 255, 0, 255).astype(np.uint8)
        if shrink < 1:
            image = cv2.resize(image, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
        angle = np.linspace(0, 2 * np.pi, 361)
        curves = {}
        for label, ring in zip(("inner rim", "outer rim"), calibration.annuli[frame.index].rings, strict=True):
            x, y = ring.x_px + ring.radius_px * np.cos(angle), ring.y_px + ring.radius_px * np.sin(angle)
            seen = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
            curves[label] = np.where(seen[:, None], np.stack([x, y], axis=1), np.nan)
        strip = self.unroll(frame, calibration)
        step = max(1, strip.theta_rad.size // 1000)
        return (
            Picture(
                name="frame",
                title=f"Frame {frame.index} as recorded, with the annulus found",
                image=image,
                x_label="column (px)",
                y_label="row (px)",
                x_extent=(0.0, width - 1.0),
                y_extent=(0.0, height - 1.0),
                curves=curves,
            ),
            Picture(
                name="strip",
                title=f"Frame {frame.index} unrolled, its light evened out",
                image=np.where(strip.valid, strip.intensity, np.nan)[:, ::step],
                x_label="θ (rad)",
                y_label="z (mm)",
                x_extent=(float(strip.theta_rad[0]), float(strip.theta_rad[::step][-1])),
                y_extent=(float(strip.z_mm[0]), float(strip.z_mm[-1])),
            ),
        )


def _finer(centres: Coordinates, step: float, parts: int) -> Coordinates:
    """Return the centres of ``parts`` equal parts of every cell."""
    within = (np.arange(parts) + 0.5) / parts - 0.5
    return np.asarray((centres[:, None] + step * within).ravel())


def _row_weight(c: EndoscopeCalibration, from_centre_mm: Coordinates, half_mm: float) -> Coordinates:
    """Return each row's weight: more pixels lie on a larger circle, and strips fade into each other."""
    r_px = c.optics.r_px(from_centre_mm)
    to_edge = np.clip((half_mm - np.abs(from_centre_mm)) / (2 * half_mm * c.taper), 0, 1)
    fade = np.sin(np.pi / 2 * to_edge) ** 2
    return np.asarray(r_px / c.optics.r_px(np.zeros(1)) * np.maximum(fade, 1e-3))


ENDOSCOPE = Endoscope()
