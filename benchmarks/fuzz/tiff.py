"""Mutations of TIFF and BigTIFF: their directories are taken apart, changed and put together again."""

import struct
from dataclasses import dataclass
from random import Random

from benchmarks.fuzz.values import integer, packed

_TAGS = (
    254, 255, 256, 257, 258, 259, 262, 266, 270, 271, 272, 273, 274, 277, 278, 279, 280, 281, 282, 283, 284, 285, 291,
    292, 296, 297, 305, 306, 315, 316, 317, 318, 320, 322, 323, 324, 325, 330, 333, 337, 338, 339, 340, 341, 347, 400,
    512, 513, 514, 529, 530, 531, 532, 700, 32781, 32932, 32995, 32996, 32997, 32998, 33421, 33422, 33432, 33471, 33550,
    33560, 33628, 33629, 33630, 33631, 33723, 33922, 34118, 34264, 34361, 34362, 34377, 34412, 34665, 34735, 34736,
    34737, 34853, 37500, 37701, 37706, 37724, 40001, 40976, 41485, 41729, 42112, 42113, 43314, 48121, 48122, 50288,
    50296, 50341, 50648, 50649, 50655, 50838, 50839, 51023, 51123, 65027, 65160, 65200, 65324, 65325, 65326, 65420,
    65421, 65422, 65426, 65427, 65441, 65449, 65457, 65531, 65563,
)  # fmt: skip
"""Those of the standard, and by which tifffile knows makers: LSM, STK, NDPI, FluoView, Andor, SEM, MetaSeries, …"""
_USUAL = (254, 256, 257, 258, 259, 262, 270, 273, 277, 278, 279, 284, 305, 317, 322, 323, 324, 325, 330, 338, 339, 347)
_COMPRESSIONS = (
    1, 2, 3, 4, 5, 6, 7, 8, 32771, 32773, 32809, 32895, 32946, 33003, 33005, 33007, 34676, 34677, 34712, 34713, 34887,
    34892, 34925, 34926, 34927, 34933, 34934, 50000, 50001, 50002, 65000, 0, 99999,
)  # fmt: skip
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
_TEXTS = (
    b"ImageJ=1.53t\nimages=1000000\nslices=1000000\nloop=false\n\0",
    b"ImageJ=1.53t\nimages=3\nframes=-3\nhyperstack=true\nmode=grayscale\n\0",
    b"ImageJ=\nimages=nan\n\0",
    b'{"shape": [3, 6, 8]}\0',
    b'{"shape": [0, 6, 8]}\0',
    b'{"shape": [9223372036854775807, 6, 8]}\0',
    b'{"shape": "x", "axes": 3}\0',
    b'{"shape": [-1, 6, 8], "axes": "ZYX", "truncated": true}\0',
    b'{"shape": [1000, 6, 8], "truncated": true}\0',
    b"shape=(3, 6, 8)\0",
    b"shape=(" + b"9" * 5000 + b",)\0",
    b'{"shape": ' + b"[" * 3000 + b"\0",
    b'<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="I"><Pixels '
    b'ID="P" DimensionOrder="XYZCT" Type="uint8" SizeX="8" SizeY="6" SizeZ="3" SizeC="1" SizeT="1"><TiffData/>'
    b"</Pixels></Image></OME>\0",
    b'<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="I"><Pixels '
    b'ID="P" DimensionOrder="XYZCT" Type="float128" SizeX="-8" SizeY="6" SizeZ="99999999" SizeC="1" SizeT="1">'
    b'<TiffData IFD="5"><UUID FileName="../../etc/passwd">urn:uuid:1</UUID></TiffData></Pixels></Image></OME>\0',
    b'<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><OME>&b;</OME>\0',
    b"Aperio Image Library v1\r\n8x6 |AppMag = 20\0",
    b"<MetaData><PlaneInfo><prop id='x'/></PlaneInfo></MetaData>\0",
    b"SCANIMAGE.SI.x = 1\0",
    b"shape\0",
    b"{}\0",
    b"\0" * 4096,
)
_SOFTWARE = (b"MetaMorph\0", b"Ventana\0", b"SI.LINE = 1\0", b"tifffile.py\0", b"Hamamatsu\0", b"Micro-Manager\0")


_PLACE = b"@PLACE@@"


@dataclass
class _Field:
    """An entry of a directory: its value, or the place of it, as bytes."""

    tag: int
    kind: int
    count: int
    value: bytes


@dataclass
class _Form:
    """How a file writes: byte order, and the formats of BigTIFF or of the old form."""

    order: str
    big: bool

    @property
    def width(self) -> int:
        return 8 if self.big else 4


def mutate_tiff(data: bytes, rng: Random) -> bytes:
    """Return a TIFF of which one directory says something else."""
    form = _Form("<" if data[:2] == b"II" else ">", data[2:4] in (b"+\0", b"\0+"))
    places = _directories(data, form)
    if not places:
        return data[:4] + packed(integer(rng), 4, form.order) + data[8:]
    which = rng.randrange(len(places)) if rng.random() < 0.5 else 0
    place, link = places[which]
    read = _directory(data, form, place)
    if read is None:
        return data[: place + 1]
    fields, following = read
    kind = rng.random()
    if kind < 0.1:
        target = rng.choice((0, place, places[0][0], len(data), len(data) + 1, integer(rng), place + 1, 8))
        where = link if rng.random() < 0.3 else place + (8 if form.big else 2) + len(fields) * (20 if form.big else 12)
        return data[:where] + packed(target, form.width, form.order) + data[where + form.width :]
    if kind < 0.15:
        size = 8 if form.big else 2
        count = rng.choice((0, 1, len(fields) + 1, integer(rng)))
        return data[:place] + packed(count, size, form.order) + data[place + size :]
    extra = _change(fields, form, rng)
    fields.sort(key=lambda field: field.tag if rng.random() < 0.98 else rng.random())
    # the changed directory goes to the end, and what led to the old one leads there
    start = len(data) + len(data) % 2
    body = _packed_directory(fields, following, form)
    changed = data[:link] + packed(start, form.width, form.order) + data[link + form.width :]
    body = body.replace(_PLACE[: form.width], packed(start + len(body), form.width, form.order))
    return changed + b"\0" * (len(data) % 2) + body + extra


