"""Mutations of PNG, JPEG and BMP that keep their form: chunks with their checksum, segments with their length."""

import struct
import zlib
from random import Random

from benchmarks.fuzz.raw import mutate_bytes
from benchmarks.fuzz.values import integer, packed

_PNG_CHUNKS = (
    b"IHDR", b"PLTE", b"IDAT", b"IEND", b"tRNS", b"gAMA", b"cHRM", b"sRGB", b"iCCP", b"tEXt", b"zTXt", b"iTXt", b"bKGD",
    b"pHYs", b"sBIT", b"sPLT", b"hIST", b"tIME", b"eXIf", b"acTL", b"fcTL", b"fdAT", b"cICP", b"mDCv", b"ABCD",
    b"\0\0\0\0",
)  # fmt: skip


def mutate_png(data: bytes, rng: Random) -> bytes:
    """Return a PNG with a chunk changed, gone, doubled or new; all checksums are right."""
    chunks = _chunks(data)
    if not chunks:
        return mutate_bytes(data, rng)
    at = 0 if rng.random() < 0.25 else rng.randrange(len(chunks))
    name, body = chunks[at]
    kind = rng.random()
    if name == b"IHDR" and kind < 0.8 and len(body) == 13:
        place, size = rng.choice(((0, 4), (4, 4), (8, 1), (9, 1), (10, 1), (11, 1), (12, 1)))
        lengths = (0, 1, 7, 30_000, 1 << 20, 1 << 31)
        likely = {8: (1, 2, 4, 8, 16), 9: (0, 2, 3, 4, 6), 12: (0, 1, 2)}.get(place, lengths)
        value = rng.choice(likely) if rng.random() < 0.8 else integer(rng)
        chunks[at] = name, body[:place] + packed(value, size, ">") + body[place + size :]
    elif name == b"IDAT" and kind < 0.5:
        chunks[at] = name, _other_pixels(body, rng)
    elif kind < 0.6:
        chunks[at] = name, mutate_bytes(body, rng)
    elif kind < 0.7:
        del chunks[at]
    elif kind < 0.78:
        chunks.insert(at, chunks[rng.randrange(len(chunks))])
    else:
        new = rng.choice(_PNG_CHUNKS)
        noise = rng.randbytes(rng.choice((1, 4, 8, 26, 32, 256, 768)))
        chunks.insert(at, (new, rng.choice((b"", noise, b"a\0\0" + zlib.compress(bytes(50_000))))))
    return data[:8] + b"".join(_chunk(*chunk) for chunk in chunks)


def _other_pixels(body: bytes, rng: Random) -> bytes:
    try:
        pixels = zlib.decompress(body)
    except zlib.error:
        return mutate_bytes(body, rng)
    others = (mutate_bytes(pixels, rng), b"", pixels * 2, bytes(1_000_000), b"\x05" * len(pixels))
    return zlib.compress(rng.choice(others))


def _chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    found, at = [], 8
    while data[:4] == b"\x89PNG" and at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def mutate_jpeg(data: bytes, rng: Random) -> bytes:
    """Return a JPEG with a segment changed, gone, doubled or new."""
    segments, rest = _segments(data)
    if not segments:
        return mutate_bytes(data, rng)
    at = rng.randrange(len(segments))
    marker, body = segments[at]
    kind = rng.random()
    if 0xC0 <= marker <= 0xCF and marker != 0xC4 and kind < 0.6 and len(body) > 6:
        place, size = rng.choice(((0, 1), (1, 2), (3, 2), (5, 1), (6, 1), (7, 1)))
        segments[at] = marker, body[:place] + packed(integer(rng), size, ">") + body[place + size :]
    elif kind < 0.4:
        segments[at] = marker, mutate_bytes(body, rng)
    elif kind < 0.55:
        del segments[at]
    elif kind < 0.65:
        segments.insert(at, segments[at])
    elif kind < 0.75:
        segments[at] = rng.choice((0xC0, 0xC1, 0xC2, 0xC3, 0xC9, 0xDD, 0xDB, 0xC4, 0xE1, 0xEE, 0xFE)), body
    elif kind < 0.85:
        exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0" + packed(rng.randrange(12), 4, "<") + bytes(4)
        segments.insert(0, (0xE1, mutate_bytes(exif, rng) if rng.random() < 0.5 else exif))
    else:
        rest = mutate_bytes(rest, rng)
    return b"\xff\xd8" + b"".join(_segment(*one) for one in segments) + rest


def _segments(data: bytes) -> tuple[list[tuple[int, bytes]], bytes]:
    """Return the segments up to the start of the scan, and all from there on."""
    found, at = [], 2
    while data[:2] == b"\xff\xd8" and at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        (length,) = struct.unpack_from(">H", data, at + 2)
        found.append((data[at + 1], data[at + 4 : at + 2 + length]))
        at += 2 + max(length, 2)
    return found, data[at:]


def _segment(marker: int, body: bytes) -> bytes:
    return bytes((0xFF, marker)) + struct.pack(">H", min(len(body) + 2, 65535)) + body


_BMP_FIELDS = (
    (2, 4), (10, 4), (14, 4), (18, 4), (22, 4), (26, 2), (28, 2), (30, 4), (34, 4), (46, 4), (50, 4), (54, 4),
)  # fmt: skip


def mutate_bmp(data: bytes, rng: Random) -> bytes:
    """Return a BMP with a field of its headers changed."""
    at, size = rng.choice(_BMP_FIELDS)
    likely = {28: (1, 4, 8, 15, 16, 24, 32, 0), 30: (0, 1, 2, 3, 4, 5, 6), 14: (12, 40, 52, 56, 64, 108, 124)}
    value = rng.choice(likely.get(at, (0, 1))) if rng.random() < 0.5 else integer(rng)
    return data[:at] + packed(value, size, "<") + data[at + size :]
