"""Files that are not read are refused by their right name; byte-order marks and texts of other programs are read."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import tifffile

from endoct.base.errors import EndoctError
from endoct.base.files.json_values import read_object
from endoct.modalities.acquisition import read_toml
from endoct.modalities.oct.spectra.vectors import read_vector, seems_spectra
from endoct.modalities.reading.other_formats import kind_not_read
from endoct.modalities.reading.recording import open_stack

STARTS = {
    "a.wmv": (b"\x30\x26\xb2\x75\x8e\x66\xcf\x11" + bytes(40), "Windows Media"),
    "a.mpg": (b"\0\0\1\xba" + bytes(40), "MPEG video"),
    "a.ts": ((b"G" + bytes(187)) * 8, "MPEG transport stream"),
    "a.m2ts": ((bytes(4) + b"G" + bytes(187)) * 8, "MPEG transport stream"),
    "a.flv": (b"FLV\1" + bytes(40), "Flash"),
    "a.ogv": (b"OggS" + bytes(40), "Ogg"),
    "a.gif": (b"GIF89a" + bytes(40), "a GIF"),
    "a.heic": (b"\0\0\0\x18ftypheic" + bytes(40), "HEIF"),
    "a.webp": (b"RIFF\0\0\0\0WEBP" + bytes(40), "WebP"),
    "a.mat": (b"MATLAB 5.0 MAT-file" + bytes(200), "MATLAB"),
    "a.h5": (b"\x89HDF\r\n\x1a\n" + bytes(40), "HDF5"),
    "a.dcm": (bytes(128) + b"DICM" + bytes(40), "DICOM"),
    "a.oct": (b"\xa5\xa7\x7d\x0c\x0a\x01" + bytes(40), "Bioptigen"),
    "a.zip": (b"PK\3\4" + bytes(40), "a ZIP file"),
}


@pytest.mark.parametrize("name", STARTS)
def test_what_is_not_read_is_refused_by_its_name(name: str, tmp_path: Path) -> None:
    data, kind = STARTS[name]
    (tmp_path / name).write_bytes(data)
    for path in (tmp_path, tmp_path / name):
        with pytest.raises(EndoctError, match=kind) as caught:
            open_stack(path)
        assert name in str(caught.value)
        assert "\n" not in str(caught.value)
        assert caught.value.remedy


def thorlabs(
    path: Path, header: str = '<?xml version="1.0"?>\n<Ocity version="1"><Image/></Ocity>', **options: str
) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as members:
        members.writestr("Header.xml", header.encode(options.get("encoding", "utf-8")))
        members.writestr("data\\Intensity.data", bytes(400))
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("name", ["scan.oct", "scan.zip", "scan.tif"])
def test_a_thorlabs_file_without_bscans_is_known_by_its_content(name: str, encoding: str, tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match=r"a Thorlabs OCT file \(ThorImage\) with no data;.*in ThorImage choose"):
        open_stack(thorlabs(tmp_path / name, encoding=encoding))


def test_one_that_was_cut_off_is_still_known(tmp_path: Path) -> None:
    path = thorlabs(tmp_path / "scan.oct")
    path.write_bytes(path.read_bytes()[:-60])
    with pytest.raises(EndoctError, match=r"scan\.oct is truncated"):
        open_stack(tmp_path)


def test_another_archive_is_none_and_a_tiff_named_oct_is_read(tmp_path: Path) -> None:
    with pytest.raises(EndoctError, match="a ZIP file, which is not read; unpack it"):
        open_stack(thorlabs(tmp_path / "scan.oct", header="<Other/>"))
    (tmp_path / "scan.oct").unlink()
    pages = np.random.default_rng(0).integers(0, 256, (3, 64, 80), dtype=np.uint8)
    tifffile.imwrite(tmp_path / "pullback.oct", pages, photometric="minisblack")
    np.testing.assert_array_equal(open_stack(tmp_path)[2], pages[2])
    assert kind_not_read(tmp_path / "pullback.oct") is None


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_byte_order_marks_are_no_text(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes('modality = "oct"\r\nbore_diameter_mm = 2.5\r\n'.encode(encoding))
    assert read_toml(tmp_path / "a.toml") == {"modality": "oct", "bore_diameter_mm": 2.5}
    (tmp_path / "a.json").write_bytes(json.dumps({"a": "ü"}, ensure_ascii=False).encode(encoding))
    assert read_object(tmp_path / "a.json") == {"a": "ü"}


@pytest.mark.parametrize("encoding", ["ascii", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("name", ["Chirp.dat", "Chirp", "chirp.txt"])
def test_a_chirp_is_text_by_its_content(name: str, encoding: str, tmp_path: Path) -> None:
    chirp = np.linspace(0.001, 511, 512)
    (tmp_path / name).write_bytes("\r\n".join(f"{value:.5e}" for value in chirp).encode(encoding) + b"")
    np.testing.assert_allclose(read_vector(tmp_path, name, "spectra.chirp", 512), chirp, rtol=1e-4)
    (tmp_path / "spectra.bin").write_bytes(bytes(2 * 512 * 64))
    assert "looks like a chirp" in (seems_spectra(tmp_path) or "")


def test_binary_vectors_stay_binary(tmp_path: Path) -> None:
    for dtype in ("<f8", "<f4"):
        chirp = np.linspace(0, 511, 512).astype(dtype)
        (tmp_path / "Chirp.dat").write_bytes(chirp.tobytes())
        np.testing.assert_array_equal(read_vector(tmp_path, "Chirp.dat", "spectra.chirp", 512), chirp.astype(float))


def test_decimal_commas_are_refused_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "Chirp.dat").write_text("\n".join(f"{k},5" for k in range(512)))
    with pytest.raises(EndoctError, match="write numbers with a point"):
        read_vector(tmp_path, "Chirp.dat", "spectra.chirp", 512)
