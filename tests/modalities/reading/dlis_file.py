"""A small DLIS (RP66 V1) written by hand: one frame of an index and an image, big-endian floats of 32 bits."""

import struct
from pathlib import Path

import numpy as np

FSINGL, USHORT, UVARI, IDENT, ASCII, OBNAME = 2, 15, 18, 19, 20, 23


def _ident(text: str) -> bytes:
    return bytes([len(text)]) + text.encode()


def _name(text: str) -> bytes:
    return b"\1\0" + _ident(text)  # origin 1, copy 0


def _number(value: int) -> bytes:
    return bytes([value]) if value < 128 else struct.pack(">H", 0x8000 | value)


def _set(kind: str, labels: dict[str, int], objects: dict[str, list[bytes]]) -> bytes:
    """Return a table: its template of labels and kinds of values, then each object with values, count first."""
    body = b"\xf0" + _ident(kind) + b"".join(b"\x34" + _ident(label) + bytes([code]) for label, code in labels.items())
    for name, values in objects.items():
        body += b"\x70" + _name(name) + b"".join(b"\x29" + value if value else b"\x00" for value in values)
    return body


def write_dlis(
    path: Path, index: np.ndarray, images: dict[str, np.ndarray], unit: str = "m", has_index: bool = True
) -> Path:
    """Write ``images``, (row, direction), at an ``index`` (row,) in ``unit``."""
    channels = {"TDEP": (unit, 1), **{name: ("", image.shape[1]) for name, image in images.items()}}
    segments = [
        _record(_set("FILE-HEADER", {"SEQUENCE-NUMBER": ASCII, "ID": ASCII},
                     {"0": [b"\1" + _ident("1".rjust(10)), b"\1" + _ident("drawn".ljust(65))]}), 0),
        _record(_set("ORIGIN", {"FILE-ID": ASCII}, {"0": [b"\1" + _ident("drawn")]}), 1),
        _record(_set("CHANNEL", {"REPRESENTATION-CODE": USHORT, "UNITS": IDENT, "DIMENSION": UVARI},
                     {name: [b"\1" + bytes([FSINGL]), b"\1" + _ident(of), b"\1" + _number(n)]
                      for name, (of, n) in channels.items()}), 3),
        _record(_set("FRAME", {"CHANNELS": OBNAME, "INDEX-TYPE": IDENT},
                     {"F": [_number(len(channels)) + b"".join(map(_name, channels)),
                            b"\1" + _ident("BOREHOLE-DEPTH") if has_index else b""]}), 4),
    ]  # fmt: skip
    for row, z in enumerate(index):
        values = np.concatenate([[z], *(image[row] for image in images.values())]).astype(">f4")
        segments.append(_record(_name("F") + _number(row + 1) + values.tobytes(), 0, explicit=False))
    label = b"   1V1.00RECORD 8192" + b"drawn".ljust(60)
    path.write_bytes(label + b"".join(struct.pack(">HBB", 4 + len(one), 0xFF, 1) + one for one in segments))
    return path


def _record(body: bytes, kind: int, *, explicit: bool = True) -> bytes:
    """Return a record of one segment; bytes that fill it up end in their count."""
    fill = max(12 - len(body), len(body) % 2)
    fill += (len(body) + fill) % 2
    attributes = (0x80 if explicit else 0) | (1 if fill else 0)
    body += bytes([fill]) * fill
    return struct.pack(">HBB", 4 + len(body), attributes, kind) + body
