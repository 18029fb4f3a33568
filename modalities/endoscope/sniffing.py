"""What looks like an endoscope's recording: images that show the annulus of a mirror."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError, NotSeen
from endoct.base.files.files import exists
from endoct.modalities.contract import Preview, Sniff
from endoct.modalities.endoscope.light import full_scale, reduced_light
from endoct.modalities.endoscope.mirror.annulus import LEAST_SUPPORT, find_annulus, follow
from endoct.modalities.endoscope.opening import LEAST_SIDE_PX
from endoct.modalities.reading.recording import (
    IMAGE_SUFFIXES,
    ImageStack,
    gives_frames,
    open_stack,
    some_frames,
)

SIDE_PX = 240
"""Images are reduced to about this shorter side; an annulus is as clear then."""


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
