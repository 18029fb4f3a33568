"""Files within a ZIP file, read where they lie: none of their names becomes a path, and none is unpacked to disk.

A member that is stored without compression is read in parts, by its place. A compressed one is unpacked in memory,
within the size that the list of members states, and held for the parts that are read next.
"""

import functools
import struct
import threading
import zipfile
import zlib
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

from endoct.base.errors import EndoctError, refusing
from endoct.base.files.files import BLOCK_BYTES, check_array_size, open_regular, state_of

ZIP_START = b"PK\3\4"
MOST_LIST_BYTES = 8_000_000
"""The list of members, which is read whole, may have this many bytes: some 100 000 of them."""
COPY = "copy it again"
_END, _END_64, _LOCATOR_BYTES = struct.Struct("<4s4H2LH"), struct.Struct("<4sQ2H2L4Q"), 20
_LOCAL = struct.Struct("<4s5H3L2H")
_ENCRYPTED = 1
_INFLATING = threading.Lock()


@dataclass(frozen=True)
class Member:
    """A file within the ZIP file ``archive``; ``n_bytes`` of it, ``n_packed`` in the archive, ``at`` its header."""

    archive: Path
    name: str
    at: int
    n_bytes: int
    n_packed: int
    crc: int
    method: int

    def __str__(self) -> str:
        return f"{self.name} in {self.archive}"

    @property
    def is_stored(self) -> bool:
        """Whether it is not compressed."""
        return self.method == zipfile.ZIP_STORED


def key_of(name: str) -> str:
    """Return a member's name as it is looked up: programs under Windows separate by backslashes, and mix cases."""
    return name.strip().replace("\\", "/").lower()


def list_members(path: Path) -> dict[str, Member]:
    """Return the members of a ZIP file by :func:`key_of` their names.

    Raises :class:`EndoctError` if it is not a ZIP file, is truncated, has too long a list, or lists a name twice.
    """
    members: dict[str, Member] = {}
    with refusing(f"{path} is no readable ZIP file", remedy=COPY), open_regular(path) as file:
        listed = _list_bytes(file)
        if listed is None:
            raise EndoctError(f"{path} is truncated", found="no list of its members at its end", remedy=COPY)
        if listed > MOST_LIST_BYTES:
            most = f"{MOST_LIST_BYTES} at most"
            raise EndoctError(f"{path} lists too many members", found=f"{listed} bytes", expected=most)
        size = file.seek(0, 2)
        with zipfile.ZipFile(file) as archive:
            found = archive.infolist()
    for info in found:
        method = -1 if info.flag_bits & _ENCRYPTED else info.compress_type
        member = Member(path, info.filename, info.header_offset, info.file_size, info.compress_size, info.CRC, method)
        if member.at < 0 or member.at + _LOCAL.size + member.n_packed > size:
            raise EndoctError(f"{path} is truncated", found=f"{member.name[:80]} reaches beyond its end", remedy=COPY)
        if member.is_stored and member.n_bytes != member.n_packed:
            raise EndoctError(f"{member} does not have its stated size", found=f"{member.n_packed} bytes", remedy=COPY)
        if members.setdefault(key_of(member.name), member) is not member:
            raise EndoctError(f"{path} lists two members of one name", found=member.name[:80])
    return members


def read_member(member: Member, most_bytes: int) -> bytes:
    """Return all bytes of a member. Raises :class:`EndoctError` where it has more, or does not fit its checksum."""
    if member.n_bytes > most_bytes:
        raise EndoctError(
            f"{member} is too large for what it should be",
            found=f"{member.n_bytes} bytes",
            expected=f"{most_bytes} at most",
        )
    if not member.is_stored:
        return _inflated(member)
    data = bytearray(member.n_bytes)
    read_part(member, 0, memoryview(data))
    _check_sum(member, data)
    return bytes(data)


