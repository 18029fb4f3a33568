"""One channel of a PNG in colour: its samples are undone without those of the others.

A PNG's row is stored as differences to its neighbours, of every channel by itself. What is packed is unpacked by a
library, and a decoder would undo and store three times as much.
"""

import numpy as np
from numpy.typing import NDArray

from endoct.stitching.compiled import compiled
from endoct.stitching.room import Room

Bytes = NDArray[np.uint8]
_ROOM = Room()


def one_channel(packed: bytes, shape: tuple[int, int, int], channel: int) -> Bytes | None:
    """Return a channel, u8 (row, column), of an image of ``shape`` (rows, columns, channels), 8 bits each.

    ``packed``: what all IDAT chunks hold, of an image that is not interlaced. None where it is not just that image: a
    decoder for all of it has to say what is wrong.
    """
    import imagecodecs

    rows, columns, channels = shape
    lines = _ROOM.array("lines", (rows * (1 + columns * channels),), np.uint8)
    try:
        n_bytes = len(imagecodecs.deflate_decode(packed, out=lines.data))
    except RuntimeError:  # of its check sum, too
        return None
    samples = np.empty((rows, columns), np.uint8)
    if n_bytes != lines.size or not _undo(lines.reshape(rows, -1), channel, channels, samples):
        return None
    return samples


@compiled
def _undo(lines: Bytes, channel: int, channels: int, samples: Bytes) -> bool:
    """Write a channel of ``lines``, each with how it is stored in front; return False where that is no such way."""
    nothing = np.zeros(samples.shape[1], np.uint8)
    for i in range(samples.shape[0]):
        above, row = samples[i - 1] if i else nothing, samples[i]
        how, stored = lines[i, 0], lines[i, 1 + channel :: channels]
        if how == 0:
            row[:] = stored
        elif how == 1:
            _add_to_left(stored, row)
        elif how == 2:
            for j in range(row.size):
                row[j] = stored[j] + above[j]
        elif how == 3:
            _add_to_mean(stored, above, row)
        elif how == 4:
            _add_to_nearest(stored, above, row)
        else:
            return False
    return True


@compiled
def _add_to_left(stored: Bytes, row: Bytes) -> None:
    left = np.uint8(0)
    for j in range(row.size):
        left = np.uint8(left + stored[j])
        row[j] = left


@compiled
def _add_to_mean(stored: Bytes, above: Bytes, row: Bytes) -> None:
    left = np.int32(0)
    for j in range(row.size):
        left = (np.int32(stored[j]) + ((left + np.int32(above[j])) >> 1)) & 255
        row[j] = left


@compiled
def _add_to_nearest(stored: Bytes, above: Bytes, row: Bytes) -> None:
    """Of left, above and the one between them, that is nearest to left + above − between (Paeth)."""
    left, between = np.int32(0), np.int32(0)
    for j in range(row.size):
        top = np.int32(above[j])
        off_left, off_top = abs(top - between), abs(left - between)
        off_between = abs(left + top - 2 * between)
        if off_left <= off_top and off_left <= off_between:
            nearest = left
        else:
            nearest = top if off_top <= off_between else between
        left, between = (np.int32(stored[j]) + nearest) & 255, top
        row[j] = left
