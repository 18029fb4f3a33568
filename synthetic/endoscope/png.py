"""Frames as PNG files."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.stitching.errors import EndoctError

# the filter "up" with run lengths: of frames, a sixth less to store than OpenCV's own choice makes of them, in a fifth
# less time
_ENCODING = [
    cv2.IMWRITE_PNG_COMPRESSION, 1,
    cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP,
]  # fmt: skip


def png(frame: NDArray[np.uint8]) -> bytes:
    """Return a frame, u8 (row, column) or (row, column, RGB), as the bytes of a PNG file."""
    stored = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR) if frame.ndim == 3 else frame
    done, data = cv2.imencode(".png", stored, _ENCODING)
    if not done:
        raise EndoctError("a frame could not be encoded as PNG", found=f"{frame.dtype} {frame.shape}")
    return np.asarray(data, dtype=np.uint8).tobytes()


def write_png(path: Path, frame: NDArray[np.uint8]) -> None:
    """Write a frame as ``path``."""
    path.write_bytes(png(frame))
