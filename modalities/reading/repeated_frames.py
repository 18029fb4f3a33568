"""What a recording holds twice: files with the same bytes, and frames with the same samples.

Most are told apart by little: files by their sizes and a few bytes inside, frames by some samples while they are read.
Only those that are alike so far are compared as a whole.
"""

import hashlib
import os
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from endoct.base.errors import EndoctError
from endoct.base.files.files import open_regular, sha256_of
from endoct.modalities.reading.remarks import NONE, Remarks, doubted

_BLOCK = 4096
_PARTS = 2
ROWS, COLUMNS = 16, 1024
"""Number of rows and columns of a frame that are looked at first, which takes 20 µs."""
MOST_CONFIRMED = 16
"""Number of pairs that are compared sample by sample, whose frames are read again."""
PLAIN = b""
"""This stands for a frame of one value, which repeats nothing."""


def sets_of_equal(files: Sequence[Path]) -> list[list[Path]]:
    """Return the sets of two and more of ``files`` that hold the same bytes; empty files are left out.

    Of most files nothing but the size is read. What cannot be read is equal to nothing.
    """
    by_size = _grouped((size, file) for file in files if (size := size_of(file)))
    by_parts = [_grouped((_parts(file), file) for file in group) for group in by_size.values() if len(group) > 1]
    alike = [group for groups in by_parts for parts, group in groups.items() if parts and len(group) > 1]
    by_content = [_grouped((_digest(file), file) for file in group) for group in alike]
    return [group for groups in by_content for digest, group in groups.items() if digest and len(group) > 1]


def _grouped(pairs: Iterable[tuple[Hashable, Path]]) -> dict[Hashable, list[Path]]:
    groups: dict[Hashable, list[Path]] = defaultdict(list)
    for key, file in pairs:
        groups[key].append(file)
    return groups


def size_of(file: Path) -> int:
    """Return how many bytes a file has, 0 where that cannot be known."""
    with suppress(OSError, ValueError):
        return file.stat().st_size
    return 0


def _parts(file: Path) -> bytes:
    """Return some bytes from the whole length of a file; empty where it cannot be read."""
    with suppress(EndoctError, OSError), open_regular(file) as opened:
        size = opened.seek(0, os.SEEK_END)
        read = []
        for k in range(_PARTS):
            opened.seek(max(0, size * (k + 1) // (_PARTS + 1) - _BLOCK // 2))
            read.append(opened.read(min(_BLOCK, size)))
        return b"".join(read)
    return b""


def _digest(file: Path) -> str:
    with suppress(EndoctError, OSError):
        return sha256_of(file)
    return ""


def fingerprint(frame: NDArray[Any]) -> bytes:
    """Return what frames that hold the same samples have in common, and hardly any others."""
    rows, columns = (max(1, -(-n // most)) for n, most in zip(frame.shape, (ROWS, COLUMNS), strict=False))
    some = np.ascontiguousarray(frame[rows // 2 :: rows, ::columns])
    if some.size and (some == some.flat[0]).all():
        return PLAIN
    return hashlib.blake2b(some.tobytes(), digest_size=16).digest()


def on_repeated(prints: Mapping[int, bytes], read: Callable[[int], NDArray[Any]]) -> Remarks:
    """Return a doubt that names the frames which hold the same samples as one before; ``read`` returns a frame."""
    groups: dict[bytes, list[int]] = defaultdict(list)
    for index in sorted(prints):
        groups[prints[index]].append(index)
    pairs = [(group[0], other) for key, group in groups.items() if key != PLAIN for other in group[1:]]
    sure = [pair for pair in pairs[:MOST_CONFIRMED] if _same(pair, read)]
    if not sure:
        return NONE
    more = len(pairs) > MOST_CONFIRMED and len(sure) == MOST_CONFIRMED
    count = len(pairs) if more else len(sure)
    listed = ", ".join(f"{other} as {first}" for first, other in sure[:4])
    what = (
        f"{count} frame{'s hold' if count > 1 else ' holds'} the very samples of another (counted from 0: {listed}): "
        "a recording that stood still, or frames written twice in place of lost ones."
    )
    return doubted("frames-repeated", what, float(count), 0.0)


def same_picture(image: NDArray[Any], other: NDArray[Any]) -> bool:
    """Say whether two images are the same, where one may have three equal colours, or opaque transparency more."""
    image, other = _plain(image), _plain(other)
    if image.shape != other.shape:
        return False
    if image.dtype != other.dtype and {image.dtype, other.dtype} == {np.dtype(np.uint8), np.dtype(np.uint16)}:
        wide, narrow = (image, other) if image.dtype == np.uint16 else (other, image)
        return bool(np.array_equal(wide, narrow) or np.array_equal(wide, narrow.astype(np.uint16) * 257))
    return bool(np.array_equal(image, other))


def without_colour(image: NDArray[Any]) -> NDArray[Any] | None:
    """Return an image (row, column, 3 or more) of three equal colours as (row, column); None where they differ."""
    red, green, blue = (image[..., k] for k in range(3))
    return red if np.array_equal(red, green) and np.array_equal(red, blue) else None


def _plain(image: NDArray[Any]) -> NDArray[Any]:
    if image.ndim == 3 and image.shape[2] in (2, 4):
        image = image[..., :3] if image.shape[2] == 4 else image[..., 0]
    grey = without_colour(image) if image.ndim == 3 and image.shape[2] == 3 else None
    return image if grey is None else grey


def _same(pair: tuple[int, int], read: Callable[[int], NDArray[Any]]) -> bool:
    try:
        return np.array_equal(read(pair[0]).copy(), read(pair[1]))
    except EndoctError:
        return False
