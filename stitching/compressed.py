"""How much compressed bytes expand to, known before they are expanded.

Chunks and the like come from files: one of a kilobyte may state, or hold, gigabytes.
"""

import gzip
import io
import struct
import zlib
from collections.abc import Callable, Mapping

from endoct.stitching.errors import refusing

_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_RAW, _REPEATED, _COMPRESSED = range(3)
_PIECE = 1 << 20


def expanded_bytes(data: bytes, codec: str, most: int, what: str) -> int:
    """Return how many bytes ``data`` expands to, any number above ``most`` where it is more than that.

    ``codec`` is zstd, blosc, lz4, gzip or zlib, framed as Zarr has them. Takes no more than about ``most`` bytes of
    memory. Raises :class:`EndoctError`, naming ``what``, where ``data`` is no such stream.
    """
    with refusing(f"{what} is not compressed with {codec}, or damaged"):
        return _CODECS[codec](data, most)


def _zstd(data: bytes, most: int) -> int:
    stated = _stated_zstd(data)
    return _expanded_zstd(data, most) if stated is None else stated


def _stated_zstd(data: bytes) -> int | None:
    """Return the size that the only frame of ``data`` states (RFC 8878), None where it states none or others follow."""
    if data[:4] != _ZSTD_MAGIC:
        raise ValueError("another beginning")
    flags = data[4]
    single, checksum = bool(flags & 0x20), bool(flags & 0x04)
    place = 5 + (0 if single else 1) + (0, 1, 2, 4)[flags & 3]
    width = (1 if single else 0, 2, 4, 8)[flags >> 6]
    stated = int.from_bytes(data[place : place + width], "little") + (256 if width == 2 else 0)
    place += width
    last = False
    while not last:
        if place + 3 > len(data):
            raise ValueError("cut off")
        header = int.from_bytes(data[place : place + 3], "little")
        last, kind, size = bool(header & 1), header >> 1 & 3, header >> 3
        if kind not in (_RAW, _REPEATED, _COMPRESSED):
            raise ValueError("damaged")
        place += 3 + (1 if kind == _REPEATED else size)
    return stated if width and place + 4 * checksum == len(data) else None


def _expanded_zstd(data: bytes, most: int) -> int:
    import imagecodecs

    try:
        return len(imagecodecs.zstd_decode(data, out=bytearray(most)))
    except imagecodecs.ZstdError as error:
        if "too small" not in str(error):
            raise
        return most + 1


def _blosc(data: bytes, _most: int) -> int:
    n_bytes, block, n_compressed = struct.unpack_from("<III", data, 4)
    if n_compressed != len(data) or block > max(n_bytes, 1):
        raise ValueError("its header does not fit it")
    return int(n_bytes)


def _lz4(data: bytes, _most: int) -> int:
    return int(struct.unpack_from("<I", data)[0])


def _gzip(data: bytes, most: int) -> int:
    total = 0
    with gzip.open(io.BytesIO(data)) as file:
        while total <= most and (piece := file.read(_PIECE)):
            total += len(piece)
    return total


def _zlib(data: bytes, most: int) -> int:
    stream, total = zlib.decompressobj(), 0
    while total <= most and not stream.eof:
        piece = stream.decompress(data, _PIECE)
        data = stream.unconsumed_tail
        total += len(piece)
        if not piece and not data and not stream.eof:
            raise ValueError("cut off")
    return total


_CODECS: Mapping[str, Callable[[bytes, int], int]] = {
    "zstd": _zstd,
    "blosc": _blosc,
    "lz4": _lz4,
    "gzip": _gzip,
    "zlib": _zlib,
}
COMPRESSORS = frozenset(_CODECS)