def read_part(member: Member, start: int, room: memoryview) -> None:
    """Fill ``room`` with the bytes of a member from ``start`` on.

    Where a member is not compressed its checksum is not asked: that takes as long as to make a B-scan of raw spectra.
    Raises :class:`EndoctError` where it ends before, or cannot be read.
    """
    if start + room.nbytes > member.n_bytes:
        raise EndoctError(
            f"{member} is too short",
            found=f"{member.n_bytes} bytes",
            expected=f"{start + room.nbytes}",
            remedy="copy or export it again",
        )
    if not member.is_stored:
        with _INFLATING:  # one thread unpacks, the others find it done
            data = _held(member, tuple(state_of(member.archive).values()))
        room[:] = memoryview(data)[start : start + room.nbytes]
        return
    with refusing(f"{member.archive} cannot be read"), open_regular(member.archive) as file:
        file.seek(_data_at(member, file) + start)
        if file.readinto(room) != room.nbytes:
            raise EndoctError(f"{member} is truncated", found=f"fewer than {member.n_bytes} bytes", remedy=COPY)


def check_held(member: Member) -> None:
    """Raise :class:`EndoctError` for a member whose parts cannot be read: compressed, and too large to be held."""
    if not member.is_stored:
        check_array_size((member.n_bytes,), 1, f"{member}, which is compressed,")


def _data_at(member: Member, file: BufferedReader) -> int:
    """Return where the bytes of a member begin, behind its header. Raises :class:`EndoctError` if that is missing."""
    file.seek(member.at)
    header = file.read(_LOCAL.size)
    if len(header) < _LOCAL.size or not header.startswith(ZIP_START):
        raise EndoctError(f"{member} is not where the list of members says", found="no header of a file", remedy=COPY)
    n_name, n_extra = _LOCAL.unpack(header)[-2:]
    return member.at + _LOCAL.size + int(n_name) + int(n_extra)


@functools.lru_cache(maxsize=1)
def _held(member: Member, _: tuple[tuple[int, ...], ...]) -> bytes:
    check_held(member)
    return _inflated(member)


def _inflated(member: Member) -> bytes:
    """Return the bytes of a compressed member, of which no more than it states are unpacked."""
    if member.method != zipfile.ZIP_DEFLATED:
        how = "it is encrypted" if member.method < 0 else f"method {member.method} of compression"
        raise EndoctError(f"{member} is not read", found=how, remedy="pack the archive again without compression")
    with refusing(f"{member} cannot be unpacked", remedy=COPY), open_regular(member.archive) as file:
        file.seek(_data_at(member, file))
        inflate, parts, n_bytes, left = zlib.decompressobj(-zlib.MAX_WBITS), [], 0, member.n_packed
        while not inflate.eof and n_bytes <= member.n_bytes:
            packed = inflate.unconsumed_tail
            if not packed:
                packed = file.read(min(left, BLOCK_BYTES))
                left -= len(packed)
            part = inflate.decompress(packed, BLOCK_BYTES)
            if not packed and not part:
                break
            parts.append(part)
            n_bytes += len(part)
        data = b"".join(parts)
    if len(data) != member.n_bytes:
        more = "more" if len(data) > member.n_bytes else f"{len(data)}"
        raise EndoctError(
            f"{member} does not have its stated size", found=f"{more} bytes", expected=f"{member.n_bytes}", remedy=COPY
        )
    _check_sum(member, data)
    return data


def _check_sum(member: Member, data: bytes | bytearray) -> None:
    if zlib.crc32(data) != member.crc:
        raise EndoctError(f"{member} is damaged", found="another checksum than the archive lists", remedy=COPY)


def _list_bytes(file: BufferedReader) -> int | None:
    """Return how long the list of members of a ZIP file is, None where it has none."""
    size = file.seek(0, 2)
    file.seek(max(0, size - _END.size - 0xFFFF - _END_64.size - _LOCATOR_BYTES))
    end = file.read()
    place = len(end) - _END.size
    if not (end[place:].startswith(b"PK\5\6") and end.endswith(b"\0\0")):
        place = end.rfind(b"PK\5\6")
    if place < 0 or len(end) < place + _END.size:
        return None
    at_64 = place - _LOCATOR_BYTES - _END_64.size
    if end[place - _LOCATOR_BYTES : place].startswith(b"PK\6\7") and end[at_64:].startswith(b"PK\6\6"):
        return int(_END_64.unpack_from(end, at_64)[8])
    return int(_END.unpack_from(end, place)[5])
