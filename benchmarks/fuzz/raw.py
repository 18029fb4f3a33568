"""Mutations of bytes of which nothing is known."""

import re
from random import Random

from benchmarks.fuzz.values import integer, packed

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")


def mutate_bytes(data: bytes, rng: Random) -> bytes:
    """Return ``data`` with one damage."""
    if not data:
        return rng.randbytes(rng.choice((1, 4, 64)))
    return rng.choice(_DAMAGES)(data, rng)


def splice(data: bytes, other: bytes, rng: Random) -> bytes:
    """Return the beginning of one file and the end of another, or a block of the other in the one."""
    if not data or not other:
        return data or other
    if rng.random() < 0.5:
        return data[: _place(data, rng)] + other[_place(other, rng) :]
    at, begin = _place(data, rng), _place(other, rng)
    block = other[begin : begin + _length(other, rng)]
    return data[:at] + block + data[at + len(block) :]


def _place(data: bytes, rng: Random) -> int:
    """Return a place in ``data``; headers are hit more often than what follows."""
    return rng.randrange(min(len(data), 128)) if rng.random() < 0.4 else rng.randrange(len(data))


def _length(data: bytes, rng: Random) -> int:
    return rng.randint(1, max(1, min(len(data), rng.choice((4, 16, 64, 512)))))


def _flip_bits(data: bytes, rng: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        changed[_place(data, rng)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _set_bytes(data: bytes, rng: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        changed[_place(data, rng)] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, 0x20, rng.randrange(256)))
    return bytes(changed)


def _truncate(data: bytes, rng: Random) -> bytes:
    return data[: rng.choice((_place(data, rng), len(data) - min(len(data), rng.randint(1, 16))))]


def _behead(data: bytes, rng: Random) -> bytes:
    return data[_length(data, rng) :]


def _insert(data: bytes, rng: Random) -> bytes:
    at, count = _place(data, rng), rng.choice((1, 2, 3, 4, 8, 100, 5000))
    more = rng.choice((bytes(count), b"\xff" * count, rng.randbytes(count), b"\n", b'"', b"[" * count, b"\xef\xbb\xbf"))
    return data[:at] + more + data[at:]


def _remove(data: bytes, rng: Random) -> bytes:
    at = _place(data, rng)
    return data[:at] + data[at + _length(data, rng) :]


def _duplicate(data: bytes, rng: Random) -> bytes:
    at = _place(data, rng)
    block = data[at : at + _length(data, rng)]
    return data[:at] + block * rng.choice((2, 2, 3, 50)) + data[at + len(block) :]


def _move(data: bytes, rng: Random) -> bytes:
    at, to = _place(data, rng), _place(data, rng)
    block = data[at : at + _length(data, rng)]
    return data[:to] + block + data[to + len(block) :]


def _zero(data: bytes, rng: Random) -> bytes:
    at, count = _place(data, rng), _length(data, rng)
    return data[:at] + rng.choice((b"\0", b"\xff")) * len(data[at : at + count]) + data[at + count :]


def _set_integer(data: bytes, rng: Random) -> bytes:
    size = rng.choice((1, 2, 2, 4, 4, 4, 8))
    at = _place(data, rng)
    if rng.random() < 0.7:
        at -= at % min(size, 4)
    return data[:at] + packed(integer(rng), size, rng.choice("<>")) + data[at + size :]


def _set_number_in_text(data: bytes, rng: Random) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return _set_integer(data, rng)
    at = rng.choice(found)
    text = rng.choice((str(integer(rng)), "nan", "inf", "-inf", "1e308", "-0", "1" * 5000, "0.1", "1e-9", ""))
    return data[: at.start()] + text.encode() + data[at.end() :]


def _append(data: bytes, rng: Random) -> bytes:
    return data + rng.choice((b"\0", rng.randbytes(rng.randint(1, 64)), data))


_DAMAGES = (
    _flip_bits, _flip_bits, _set_bytes, _set_bytes, _truncate, _behead, _insert, _remove, _duplicate, _move, _zero,
    _set_integer, _set_integer, _set_integer, _set_number_in_text, _append,
)  # fmt: skip
