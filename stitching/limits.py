"""How large an array a file may make endoct allocate. Checked before memory is taken."""

import math
import os
from collections.abc import Sequence

from endoct.stitching.errors import EndoctError

VARIABLE = "ENDOCT_LARGEST_ARRAY_GB"
DEFAULT_GB = 0.5
"""A B-scan of the paper has 0.014 GB, a channel of a panorama of 14 000 × 3 000 samples 0.17."""


def largest_array_bytes() -> int:
    """Return the limit. Raises :class:`EndoctError` where the environment sets it to something else than a size."""
    text = os.environ.get(VARIABLE, "")
    try:
        gigabytes = float(text) if text else DEFAULT_GB
    except ValueError:
        gigabytes = math.nan
    if not 0 < gigabytes < 1e6:
        raise EndoctError(f"{VARIABLE} is no size", found=f"'{text}'", expected="gigabytes, as 2 or 0.5")
    return int(gigabytes * 1e9)


def check_array_size(shape: Sequence[int], itemsize: int, what: str) -> None:
    """Raise :class:`EndoctError` where an array of ``shape`` is larger than the limit; ``what`` asks for it."""
    n_bytes, limit = math.prod(map(int, shape)) * itemsize, largest_array_bytes()
    if n_bytes > limit:
        raise EndoctError(
            f"{what} asks for too much memory",
            found=f"{' × '.join(map(str, shape))} samples, {n_bytes / 1e9:.3g} GB",
            expected=f"{limit / 1e9:g} GB at most in one array",
            remedy=f"check the file; if it is right, set {VARIABLE} to more",
        )
