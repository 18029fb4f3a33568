"""Recordings of an endoscope on disk: the stream of their frames."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from endoct.base.arrays import Coordinates, readonly
from endoct.base.errors import EndoctError
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Frame, inward_positions_mm
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.reading.numbering import positions_along
from endoct.modalities.reading.recording import ImageStack, open_stack
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.stated import on_stated

LEAST_SIDE_PX = 32


@dataclass(frozen=True, eq=False)
class EndoscopeRecording:
    """An opened recording; indexing reads one frame."""

    stack: ImageStack
    acquisition: EndoscopeAcquisition
    z_mm: Coordinates
    on_places: Remarks = NONE

    @property
    def remarks(self) -> Remarks:
        """What is to be said of the files, and of the frames read so far."""
        return self.stack.remarks + self.on_places

    def __len__(self) -> int:
        return len(self.stack)

    def __getitem__(self, index: int) -> Frame:
        return Frame(index, self.stack[index], float(self.z_mm[index]))


def open_frames(path: Path, acquisition: Acquisition) -> EndoscopeRecording:
    """Open a folder of images, a multi-page TIFF or a video, grey or colour, without reading samples.

    Raises :class:`EndoctError` where it holds no frames, or where the sidecar cannot belong to it.
    """
    if not isinstance(acquisition, EndoscopeAcquisition):
        raise EndoctError("the sidecar is not an endoscope's", found=type(acquisition).__name__)
    stack = open_stack(path)
    stack = stack.with_remarks(on_stated(path, acquisition))
    shape = stack.frame_shape
    if len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] not in (3, 4)) or min(shape[:2]) < LEAST_SIDE_PX:
        raise EndoctError(
            f"{path} holds no endoscope frames",
            found=f"frames of {shape}",
            expected=f"grey or RGB images of at least {LEAST_SIDE_PX} × {LEAST_SIDE_PX} pixels",
        )
    given, farthest = acquisition.annulus, float(max(shape[:2]))
    if given is not None and max(abs(given.x), abs(given.y), given.outer_px) > 2 * farthest:
        raise EndoctError(
            "the annulus of the sidecar lies outside the image",
            found=f"x = {given.x:g}, y = {given.y:g}, outer_px = {given.outer_px:g}",
            expected=f"pixels of frames of {shape[1]} × {shape[0]}",
        )
    on_places = NONE
    if acquisition.positions_mm is None and acquisition.pitch_mm is not None:
        steady = acquisition.feed_pitch_mm is None
        rate_hz = acquisition.frame_rate_hz
        places, on_places = positions_along(stack.along, acquisition.pitch_mm, rate_hz, steady=steady)
        acquisition = acquisition.model_copy(update={"positions_mm": places})
    z_mm = inward_positions_mm(
        len(stack),
        pitch_mm=acquisition.pitch_mm or 0.0,
        travel=acquisition.travel,
        positions_mm=acquisition.positions_mm,
    )
    return EndoscopeRecording(stack, acquisition, readonly(z_mm, np.float64), on_places)
