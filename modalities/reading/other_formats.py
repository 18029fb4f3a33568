"""Files that somebody may take for a recording and that are not read: named by their content, with what to do."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.base.files.files import read_start
from endoct.modalities.dicom.dicom_file import MAGIC, PREAMBLE, START_BYTES, UNKNOWN, kind_of, name_of

_VIDEO = "convert it without losses: ffmpeg -i IN -c:v ffv1 OUT.mkv"
_IMAGE = "convert its images to PNG or TIFF"
_EXPORT = "export the B-scans as TIFF, one page a slice, or as numbered images"
_LOOKED_AT = 4096
STILL_BRANDS = (b"heic", b"heix", b"mif1", b"avif", b"msf1", b"hevc", b"crx ")
"""Files of these brands are photographs in the container of MP4."""


@dataclass(frozen=True)
class OtherKind:
    """``name``: what a file is; ``remedy``: how to get something from it that is read."""

    name: str
    remedy: str

    def refusal(self, path: Path) -> EndoctError:
        """Return what to raise for the file at ``path``."""
        what = "image" if self.remedy == _IMAGE else "recording"
        return EndoctError(f"{path} is no readable {what}", found=f"{self.name}, which is not read", remedy=self.remedy)


def kind_not_read(path: Path) -> OtherKind | None:
    """Return what a file is, by its first bytes, if that is of a known kind which is not read; else None."""
    start = read_start(path, _LOOKED_AT)
    if (kind := kind_of(path)) != UNKNOWN or start[PREAMBLE:START_BYTES] == MAGIC:
        name = name_of(kind.sop_class)
        return OtherKind(f"a DICOM file of {name}" if name else "a DICOM file", _EXPORT)
    for is_that, name, remedy in _KINDS:
        if is_that(start):
            return OtherKind(name, remedy)
    return None


def _begins(*starts: bytes) -> Callable[[bytes], bool]:
    return lambda data: data.startswith(starts)


def _is_transport_stream(data: bytes) -> bool:
    """Packets of 188 bytes, or of 192 with a time before each, begin with the letter G."""
    return any(
        len(data) > first + 4 * size and all(data[first + k * size] == 0x47 for k in range(5))
        for first, size in ((0, 188), (4, 192))
    )


_KINDS: tuple[tuple[Callable[[bytes], bool], str, str], ...] = (
    (_begins(b"\x30\x26\xb2\x75\x8e\x66\xcf\x11"), "a Windows Media video (ASF, WMV)", _VIDEO),
    (_begins(b"\0\0\1\xba", b"\0\0\1\xb3"), "an MPEG video", _VIDEO),
    (_is_transport_stream, "an MPEG transport stream", _VIDEO),
    (_begins(b"FLV\1"), "a Flash video", _VIDEO),
    (_begins(b"OggS"), "an Ogg video", _VIDEO),
    (_begins(b"YUV4MPEG2"), "a raw video (Y4M)", _VIDEO),
    (_begins(b"\x06\x0e\x2b\x34\x02\x05\x01\x01"), "an MXF video", _VIDEO),
    (_begins(b"\0\0\0\1\x67", b"\0\0\0\1\x27", b"\0\0\0\1\x40\1"), "a video without a container", _VIDEO),
    (_begins(b"GIF87a", b"GIF89a"), "a GIF", _IMAGE),
    (lambda data: data[:4] == b"RIFF" and data[8:12] == b"WEBP", "a WebP image", _IMAGE),
    (lambda data: data[4:8] == b"ftyp" and data[8:12] in STILL_BRANDS, "a HEIF, AVIF or CR3 image", _IMAGE),
    (_begins(b"\0\0\0\x0cjP  ", b"\xff\x4f\xff\x51"), "a JPEG 2000 image", _IMAGE),
    (_begins(b"\xff\x0a", b"\0\0\0\x0cJXL "), "a JPEG XL image", _IMAGE),
    (_begins(b"\x76\x2f\x31\x01"), "an OpenEXR image", _IMAGE),
    (_begins(b"MATLAB 5.0", b"MATLAB 7.3"), "a MATLAB file", "save the stack as .npy or TIFF"),
    (_begins(b"\x89HDF\r\n\x1a\n"), "an HDF5 file", "save the stack as .npy or TIFF"),
    (_begins(b"II*\0\x10\0\0\0CR", b"IIU\0", b"FUJIFILM"), "a raw photograph", _IMAGE),
    (_begins(b"%PDF-"), "a PDF", _IMAGE),
    (_begins(b"NRRD000"), "an NRRD volume", _EXPORT),
    (_begins(b"\xa5\xa7\x7d\x0c"), "a Bioptigen OCT file", _EXPORT),
    (_begins(b"PK\3\4"), "a ZIP file", "unpack it"),
    (_begins(b"7z\xbc\xaf\x27\x1c", b"Rar!\x1a\x07", b"\x1f\x8b", b"BZh", b"\xfd7zXZ\0"), "an archive", "unpack it"),
)
