"""From light on the sensor to the image that was stored: noise, saturation, gamma, 8 bits, JPEG."""

from functools import cache

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from endoct.stitching.arrays import Image
from endoct.stitching.errors import EndoctError
from endoct.synthetic.sample.parameters import Endoscope
from endoct.synthetic.sample.randomness import bell

LEVELS = 2**16


def noisy(camera: Endoscope, signal: Image, rng: Generator) -> Image:
    """Return ``signal`` (1 is saturation) with shot and read noise.

    Its variance is signal/full_well + (read_noise/full_well)²; so many electrons are as good as normal.
    """
    sigma = signal * np.float32(1 / camera.full_well)
    sigma += np.float32((camera.read_noise / camera.full_well) ** 2)
    np.sqrt(sigma, out=sigma)
    sigma *= bell(rng, signal.size).reshape(signal.shape)
    sigma += signal
    return sigma


def displayed(signal: Image, gamma: float = 1.8) -> NDArray[np.uint8]:
    """Return ``signal`` clipped at saturation, to the power of 1/``gamma``, in 8 bits."""
    counts = signal * np.float32(LEVELS - 1)
    np.clip(counts, 0, LEVELS - 1, out=counts)
    return np.asarray(cv2.LUT(counts.astype(np.uint16), _display(gamma)), dtype=np.uint8).reshape(signal.shape)


@cache
def _display(gamma: float) -> NDArray[np.uint8]:
    return np.rint(255 * (np.arange(LEVELS) / (LEVELS - 1)) ** (1 / gamma)).astype(np.uint8)


def compressed(camera: Endoscope, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return ``frame``, grey or RGB, as it comes out of JPEG compression."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, round(camera.jpeg_quality)]
    done, data = cv2.imencode(".jpg", cv2.cvtColor(frame, cv2.COLOR_RGB2BGR) if frame.ndim == 3 else frame, quality)
    decoded = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if done else None
    if decoded is None:
        raise EndoctError("a frame could not be compressed as JPEG")
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB) if decoded.ndim == 3 else decoded, dtype=np.uint8)
