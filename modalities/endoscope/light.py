"""Brightness of a frame: one channel of full scale 1, reduced in size where a survey needs no more."""

from math import ceil
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.arrays import Image, Mask
from endoct.stitching.compiled import compiled
from endoct.stitching.room import Room

BIT_DEPTHS = (8, 10, 12, 14, 16)
GREEN = 1
"""Its channel in a frame in colour."""
SATURATED = 0.99
DARKEST = 0.002
UNSEEN = 1e12
"""Brightness of pixels that say nothing: the least share of one makes a sample brighter than any that is seen."""


def full_scale(samples: NDArray[Any]) -> float:
    """Return the value of a saturated sample: of the least bit depth that holds what was seen; 1 for floats."""
    largest = float(samples.max())
    if samples.dtype.kind == "f":
        return max(1.0, largest)
    return next((float(2**bits - 1) for bits in BIT_DEPTHS if largest <= 2**bits - 1), largest)


def brightness(samples: NDArray[Any], scale: float, room: Room | None = None) -> Image:
    """Return the brightness of a frame, float32 (row, column), 1 at full scale; of a colour frame its green.

    It is an array of ``room``, if any. Green sees tissue with the most contrast and saturates after red under the warm
    light of an endoscope.
    """
    light: Image = (room or Room()).array("image", samples.shape[:2])
    _divide(np.ascontiguousarray(green(samples)), np.float32(scale), light)
    return light


@compiled
def _divide(samples: NDArray[Any], scale: np.float32, light: Image) -> None:
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            light[i, j] = np.float32(samples[i, j]) / scale


def saturated(samples: NDArray[Any], scale: float) -> Mask:
    """Say where the brightness of a frame is saturated, bool (row, column)."""
    return np.asarray(green(samples) >= least_saturated(samples.dtype, scale))


def least_saturated(dtype: np.dtype[Any], scale: float) -> float:
    """Return the least saturated sample; of whole numbers it is one."""
    return SATURATED * scale if dtype.kind == "f" else ceil(SATURATED * scale)


def green(samples: NDArray[Any]) -> NDArray[Any]:
    """Return the samples of a frame's green, (row, column), a view; those of a grey frame."""
    return samples[..., GREEN] if samples.ndim == 3 else samples


def reduced(image: Image, factor: int) -> Image:
    """Return the means of ``factor`` × ``factor`` pixels; a remainder at the far edges is left out."""
    if factor == 1:
        return image
    height, width = image.shape[0] // factor, image.shape[1] // factor
    return np.asarray(
        cv2.resize(image[: height * factor, : width * factor], (width, height), interpolation=cv2.INTER_AREA),
        dtype=np.float32,
    )


def log_light(image: Image) -> Image:
    """Return the natural logarithm of a brightness, limited where it is black."""
    return np.asarray(np.log(np.maximum(image, DARKEST)), dtype=np.float32)
