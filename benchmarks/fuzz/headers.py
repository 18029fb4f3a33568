"""Mutations of headers of volumes that keep their form: lines of text before voxels, and elements of DICOM."""

import re
import struct
from random import Random

from benchmarks.fuzz.raw import mutate_bytes
from benchmarks.fuzz.values import integer, packed

_VALUES = (
    "nan", "inf", "-1", "0", "none", "999", "1e308", "LIST", "/etc/passwd", "../x", "LOCAL", "true", "(0,0,0)", "",
    "(nan,0,0)", "block", "MET_FLOAT", "4294967297", "gzip", "raw", "bzip2", "left-anterior-superior", "um",
)  # fmt: skip
_LONG = (b"OB", b"OW", b"OF", b"SQ", b"UT", b"UN", b"UC", b"UR", b"OD", b"OL", b"OV", b"SV", b"UV")


def mutate_lines(data: bytes, rng: Random) -> bytes:
    """Return a header of lines "key = value" or "field: value", with a line changed, gone, doubled or moved."""
    end = min(len(data), max(data.find(b"\n\n") + 1, data.find(b"ElementDataFile"), 60) + 40)
    lines = data[:end].split(b"\n")
    at = rng.randrange(len(lines))
    kind = rng.random()
    if kind < 0.6:
        key, sign, value = re.match(rb"([^:=]*)([:=]*)(.*)", lines[at], re.DOTALL).groups()  # type: ignore[union-attr]
        parts = value.split()
        if parts and rng.random() < 0.7:
            parts[rng.randrange(len(parts))] = _value(rng)
            value = b" ".join(parts)
        else:
            value = _value(rng)
        lines[at] = key + sign + b" " + value
    elif kind < 0.75:
        del lines[at]
    elif kind < 0.85:
        lines.insert(rng.randrange(len(lines)), lines[at])
    else:
        lines[at] = mutate_bytes(lines[at], rng)
    return b"\n".join(lines) + data[end:]


def _value(rng: Random) -> bytes:
    return (rng.choice(_VALUES) if rng.random() < 0.7 else str(integer(rng))).encode()


def mutate_dicom(data: bytes, rng: Random) -> bytes:
    """Return DICOM (explicit, little endian) with an element's value, length or tag changed, or an element gone."""
    elements = list(_elements(data))
    if not elements:
        return mutate_bytes(data, rng)
    begin, value, end, wide = rng.choice(elements)
    kind = rng.random()
    if kind < 0.35:
        inside = data[value:end]
        texts = (b"nan", b"-1", b"0", b"1\\2", b"9" * 20, b"1e400", b"")
        new = mutate_bytes(inside, rng) if inside and rng.random() < 0.6 else rng.choice(texts)
        new += b" " * (len(new) % 2)
        length = struct.pack("<I", len(new)) if wide else struct.pack("<H", len(new) & 0xFFFF)
        return data[: value - len(length)] + length + new + data[end:]
    if kind < 0.6:
        size = 4 if wide else 2
        length = packed(rng.choice((0xFFFFFFFF, 0x7FFFFFFF, 0xFFFE, 0, integer(rng))), size, "<")
        return data[: value - size] + length + data[value:]
    if kind < 0.75:
        return data[:begin] + data[end:]
    if kind < 0.85:
        return data[:begin] + data[begin:end] * 2 + data[end:]
    return (
        data[:begin] + rng.choice((rng.randbytes(4), b"\xfe\xff\x00\xe0", data[begin : begin + 4])) + data[begin + 4 :]
    )


def _elements(data: bytes) -> list[tuple[int, int, int, bool]]:
    """Return begin, begin of the value, end, and whether its length has four bytes, of the elements at the top."""
    found, at = [], 132
    while at + 8 <= len(data):
        wide = data[at + 4 : at + 6] in _LONG
        value = at + (12 if wide else 8)
        length = (
            int.from_bytes(data[at + 8 : at + 12], "little")
            if wide
            else int.from_bytes(data[at + 6 : at + 8], "little")
        )
        end = value + length
        if end > len(data):
            return found
        found.append((at, value, end, wide))
        at = end
    return found
