"""Brightness of a frame: one channel of full scale 1, reduced in size where a survey needs no more.

Of a colour frame, its green is all that survey and unrolling need; the other channels are left out.
"""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.arrays import Image
from endoct.base.compute.compiled import compiled
from endoct.base.compute.memory import Room
from endoct.modalities.contract import Frame, FrameStream
from endoct.modalities.frame_cache import kept_frames

BIT_DEPTHS = (8, 10, 12, 14, 16)
SATURATED = 0.99
DARKEST = 0.002
UNSEEN = 1e12
"""Brightness given to unusable pixels: the least share of one makes a sample brighter than any real one."""


def full_scale(samples: NDArray[Any]) -> float:
    """Return the value of a saturated sample: that of the least bit depth that holds all samples; 1 for floats."""
    largest = float(samples.max())
    if samples.dtype.kind == "f":
        return max(1.0, largest)
    return next((float(2**bits - 1) for bits in BIT_DEPTHS if largest <= 2**bits - 1), largest)


def reduced_light(
    samples: NDArray[Any], scale: float, factor: int, room: Room | None = None
) -> tuple[Image, Image | None]:
    """Return the brightness of a frame, 1 at full scale, and which share is saturated, None where nothing is.

    Both are means of ``factor`` × ``factor`` pixels, float32 (row, column); a remainder at the far edges is left out.
    They are arrays of ``room``, if any. Of a colour frame it is that of its green. That sees tissue with the most
    contrast, and under the warm light of an endoscope it saturates after red.
    """
    plane = np.ascontiguousarray(green(samples))
    room, shape = room or Room(), (plane.shape[0] // factor, plane.shape[1] // factor)
    light, share = room.array("light", shape), room.array("share", shape)
    least = np.float32(least_saturated(plane.dtype, scale))
    return light, share if _reduce(plane, np.float32(scale), least, factor, light, share) else None


@compiled
def _reduce(
    samples: NDArray[Any], scale: np.float32, least: np.float32, factor: int, light: Image, share: Image
) -> bool:
    """Write brightness and the share of samples from ``least`` on; return whether there are any."""
    line, any_saturated, per_sample = np.empty(light.shape[1] * factor, np.float32), False, np.float32(1 / factor**2)
    for i in range(light.shape[0]):
        light[i], share[i] = 0, 0
        for k in range(i * factor, (i + 1) * factor):
            row = samples[k, : line.size]
            _divide(row, scale, line)
            _add_groups(line, factor, light[i])
            saturated = False
            for j in range(row.size):
                if np.float32(row[j]) >= least:
                    saturated = True
            if saturated:
                any_saturated = True
                _from(row, least, line)
                _add_groups(line, factor, share[i])
        for j in range(light.shape[1]):
            light[i, j] *= per_sample
            share[i, j] *= per_sample
    return any_saturated


@compiled
def _divide(row: NDArray[Any], scale: np.float32, light: Image) -> None:
    for j in range(light.size):
        light[j] = np.float32(row[j]) / scale


@compiled
def _from(row: NDArray[Any], least: np.float32, light: Image) -> None:
    for j in range(light.size):
        light[j] = np.float32(1) if np.float32(row[j]) >= least else np.float32(0)


@compiled
def _add_groups(line: Image, n: int, total: Image) -> None:
    """Add the sums of ``n`` neighbours each; indices have no sign, so that pairs are added as vectors."""
    if n == 1:
        for j in range(total.size):
            total[j] += line[j]
    elif n == 2:
        for j in range(np.uint64(total.size)):
            total[j] += line[np.uint64(2) * j] + line[np.uint64(2) * j + np.uint64(1)]
    else:
        for j in range(total.size):
            part = line[n * j]
            for k in range(1, n):
                part += line[n * j + k]
            total[j] += part


def least_saturated(dtype: np.dtype[Any], scale: float) -> float:
    """Return the smallest saturated sample; whole numbers have exactly one."""
    return SATURATED * scale if dtype.kind == "f" else ceil(SATURATED * scale)


def green(samples: NDArray[Any]) -> NDArray[Any]:
    """Return the samples of a frame's green, (row, column), a view; those of a grey frame."""
    return samples[..., 1] if samples.ndim == 3 else samples


def log_light(image: Image) -> Image:
    """Return the natural logarithm of a brightness, limited where it is black."""
    return np.asarray(np.log(np.maximum(image, DARKEST)), dtype=np.float32)


@dataclass(frozen=True, eq=False, kw_only=True)
class GreenFrame(Frame):
    """A frame of which ``samples`` are the green ones, (row, column), and ``full_scale`` is that of all colours."""

    full_scale: float


def green_frames(stream: FrameStream) -> AbstractContextManager[FrameStream]:
    """Return a stream of the green of every frame of ``stream``, each read from there once."""
    return kept_frames(stream, _green_frame)


def full_scale_of(frame: Frame) -> float:
    """Return the value of a saturated sample of a frame, by :func:`full_scale` of all its colours."""
    return frame.full_scale if isinstance(frame, GreenFrame) else full_scale(frame.samples)


def _green_frame(frame: Frame) -> GreenFrame:
    samples = np.ascontiguousarray(green(frame.samples)).view()
    samples.flags.writeable = False
    return GreenFrame(index=frame.index, samples=samples, z_mm=frame.z_mm, full_scale=full_scale(frame.samples))
