"""Mutations of videos that keep their form: boxes of MP4 and QuickTime, elements of Matroska, chunks of AVI."""

from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

from benchmarks.fuzz.raw import mutate_bytes
from benchmarks.fuzz.values import integer, packed

_MP4_HOLDERS = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts", b"udta", b"mvex", b"moof", b"traf", b"dinf")
_EBML_HOLDERS = (
    0x18538067, 0x1654AE6B, 0xAE, 0xE0, 0x1549A966, 0x1F43B675, 0x114D9B74, 0x4DBB, 0x1C53BB6B, 0xBB, 0xB7, 0xA0,
)  # fmt: skip
_FOURS = (
    b"mdat", b"moov", b"free", b"stts", b"stsz", b"stco", b"co64", b"ctts", b"stss", b"elst", b"strf", b"idx1", b"00dc",
    b"JUNK",
)  # fmt: skip


@dataclass
class Box:
    """A part of a file: its name, and either bytes or further parts (after ``data``)."""

    name: bytes
    data: bytes
    parts: list["Box"] = field(default_factory=list)


def mutate_video(data: bytes, rng: Random) -> bytes:
    """Return a video with a part changed, gone, doubled, renamed or moved; sizes are those of what is there."""
    if data[4:8] in (b"ftyp", b"moov", b"wide", b"mdat", b"free"):
        return _mutated(_boxes(data), rng, _joined_boxes)
    if data[:4] == b"\x1a\x45\xdf\xa3":
        return _mutated(_elements(data), rng, _joined_elements)
    if data[:4] == b"RIFF":
        return _mutated(_riff(data), rng, _joined_riff)
    return mutate_bytes(data, rng)


def _mutated(root: list[Box], rng: Random, joined: Callable[[list[Box]], bytes]) -> bytes:
    holders = list(_holders(root))
    parts = rng.choice([one for one in holders if one] or [root])
    if not parts:
        return b""
    at = rng.randrange(len(parts))
    box = parts[at]
    kind = rng.random()
    if kind < 0.25:
        box.data = mutate_bytes(box.data, rng)
    elif kind < 0.65:
        box.data = _with_integer(box.data, rng)
    elif kind < 0.75:
        del parts[at]
    elif kind < 0.82:
        parts.insert(at, box)
    elif kind < 0.87:
        box.name = rng.choice(_FOURS) if len(box.name) == 4 else rng.choice([one.name for one in parts])
    elif kind < 0.92:
        parts[at] = rng.choice(rng.choice([one for one in holders if one]))
    elif kind < 0.96:
        rng.shuffle(parts)
    else:
        box.data, box.parts = b"", []
    try:
        return joined(root)
    except RecursionError:  # a part was put into itself
        return b""


def _with_integer(data: bytes, rng: Random) -> bytes:
    """Return a part's bytes with one number of it changed; short ones are one number."""
    if 0 < len(data) <= 8 and rng.random() < 0.7:
        return packed(integer(rng), len(data), ">")
    size = rng.choice((1, 2, 4, 4, 8))
    at = rng.randrange(max(1, min(len(data), 120) - size + 1))
    at -= at % rng.choice((1, size))
    return data[:at] + packed(integer(rng), size, rng.choice("<>")) + data[at + size :]


def _holders(parts: list[Box]) -> "list[list[Box]]":
    found = [parts]
    for part in parts:
        if part.parts:
            found += _holders(part.parts)
    return found


def _boxes(data: bytes) -> list[Box]:
    found, at = [], 0
    while at + 8 <= len(data):
        size, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + size if size >= 8 else len(data)
        body = data[at + 8 : end]
        found.append(Box(name, b"", _boxes(body)) if name in _MP4_HOLDERS else Box(name, body))
        at = end
    return found


def _joined_boxes(boxes: list[Box]) -> bytes:
    whole = b""
    for box in boxes:
        body = box.data + _joined_boxes(box.parts)
        whole += packed(len(body) + 8, 4, ">") + box.name[:4].ljust(4) + body
    return whole


def _elements(data: bytes) -> list[Box]:
    found, at = [], 0
    while at < len(data):
        id_length = 9 - data[at].bit_length()
        name = data[at : at + id_length]
        at += id_length
        if id_length > 4 or at >= len(data) or not data[at]:
            break
        length = 9 - data[at].bit_length()
        size = int.from_bytes(data[at : at + length], "big") & ((1 << 7 * length) - 1)
        end = len(data) if size == (1 << 7 * length) - 1 else at + length + size
        body = data[at + length : end]
        holds = int.from_bytes(name, "big") in _EBML_HOLDERS
        found.append(Box(name, b"", _elements(body)) if holds else Box(name, body))
        at = end
    return found


def _joined_elements(elements: list[Box]) -> bytes:
    whole = b""
    for element in elements:
        body = element.data + _joined_elements(element.parts)
        whole += element.name + packed(len(body) | 1 << 56, 8, ">") + body
    return whole


def _riff(data: bytes) -> list[Box]:
    found, at = [], 0
    while at + 8 <= len(data):
        name, size = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
        body = data[at + 8 : at + 8 + size]
        holds = name in (b"RIFF", b"LIST")
        found.append(Box(name, body[:4], _riff(body[4:])) if holds else Box(name, body))
        at += 8 + size + size % 2
    return found


def _joined_riff(chunks: list[Box]) -> bytes:
    whole = b""
    for chunk in chunks:
        body = chunk.data + _joined_riff(chunk.parts)
        whole += chunk.name[:4].ljust(4) + packed(len(body), 4, "<") + body + b"\0" * (len(body) % 2)
    return whole
