"""A picture of a recording before anything is done to it: its first, middle and last frame side by side."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from endoct.modalities.contract import Preview
from endoct.stitching.errors import EndoctError
from endoct.stitching.output import new_output
from endoct.workbench.running.kinds import THUMBNAIL

SIDE_PX = 480
"""Of each frame, at most."""
MOST_UNEVEN = 2.0
"""How much longer than the other one side of a frame may be; a turn of 14 000 A-scans is drawn narrower."""
GAP_PX = 6
DARKEST, BRIGHTEST = 0.5, 99.5
"""Percentiles of the samples that become black and white."""


def write_thumbnail(preview: Preview | None, recording: Path, path: Path) -> None:
    """Write the frames of ``preview`` as one PNG. Raises :class:`EndoctError` where there are none, or one exists."""
    if path.suffix.lower() != ".png":
        raise EndoctError(f"a thumbnail is a PNG, which {path} is not", expected="FILE.png")
    if path.exists():
        raise EndoctError(f"{path} exists already", remedy="choose another file")
    if preview is None or not preview.pictures:
        raise EndoctError(f"the plug-in that reads {recording} gives no pictures before it is opened")
    picture = side_by_side(preview.pictures)
    with new_output(path, THUMBNAIL, inputs=[recording]) as scratch:
        scratch.write_bytes(cv2.imencode(".png", picture[..., ::-1] if picture.ndim == 3 else picture)[1].tobytes())


def side_by_side(pictures: tuple[NDArray[Any], ...]) -> NDArray[np.uint8]:
    """Return pictures of one shape next to each other, uint8 (row, column) or (row, column, RGB), on one grey scale."""
    low, high = np.percentile([np.percentile(picture, (DARKEST, BRIGHTEST)) for picture in pictures], (0, 100))
    rows, columns = pictures[0].shape[:2]
    scale = min(1.0, SIDE_PX / min(max(rows, columns), MOST_UNEVEN * min(rows, columns)))
    size = min(SIDE_PX, max(1, round(columns * scale))), min(SIDE_PX, max(1, round(rows * scale)))
    small = []
    for picture in pictures:
        grey = np.clip((picture.astype(np.float32) - low) * (255 / max(high - low, 1e-9)), 0, 255)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        small += [grey, np.full((grey.shape[0], GAP_PX, *grey.shape[2:]), 255, np.float32)]
    return np.asarray(np.concatenate(small[:-1], axis=1).round(), dtype=np.uint8)
