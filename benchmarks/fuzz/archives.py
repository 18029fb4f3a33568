"""Mutations of zip and tar archives, and of what lies in them; the checksums are those of what is there."""

import io
import tarfile
import warnings
import zipfile
from collections.abc import Callable
from functools import cache
from random import Random

from benchmarks.fuzz.raw import mutate_bytes
from benchmarks.fuzz.values import integer, packed

Mutate = Callable[[str, bytes, Random], bytes]
Member = tuple[str, bytes]

_NAMES = (
    "../outside.roi", "/etc/passwd", "a/../../b.roi", "C:\\x.roi", "", "a" * 300, "é.roi", "a\nb.roi", ".roi", "x.txt",
    "overlay.zip", "image.npy", "metadata.npy", "curve_0.npy", "curve_999999.npy", "x.ROI", "folder/", "000000.oct.npy",
    "Header.xml", "data\\Chirp.data", "data/Spectral1.data", "data\\Intensity.data",
)  # fmt: skip
_DATE = (1980, 1, 1, 0, 0, 0)


def zipped(members: list[Member], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return a zip archive, the same for the same members."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names that stand in it twice
        for name, data in members:
            info = zipfile.ZipInfo(name or "empty", _DATE)
            info.compress_type = compression
            archive.writestr(info, data)
    return buffer.getvalue()


def tarred(members: list[Member]) -> bytes:
    """Return a tar archive, the same for the same members."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name, data in members:
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return buffer.getvalue()


LARGEST = 200_000
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
_TAR_FIELDS = ((0, 100), (100, 8), (108, 8), (124, 12), (136, 12), (156, 1), (157, 100), (257, 8), (345, 155))
_TAR_TEXTS = (b"-1", b"../x", b"1", b"2", b"S", b"x", b"L")


def mutate_zip(data: bytes, rng: Random, inner: Mutate) -> bytes:
    """Return an archive with a member changed by ``inner``, renamed, gone, doubled, or with a record changed."""
    kind = rng.random()
    if kind < 0.25 or len(data) > LARGEST:  # what is a bomb already is not set off here
        return _with_record(data, rng)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    except Exception:  # noqa: BLE001  an archive that was damaged before
        return mutate_bytes(data, rng)
    if kind < 0.255 and members:
        first = members[0][0]
        return _bomb(
            "image.npy" if first.endswith(".npy") else "Header.xml" if first.startswith("data") else "0001.roi"
        )
    return zipped(_members(members, rng, inner), rng.choice(_METHODS))


def mutate_tar(data: bytes, rng: Random, inner: Mutate) -> bytes:
    """Return an archive with a member changed by ``inner``, renamed, gone, doubled, or with a header changed."""
    if rng.random() < 0.3:
        at = 512 * rng.randrange(max(1, len(data) // 512))
        place, size = rng.choice(_TAR_FIELDS)
        text = rng.choice((b"\xff" * size, b"7" * size, b"\x80" + b"\xff" * (size - 1), b"\0" * size, *_TAR_TEXTS))
        changed = data[: at + place] + text[:size].ljust(size, b"\0") + data[at + place + size :]
        head = bytearray(changed[at : at + 512])
        head[148:156] = b" " * 8
        return changed[: at + 148] + b"%06o\0 " % (sum(head) % 0o1000000) + changed[at + 156 :]
    try:
        with tarfile.open(fileobj=io.BytesIO(data)) as archive:
            members = [(m.name, file.read()) for m in archive if (file := archive.extractfile(m)) is not None]
    except Exception:  # noqa: BLE001
        return mutate_bytes(data, rng)
    return tarred(_members(members, rng, inner))


def _members(members: list[Member], rng: Random, inner: Mutate) -> list[Member]:
    at = rng.randrange(len(members)) if members else 0
    kind = rng.random()
    if not members or kind < 0.05:
        return [*members, (rng.choice(_NAMES), rng.randbytes(rng.choice((0, 1, 64))))]
    name, data = members[at]
    if kind < 0.65:
        members[at] = name, inner(name, data, rng)
    elif kind < 0.78:
        members[at] = rng.choice((*_NAMES, rng.choice(members)[0])), data
    elif kind < 0.86:
        del members[at]
    elif kind < 0.94:
        members += [members[at]] * rng.choice((1, 1, 3, 40))
    else:
        members[at] = name, rng.choice(members)[1]
    return members


_LOCAL = ((4, 2), (6, 2), (8, 2), (14, 4), (18, 4), (22, 4), (26, 2), (28, 2))
_CENTRAL = ((6, 2), (8, 2), (10, 2), (16, 4), (20, 4), (24, 4), (28, 2), (30, 2), (32, 2), (34, 2), (42, 4))
_END = ((4, 2), (8, 2), (10, 2), (12, 4), (16, 4), (20, 2))


def _with_record(data: bytes, rng: Random) -> bytes:
    """Return an archive with a number of one of its records changed: flags, methods, sizes, places."""
    sign, fields = rng.choice(((b"PK\3\4", _LOCAL), (b"PK\1\2", _CENTRAL), (b"PK\5\6", _END)))
    at = data.find(sign)
    if at < 0:
        return mutate_bytes(data, rng)
    place, size = rng.choice(fields)
    likely = (0, 1, 8, 9, 12, 14, 93, 95, 97, 99, 0xFFFF, 0x41) if size == 2 else (0, 0xFFFFFFFF, 0x7FFFFFFF)
    value = rng.choice(likely) if rng.random() < 0.6 else integer(rng)
    return data[: at + place] + packed(value, size, "<") + data[at + place + size :]


@cache
def _bomb(name: str) -> bytes:
    """Return a small archive whose one member has 1.6 GB of zeros."""
    buffer = io.BytesIO()
    info = zipfile.ZipInfo(name, _DATE)
    info.compress_type = zipfile.ZIP_DEFLATED
    with zipfile.ZipFile(buffer, "w", compresslevel=1) as archive, archive.open(info, "w") as member:
        zeros = bytes(16_000_000)
        for _ in range(100):
            member.write(zeros)
    return buffer.getvalue()
