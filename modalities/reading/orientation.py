"""Which way up an image is to be seen: the tag Orientation of TIFF and of EXIF in JPEG and PNG."""

import warnings
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.modalities.reading.remarks import NONE, Remarks

UPRIGHT = 1
TAG = 274
_MEANING = {
    2: "mirrored left to right",
    3: "turned by 180°",
    4: "mirrored top to bottom",
    5: "mirrored along a diagonal",
    6: "turned by 90°",
    7: "mirrored along a diagonal",
    8: "turned by 270°",
}


def upright(image: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return an image (row, column, …) as it is to be seen; ``orientation`` is 1 to 8, as the tag counts."""
    if orientation in (5, 6, 7, 8):
        image = np.swapaxes(image, 0, 1)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return image if orientation == UPRIGHT else np.ascontiguousarray(image)


def orientation_in_exif(data: bytes) -> int:
    """Return the orientation in EXIF data, 1 where it has none or an impossible one."""
    from PIL.Image import Exif

    exif = Exif()
    with suppress(Exception), warnings.catch_warnings():  # of no matter is what else is wrong with it
        warnings.simplefilter("ignore")
        exif.load(data)
        return checked(exif.get(TAG))
    return UPRIGHT


def checked(orientation: object) -> int:
    """Return ``orientation``, or 1 where there is no such one."""
    return next((known for known in _MEANING if known == orientation), UPRIGHT)


def on_orientation(orientation: int) -> Remarks:
    """Return a note that images were turned as their files say."""
    if orientation == UPRIGHT:
        return NONE
    how = _MEANING[orientation]
    note = f"The files say that their images are stored {how} (orientation {orientation}); they were put upright."
    return Remarks(notes=(note,))
