"""A gzip file written as a stream, with a comment in its header, where a mark can be put in when all is written."""

import struct
import zlib
from typing import BinaryIO

FASTEST = 1


class GzipStream:
    """Compresses what it is given into an open file."""

    def __init__(self, file: BinaryIO, comment: str = "") -> None:
        self._file = file
        self._deflate = zlib.compressobj(FASTEST, zlib.DEFLATED, -zlib.MAX_WBITS)
        self._crc, self._size = 0, 0
        has_comment, no_time, unknown_system = 0x10 if comment else 0, 0, 255
        file.write(struct.pack("<BBBBIBB", 0x1F, 0x8B, 8, has_comment, no_time, 0, unknown_system))
        if comment:
            file.write(comment.encode("latin-1") + b"\0")

    def write(self, data: bytes) -> None:
        """Compress ``data``."""
        self._crc, self._size = zlib.crc32(data, self._crc), self._size + len(data)
        self._file.write(self._deflate.compress(data))

    def finish(self) -> None:
        """Write what is left, and the sums."""
        self._file.write(self._deflate.flush() + struct.pack("<II", self._crc, self._size & 0xFFFFFFFF))
