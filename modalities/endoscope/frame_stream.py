"""Recordings of an endoscope on disk: what looks like one, and the stream of its frames.

Images that show the annulus of a mirror look like one.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Coordinates, readonly
from endoct.base.doubt import Doubt
from endoct.base.errors import EndoctError, NotSeen
from endoct.base.files.files import exists
from endoct.modalities.acquisition import Acquisition
from endoct.modalities.contract import Frame, Preview, Sniff, inward_positions_mm
from endoct.modalities.endoscope.light import full_scale, reduced_light
from endoct.modalities.endoscope.manifest import EndoscopeAcquisition
from endoct.modalities.endoscope.mirror.annulus import LEAST_SUPPORT, find_annulus, follow
from endoct.modalities.reading.numbering import positions_along
from endoct.modalities.reading.recording import IMAGE_SUFFIXES, ImageStack, gives_frames, open_stack, some_frames
from endoct.modalities.reading.remarks import NONE, Remarks
from endoct.modalities.stated import on_stated

LEAST_SIDE_PX = 32
NOT_SQUARE = 0.02
"""A pixel's sides may differ by this share: resolutions are rounded."""
SIDE_PX = 240
"""Images are reduced to about this shorter side; an annulus is as clear then."""


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
        return self.stack.remarks + self.on_places + _on_pixels(self.stack.pixel_aspect)

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


def _on_pixels(aspect: float) -> Remarks:
    """Return a doubt where pixels are not square by what the file says."""
    if abs(np.log(aspect)) < NOT_SQUARE:
        return NONE
    what = (
        f"The file states that its pixels are {aspect:.3g} times as wide as high. That was not used: what counts is "
        "the ring's own shape in the frames."
    )
    return Remarks(doubts=(Doubt("pixel-aspect-stated", what, value=aspect, unit="1", expected=1.0),))


@np.errstate(over="ignore", invalid="ignore")  # of samples near the largest float
def sniff_frames(path: Path) -> Sniff:
    """Claim images that show a bright ring, dark inside and outside: a mirror's annulus."""
    if not exists(path):
        return Sniff(False, "it does not exist")
    try:
        if not gives_frames(path):
            return Sniff(False, f"it holds no images ({', '.join(IMAGE_SUFFIXES)}) and no video")
        stack = open_stack(path)
        if min(stack.frame_shape[:2]) < LEAST_SIDE_PX:
            return Sniff(False, f"its images of {_pixels(stack)} are too small")
        frames = some_frames(stack)
    except EndoctError as error:
        return Sniff(False, str(error))
    preview = Preview(len(stack), _pixels(stack), str(stack.dtype), tuple(frames), stack.remarks)
    kind = "colour" if len(stack.frame_shape) == 3 else "grey"
    steady = _frames_with_annulus(frames)
    if steady is None:
        return Sniff(False, f"its {kind} images show no annulus", preview=preview)
    what = f"{kind} images that show a ring, dark inside and outside, as a mirror's annulus"
    if len(frames) == 1:
        return Sniff(True, f"{what}; it is a single image, so whether the ring stays cannot be seen", "unsure", preview)
    if steady < len(frames):
        return Sniff(True, f"{what}, but not in every image", "unsure", preview)
    return Sniff(True, f"{what}, which stays where it is", "likely", preview)


def _frames_with_annulus(frames: list[NDArray[Any]]) -> int | None:
    """Return in how many frames the annulus of their mean is clear; None where that has none."""
    scale = max(full_scale(samples) for samples in frames)
    factor = max(1, min(frames[0].shape[:2]) // SIDE_PX)
    images = [reduced_light(samples, scale, factor)[0] for samples in frames]
    try:
        annulus = find_annulus(np.mean(images, axis=0, dtype=np.float32))
    except NotSeen:
        return None
    return sum(follow(image, annulus).support >= LEAST_SUPPORT for image in images)


def _pixels(stack: ImageStack) -> str:
    rows, columns = stack.frame_shape[:2]
    return f"{columns} × {rows} pixels" + (" in colour" if len(stack.frame_shape) == 3 else "")