def _change(fields: list[_Field], form: _Form, rng: Random) -> bytes:
    """Change one entry or two; return what is to lie behind the directory, where ``_PLACE`` will lead."""
    extra = b""
    for _ in range(rng.choice((1, 1, 2, 3))):
        kind = rng.random()
        field = rng.choice(fields) if fields else _Field(256, 3, 1, packed(1, form.width, form.order))
        if kind < 0.35:
            field.value = packed(_value_for(field.tag, rng), min(_SIZES.get(field.kind, 4), form.width), form.order)
        elif kind < 0.45:
            field.count = rng.choice((0, 1, 2, field.count + 1, abs(integer(rng))))
        elif kind < 0.53:
            field.kind = rng.choice((*_SIZES, 0, 14, 15, 255, 65535))
        elif kind < 0.60:
            field.tag = rng.choice(_TAGS)
        elif kind < 0.66 and fields:
            fields.remove(field)
        elif kind < 0.70:
            fields.append(_Field(field.tag, field.kind, field.count, field.value))
        elif kind < 0.85:
            extra = rng.choice(_TEXTS) if rng.random() < 0.8 else rng.choice(_SOFTWARE)
            tag = rng.choice((270, 270, 270, 305)) if rng.random() < 0.8 else rng.choice(_TAGS)
            fields[:] = [one for one in fields if one.tag != tag]
            fields.append(_Field(tag, rng.choice((2, 2, 7, 1)), len(extra), _PLACE[: form.width]))
        else:
            tag, kind_of = rng.choice(_USUAL if rng.random() < 0.5 else _TAGS), rng.choice((1, 3, 4, 5, 7, 12, 13, 16))
            count = rng.choice((1, 1, 2, 3, 100))
            value = packed(_value_for(tag, rng), form.width, form.order)
            fields[:] = [one for one in fields if one.tag != tag]
            fields.append(_Field(tag, kind_of, count, value))
    return extra


def _value_for(tag: int, rng: Random) -> int:
    likely = {
        258: (0, 1, 2, 4, 8, 10, 12, 16, 24, 32, 64, 128), 259: _COMPRESSIONS,
        262: (0, 1, 2, 3, 4, 5, 6, 8, 32803, 34892),
        277: (0, 1, 2, 3, 4, 5, 100), 284: (0, 1, 2, 3), 317: (0, 1, 2, 3, 34892, 34894), 339: (0, 1, 2, 3, 4, 5, 6),
        254: (0, 1, 2, 4, 5), 266: (0, 1, 2), 338: (0, 1, 2, 3, 999), 256: (0, 1, 7, 9, 1 << 20, 1 << 31),
        257: (0, 1, 5, 7, 1 << 20, 1 << 31), 322: (0, 1, 15, 16, 1 << 20), 323: (0, 1, 15, 16, 1 << 20),
        278: (0, 1, 5, 7, 1 << 31),
    }  # fmt: skip
    return rng.choice(likely[tag]) if tag in likely and rng.random() < 0.75 else integer(rng)


def _directories(data: bytes, form: _Form) -> list[tuple[int, int]]:
    """Return the place of every directory and that of the offset that leads there."""
    found: list[tuple[int, int]] = []
    link = 8 if form.big else 4
    while len(found) < 20:
        place = int.from_bytes(data[link : link + form.width], "little" if form.order == "<" else "big")
        read = _directory(data, form, place)
        if place < 8 or read is None or place in [one for one, _ in found]:
            break
        found.append((place, link))
        link = place + (8 if form.big else 2) + len(read[0]) * (20 if form.big else 12)
    return found


def _directory(data: bytes, form: _Form, place: int) -> tuple[list[_Field], bytes] | None:
    """Return the entries of a directory and the offset behind them."""
    head, entry = ("Q", "HHQ8s") if form.big else ("H", "HHI4s")
    try:
        (count,) = struct.unpack_from(form.order + head, data, place)
        size = 20 if form.big else 12
        start = place + struct.calcsize(form.order + head)
        if count > 200:
            return None
        fields = [_Field(*struct.unpack_from(form.order + entry, data, start + k * size)) for k in range(count)]
    except struct.error:
        return None
    return fields, data[start + count * size : start + count * size + form.width]


def _packed_directory(fields: list[_Field], following: bytes, form: _Form) -> bytes:
    head, entry = ("Q", "HHQ8s") if form.big else ("H", "HHI4s")
    most = (1 << 8 * form.width) - 1
    packed_fields = b"".join(
        struct.pack(
            form.order + entry, one.tag % 65536, one.kind % 65536, min(one.count, most), one.value[: form.width]
        )
        for one in fields
    )
    return struct.pack(form.order + head, len(fields)) + packed_fields + following
